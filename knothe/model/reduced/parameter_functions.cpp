#include "knothe/model/reduced/parameter_functions.hpp"

#include <cassert>
#include <limits>

#include "knothe/base/index.hpp"

namespace knothe::model {

namespace {

/// The quadratic form of any functions: they are evaluated, then multiplied.
class GenericQuadraticForm final : public QuadraticForm {
 public:
  explicit GenericQuadraticForm(const ParameterFunctions& functions) : functions_(functions) {}

  void set(const Eigen::Ref<const Eigen::MatrixXd>& a, const Eigen::Ref<const Eigen::VectorXd>& b,
           const Eigen::Ref<const Eigen::VectorXd>& c, double constant) override {
    assert(a.cols() == functions_.count() && a.rows() == b.size() && c.size() == functions_.count());
    a_ = a;
    b_ = b;
    c_ = c;
    constant_ = constant;
  }

  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                Eigen::Ref<Eigen::VectorXd> value, Eigen::Ref<Eigen::MatrixXd> gradient,
                Eigen::Ref<Eigen::MatrixXd> hessian) override {
    const Index n = points.rows(), d = functions_.dimension(), r = functions_.count();
    first_.resize(a_.rows(), d);
    if (one_.value.rows() != 1) {
      one_.resize(1, d, r, 2);
      many_.resize(k_block, d, r, 2);
    }
    // Blocks of two sizes, whatever the number of points: nothing is allocated after the first call.
    Index start = 0;
    const auto evaluate_block = [&](Index size, FunctionBatch& batch) {
      functions_.evaluate(points.middleRows(start, size), derivatives, batch);
      for (Index i = 0; i < size; ++i, ++start)
        combine(batch, i, derivatives, start, value, gradient, hessian);
    };
    while (start + k_block <= n) evaluate_block(k_block, many_);
    while (start < n) evaluate_block(1, one_);
  }

 private:
  /// ℓ at row `i` of the batch, into row `row` of the results.
  void combine(const FunctionBatch& batch, Index i, int derivatives, Index row,
               Eigen::Ref<Eigen::VectorXd>& value, Eigen::Ref<Eigen::MatrixXd>& gradient,
               Eigen::Ref<Eigen::MatrixXd>& hessian) {
    residual_ = b_;
    residual_.noalias() += a_ * batch.value.row(i).transpose();
    value[row] = constant_ - 0.5 * residual_.squaredNorm() + c_.dot(batch.value.row(i));
    if (derivatives == 0) return;
    weight_ = c_;
    weight_.noalias() -= a_.transpose() * residual_;
    for (Index k = 0; k < functions_.dimension(); ++k) {
      gradient(row, k) = batch.first[k].row(i).dot(weight_);
      if (derivatives < 2) continue;
      first_.col(k).noalias() = a_ * batch.first[k].row(i).transpose();
      for (Index m = 0; m <= k; ++m) {
        const Index km = k * (k + 1) / 2 + m;
        hessian(row, km) = batch.second[km].row(i).dot(weight_) - first_.col(k).dot(first_.col(m));
      }
    }
  }

  static constexpr Index k_block = 16;

  const ParameterFunctions& functions_;
  Eigen::MatrixXd a_;
  Eigen::VectorXd b_, c_;
  double constant_ = 0;
  Eigen::MatrixXd first_;  ///< A ∂_a w
  Eigen::VectorXd residual_, weight_;
  FunctionBatch one_, many_;
};

}  // namespace

Eigen::VectorXd ParameterFunctions::magnitude(const Eigen::VectorXd& centre) const {
  return Eigen::VectorXd::Constant(centre.size(), std::numeric_limits<double>::infinity());
}

std::unique_ptr<QuadraticForm> ParameterFunctions::make_quadratic_form() const {
  return std::make_unique<GenericQuadraticForm>(*this);
}

}  // namespace knothe::model
