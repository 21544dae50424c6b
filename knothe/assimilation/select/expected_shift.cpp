#include "knothe/assimilation/select/expected_shift.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::assimilation {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd linear_posterior_shift(const MatrixXd& information, const VectorXd& prior_variance,
                                const MatrixXd& pull) {
  // In units of the prior's standard deviations: well scaled whatever the parameters' units are.
  const VectorXd std = prior_variance.cwiseSqrt();
  MatrixXd precision = std.asDiagonal() * information * std.asDiagonal();
  precision.diagonal().array() += 1;
  const Eigen::LLT<MatrixXd> factor(precision);
  const VectorXd posterior_std =
      factor.solve(MatrixXd::Identity(precision.rows(), precision.cols())).diagonal().cwiseSqrt();
  const MatrixXd shift = factor.solve(std.asDiagonal() * pull);
  return (posterior_std.cwiseInverse().asDiagonal() * shift).cwiseAbs().colwise().maxCoeff().transpose();
}

ExpectedShift::ExpectedShift(std::vector<posterior::Prior> priors, Index truths, std::uint64_t seed)
    : priors_(std::move(priors)), variance_(std::ssize(priors_)) {
  if (priors_.empty() || truths < 1)
    throw UsageError("expected shift: at least one parameter and one truth are needed");
  constexpr Index k_samples = 4096;  // of a scrambled net in one dimension: the variance to some digits
  const MatrixXd z = numerics::sobol_normal_points(k_samples, 1, seed);
  for (Index i = 0; i < variance_.size(); ++i) {
    const VectorXd p =
        z.col(0).unaryExpr([&](double value) { return priors_[i].from_standard_normal(value).value; });
    variance_[i] = (p.array() - p.mean()).square().mean();
  }
  const MatrixXd points = draw(truths, seed);
  for (Index n = 0; n < truths; ++n) truths_.push_back({points.row(n).transpose(), {}, {}, {}});
}

MatrixXd ExpectedShift::draw(Index n, std::uint64_t seed) const {
  MatrixXd points = numerics::sobol_normal_points(n, variance_.size(), seed);
  for (Index i = 0; i < points.cols(); ++i)
    for (Index k = 0; k < n; ++k) points(k, i) = priors_[i].from_standard_normal(points(k, i)).value;
  return points;
}

void ExpectedShift::set(const numerics::SparseInterpolation& interpolation, const MatrixXd& surpluses) {
  interpolation_ = &interpolation;
  surpluses_ = surpluses;
  // With the products of surpluses no truth needs the N predictions.
  const MatrixXd gram = surpluses * surpluses.transpose();
  for (Truth& truth : truths_) {
    const MatrixXd gradient = interpolation.basis_gradient(truth.p);
    truth.pull = gradient.transpose() * gram;
    truth.information = truth.pull * gradient;
    truth.basis = interpolation.basis(truth.p);
  }
}

VectorXd ExpectedShift::of_each() const {
  VectorXd sum = VectorXd::Zero(surpluses_.rows());
  for (const Truth& truth : truths_)
    sum += linear_posterior_shift(truth.information, variance_, truth.pull * truth.basis.asDiagonal())
               .cwiseAbs2();
  return (sum / truths_.size()).cwiseSqrt();
}

double ExpectedShift::of_all(const std::vector<bool>& chosen) const {
  double sum = 0;
  for (const Truth& truth : truths_) {
    VectorXd factors = truth.basis;
    for (Index n = 0; n < factors.size(); ++n)
      if (!chosen[n]) factors[n] = 0;
    sum += linear_posterior_shift(truth.information, variance_, truth.pull * factors).squaredNorm();
  }
  return std::sqrt(sum / truths_.size());
}

double ExpectedShift::of_factors(const std::function<VectorXd(const VectorXd&)>& factors) const {
  double sum = 0;
  for (const Truth& truth : truths_)
    sum += linear_posterior_shift(truth.information, variance_, truth.pull * factors(truth.p)).squaredNorm();
  return std::sqrt(sum / truths_.size());
}

double ExpectedShift::at(const VectorXd& p, const VectorXd& error) const {
  const MatrixXd jacobian = surpluses_.transpose() * interpolation_->basis_gradient(p);
  return linear_posterior_shift(jacobian.transpose() * jacobian, variance_, jacobian.transpose() * error)[0];
}

}  // namespace knothe::assimilation
