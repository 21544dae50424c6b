#include "knothe/assimilation/decide/expected_information.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

std::vector<Eigen::MatrixXd> sum(std::vector<Eigen::MatrixXd> a, const std::vector<Eigen::MatrixXd>& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] += b[i];
  return a;
}

}  // namespace

ExpectedInformation::ExpectedInformation(std::shared_ptr<const model::ObservedModel> model,
                                         const likelihood::GaussianNoise& noise)
    : model_(std::move(model)) {
  // Semidefinite where there are fewer sensors than modes.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> precision(model_->space.transpose() *
                                                                 noise.apply(model_->space));
  factor_ =
      precision.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal() * precision.eigenvectors().transpose();
}

void ExpectedInformation::set(const Eigen::Ref<const Eigen::MatrixXd>& points,
                              const Eigen::MatrixXd& prior_precision, const Eigen::MatrixXd& data,
                              const Eigen::MatrixXd& about) {
  const Index n = points.rows(), d = points.cols();
  model::FunctionBatch at;
  at.resize(n, d, functions(), 1);
  model_->functions->evaluate(points, 1, at);
  tangents_.resize(functions(), n * d);
  for (Index i = 0; i < n; ++i)
    for (Index a = 0; a < d; ++a) tangents_.col(i * d + a) = at.first[a].row(i).transpose();
  about_ = about;
  known_.assign(n, prior_precision);
  const Eigen::MatrixXd weighted = data.size() > 0 ? Eigen::MatrixXd(data * tangents_) : Eigen::MatrixXd();
  for (Index i = 0; i < n; ++i) {
    if (data.size() > 0)
      known_[i] += tangents_.middleCols(i * d, d).transpose() * weighted.middleCols(i * d, d);
    if (!known_[i].allFinite())
      throw NumericalError("what a measurement tells cannot be computed: a precision is not finite");
  }
}

ExpectedInformation::Matrices ExpectedInformation::fisher(std::size_t step) const {
  const Index d = about_.cols();
  const Eigen::MatrixXd seen = factor_ * (model_->core[step] * tangents_);
  Matrices found;
  for (Index i = 0; i < std::ssize(known_); ++i) {
    const auto rows = seen.middleCols(i * d, d);
    found.emplace_back(rows.transpose() * rows);
  }
  return found;
}

/// Mean of ½ log det(B Λ⁻¹ Bᵀ).
double ExpectedInformation::half_log_variance(const Matrices& precision) const {
  if (about_.isZero(0)) return 0;  // of a forecast that does not depend on the parameters
  Eigen::MatrixXd one;
  const auto half_log_determinant = [](Eigen::MatrixXd& positive) {
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(positive);  // in place
    if (factor.info() != Eigen::Success)
      throw NumericalError(
          "what a measurement tells cannot be computed: a precision is not positive definite");
    return factor.matrixLLT().diagonal().array().log().sum();
  };
  double sum = 0;
  for (const Eigen::MatrixXd& of_point : precision) {
    one = of_point;
    if (is_of_all()) {
      sum -= half_log_determinant(one);
      continue;
    }
    one = about_ * Eigen::LLT<Eigen::MatrixXd>(of_point).solve(about_.transpose());
    sum += half_log_determinant(one);
  }
  return sum / std::ssize(precision);
}

double ExpectedInformation::of(std::size_t step) const {
  return half_log_variance(known_) - half_log_variance(sum(known_, fisher(step)));
}

std::vector<PlannedMeasurement> ExpectedInformation::plan(std::span<const std::size_t> steps,
                                                          double least) const {
  std::vector<Matrices> measured;
  for (const std::size_t step : steps) measured.push_back(fisher(step));
  std::vector<PlannedMeasurement> planned;
  Matrices precision = known_;
  double now = half_log_variance(precision);
  // The more is planned the less another one tells of all parameters: what it told last is a bound (lazy
  // greedy choice). Of some of them it may tell more, once others are known.
  std::vector<double> gain(steps.size(), std::numeric_limits<double>::infinity());
  std::vector<std::size_t> planned_then(steps.size(), k_max_planned);  // when `gain` was computed
  while (planned.size() < k_max_planned) {
    const std::size_t best = std::max_element(gain.begin(), gain.end()) - gain.begin();
    if (best == steps.size() || gain[best] <= least) break;
    if (planned_then[best] != planned.size()) {
      gain[best] = now - half_log_variance(sum(precision, measured[best]));
      planned_then[best] = planned.size();
      continue;
    }
    precision = sum(std::move(precision), measured[best]);
    now -= gain[best];
    planned.push_back({steps[best], gain[best]});
    if (!is_of_all()) std::fill(gain.begin(), gain.end(), std::numeric_limits<double>::infinity());
  }
  return planned;
}

}  // namespace knothe::assimilation
