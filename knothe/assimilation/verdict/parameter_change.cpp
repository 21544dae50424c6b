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

}  // namespace

ParameterChange find_parameter_change(const likelihood::FormBlocks& blocks, const Eigen::VectorXd& w,
                                      const Eigen::MatrixXd& tangent, double level) {
  const std::size_t count = blocks.forms().size();
  if (count < k_min_blocks) return {};
  const Index d = tangent.cols();
  Eigen::MatrixXd directions(w.size(), d + 1);
  directions << tangent, w;
  // Of the blocks up to each: d × d information, and score in the last column.
  std::vector<Eigen::MatrixXd> up_to(count);
  Eigen::MatrixXd curved(w.size(), d + 1);
  for (std::size_t k = 0; k < count; ++k) {
    const likelihood::StepForm& form = blocks.forms()[k];
    curved.noalias() = form.quadratic.lazyProduct(directions);  // few columns: no packing
    up_to[k].noalias() = tangent.transpose().lazyProduct(curved);
    up_to[k].col(d) = tangent.transpose() * form.linear - up_to[k].col(d);
    if (k > 0) up_to[k] += up_to[k - 1];
  }
  const Eigen::MatrixXd least = k_min_information * level * Eigen::MatrixXd::Identity(d, d);
  const Eigen::LLT<Eigen::MatrixXd> all(up_to.back().leftCols(d) + 1e-3 * least);
  if (all.info() != Eigen::Success) return {};
  const Eigen::VectorXd answer = all.solve(up_to.back().col(d));
  ParameterChange found;
  double largest = 0;
  Eigen::MatrixXd half(d, d), variance(d, d);
  Eigen::VectorXd score(d);
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const auto information = up_to[k].leftCols(d);
    half = information;
    all.matrixL().solveInPlace(half);
    variance = information + least - half.transpose().lazyProduct(half);
    score = up_to[k].col(d) - information.lazyProduct(answer);
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(variance);
    if (factor.info() != Eigen::Success) continue;
    factor.matrixL().solveInPlace(score);
    const double x = score.squaredNorm() / level;
    if (x > largest) largest = x, found.after = (k + 1) * blocks.steps_per_block();
  }
  found.probability = std::min(1.0, (count - 1) * numerics::chi_squared_upper(largest, d));
  return found;
}

}  // namespace knothe::assimilation
