#include "knothe/assimilation/verdict/parameter_change.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <vector>

#include "knothe/numerics/statistics/chi_squared.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

/// In units of the posterior's information. What a part of the data says of a direction counts from about
/// here on: where it is less, a difference is one of the model's curvature, and would not move the answer.
constexpr double k_min_information = 1e-3;

/// χ² of what a part of the data says of the parameters, given what all say: S − I I_n⁻¹ S_n over its
/// variance.
class Difference {
 public:
  Difference(const Eigen::MatrixXd& all, double level)
      : d_(all.rows()),
        level_(level),
        least_(k_min_information * level * Eigen::MatrixXd::Identity(d_, d_)),
        all_(all.leftCols(d_) + 1e-3 * least_) {
    if (all_.info() == Eigen::Success) answer_ = all_.solve(all.col(d_));
  }
  [[nodiscard]] double of(const Eigen::MatrixXd& part) const {
    if (all_.info() != Eigen::Success) return 0;
    const auto information = part.leftCols(d_);
    Eigen::MatrixXd half = information;
    all_.matrixL().solveInPlace(half);
    const Eigen::LLT<Eigen::MatrixXd> variance(information + least_ - half.transpose().lazyProduct(half));
    if (variance.info() != Eigen::Success) return 0;
    Eigen::VectorXd score = part.col(d_) - information.lazyProduct(answer_);
    variance.matrixL().solveInPlace(score);
    return score.squaredNorm() / level_;
  }

 private:
  Index d_;
  double level_;
  Eigen::MatrixXd least_;
  Eigen::LLT<Eigen::MatrixXd> all_;
  Eigen::VectorXd answer_;
};

}  // namespace

Eigen::MatrixXd said_of_parameters(const likelihood::StepForm& form, const Eigen::VectorXd& w,
                                   const Eigen::MatrixXd& tangent) {
  const Index d = tangent.cols();
  Eigen::MatrixXd directions(w.size(), d + 1);
  directions << tangent, w;
  const Eigen::MatrixXd curved = form.quadratic.lazyProduct(directions);  // few columns: no packing
  Eigen::MatrixXd said = tangent.transpose().lazyProduct(curved);
  said.col(d) = tangent.transpose() * form.linear - said.col(d);
  return said;
}

double probability_of_part(const Eigen::MatrixXd& part, const Eigen::MatrixXd& all, double level) {
  return numerics::chi_squared_upper(Difference(all, level).of(part), all.rows());
}

ParameterChange find_parameter_change(const likelihood::FormBlocks& blocks, const Eigen::VectorXd& w,
                                      const Eigen::MatrixXd& tangent, double level) {
  const std::size_t count = blocks.forms().size();
  if (count < k_min_blocks) return {};
  std::vector<Eigen::MatrixXd> up_to;  // of the blocks up to each
  for (const likelihood::StepForm& form : blocks.forms()) {
    up_to.push_back(said_of_parameters(form, w, tangent));
    if (up_to.size() > 1) up_to.back() += up_to[up_to.size() - 2];
  }
  const Difference difference(up_to.back(), level);
  ParameterChange found;
  double largest = 0;
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const double x = difference.of(up_to[k]);
    if (x > largest) largest = x, found.after = (k + 1) * blocks.steps_per_block();
  }
  found.probability = std::min(1.0, (count - 1) * numerics::chi_squared_upper(largest, tangent.cols()));
  return found;
}

}  // namespace knothe::assimilation
