#pragma once
/// @file Gaussian kernel density estimates of weighted points in one variable.
#include <span>
#include <vector>

namespace knothe::numerics {

/// Effective number of points: (Σw)²/Σw².
[[nodiscard]] double effective_count(std::span<const double> weights);

/// Silverman's bandwidth for weighted points, 0.9 min(std, interquartile range/1.34) n^(−1/5), n the
/// effective number: right for one hump. Positive: points that are all the same get a tiny one. Errors:
/// UsageError for no points, no positive weight, sizes that disagree, values not finite.
[[nodiscard]] double kernel_bandwidth(std::span<const double> values, std::span<const double> weights);

/// Σ_i w_i φ((x − x_i)/b)/b / Σ w at each of `at`; kernels are cut at 9 b.
[[nodiscard]] std::vector<double> kernel_density(std::span<const double> values,
                                                 std::span<const double> weights, double bandwidth,
                                                 std::span<const double> at);

}  // namespace knothe::numerics
