#include "knothe/assimilation/forecast/horizon.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::assimilation {

TimePosition locate_horizon(std::span<const double> times, double horizon, const std::string& option) {
  if (times.empty()) throw DataError("the model has no times");
  const double step = times.size() > 1 ? (times.back() - times.front()) / (times.size() - 1) : 1.0;
  const double slack = 1e-6 * step;
  if (!(horizon >= times.front() - slack && horizon <= times.back() + slack)) {
    const bool late = horizon > times.back();
    throw ProjectError(
        fmt::format("{} = {}: the model knows the times {} … {} only and does not "
                    "extrapolate; the nearest "
                    "is {}",
                    option, horizon, times.front(), times.back(), late ? times.back() : times.front()));
  }
  const auto after = std::lower_bound(times.begin(), times.end(), horizon);
  const std::size_t upper = std::min<std::size_t>(after - times.begin(), times.size() - 1);
  const std::size_t lower = upper > 0 ? upper - 1 : 0;
  if (std::abs(times[upper] - horizon) <= slack) return {upper, upper, 0.0};
  if (std::abs(times[lower] - horizon) <= slack) return {lower, lower, 0.0};
  return {lower, upper, (horizon - times[lower]) / (times[upper] - times[lower])};
}

LinearPrediction interpolate(const TimePosition& position, const LinearPrediction& at_lower,
                             const LinearPrediction& at_upper) {
  return {position.interpolate(at_lower.lift, at_upper.lift),
          position.interpolate(at_lower.modes, at_upper.modes)};
}

FunctionMoments moments_of_functions(const Eigen::Ref<const model::RowMatrix>& functions,
                                     const Eigen::Ref<const Eigen::VectorXd>& weights) {
  const double total = weights.sum();
  if (functions.rows() != weights.size() || !(total > 0.0) || !std::isfinite(total) ||
      weights.minCoeff() < 0.0)
    throw NumericalError("forecast: weights must be non-negative, one per point, with a positive sum");
  FunctionMoments moments;
  moments.mean = functions.transpose() * weights / total;
  const Index r = functions.cols();
  moments.covariance = Eigen::MatrixXd::Zero(r, r);
  // Blocks of points that stay in cache; centred before squaring, so that narrow posteriors keep their
  // digits.
  constexpr Index block = 128;
  model::RowMatrix centred(std::min(block, functions.rows()), r);
  for (Index begin = 0; begin < functions.rows(); begin += block) {
    const Index n = std::min(block, functions.rows() - begin);
    centred.topRows(n) =
        (functions.middleRows(begin, n).rowwise() - moments.mean.transpose()).array().colwise() *
        (weights.segment(begin, n).array() / total).sqrt();
    moments.covariance.noalias() += centred.topRows(n).transpose() * centred.topRows(n);
  }
  return moments;
}

}  // namespace knothe::assimilation
