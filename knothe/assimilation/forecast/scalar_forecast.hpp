#pragma once
/// @file What is said of one predicted number: the same for a crack length, a displacement or a force.
#include <Eigen/Core>
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {

using numerics::k_quantile_levels;

/// The distribution of a quantity of interest q (Rubio et al. 2019, Eq. 14 and 33), in the unit of q.
/// Every number is finite.
struct ScalarForecast {
  double mean = 0.0;
  double std = 0.0;
  double maximum_a_posteriori = 0.0;                      ///< where the density is largest
  double probability_above_threshold = 0.0;               ///< P(q > threshold)
  std::array<double, k_quantile_levels.size()> values{};  ///< quantiles at `k_quantile_levels`
  std::vector<double> points;   ///< strictly increasing; dense where the density is large
  std::vector<double> density;  ///< at `points`, per unit of q
};

/// Values of a log-density (natural logarithm, any additive constant) at increasing points.
using LogDensityFunction = std::function<void(std::span<const double> points, std::span<double> log_density)>;

/// Forecast from a log-density on the interval [base.front(), base.back()].
/// `base` holds 2m + 1 increasing points: the even ones bound m intervals within which the log-density is
/// smooth, the odd ones are their midpoints; `base_values` is the log-density there. The density itself may
/// be far narrower than an interval: intervals that matter are halved until the log-density varies little
/// over each, and are then integrated by Simpson's rule. Points at -infinity have density zero. Errors:
/// NumericalError where the density is zero at all of `base` or a value is NaN or +infinity.
[[nodiscard]] ScalarForecast forecast_of_density(std::span<const double> base,
                                                 std::span<const double> base_values,
                                                 const LogDensityFunction& log_density, double threshold);

/// Forecast from weighted samples: moments, quantiles and probability of the samples, density by a Gaussian
/// kernel (Silverman's width for the effective sample size), most probable value that of the kernel density.
/// `weights` are non-negative and need not add up to 1. With `error_std` > 0 the forecast is of the sample
/// plus an independent error N(0, error_std²): a mixture of normal distributions, whose moments, quantiles
/// and probability are its own. Errors: NumericalError for no weight or non-finite input, or an `error_std`
/// that is negative.
[[nodiscard]] ScalarForecast forecast_of_samples(const Eigen::Ref<const Eigen::VectorXd>& values,
                                                 const Eigen::Ref<const Eigen::VectorXd>& weights,
                                                 double threshold, double error_std = 0.0);

}  // namespace knothe::assimilation
