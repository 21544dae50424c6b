#pragma once
/// @file Gaussian kernel density estimates of weighted points in one variable.
#include <span>
#include <vector>

namespace knothe::numerics {

/// Silverman's bandwidth, 0.9 min(std, quartile distance/1.34) n^(−1/5), n the effective number of points
/// (Σw)²/Σw²: right for one hump. Positive: points that are all the same get a tiny one.
[[nodiscard]] double silverman_bandwidth(double mean, double std, double quartile_distance, double count);

struct KernelDensity {
  std::vector<double> points;   ///< 161, even, from 3.5 bandwidths below the least value
  std::vector<double> density;  ///< at `points`
  double top = 0;               ///< where it is largest
};

/// Σ_i w_i φ((x − x_i)/b)/b / Σ w. The weights are shared out linearly over even bins, an eighth of b apart
/// where the range allows it: the mean stays, and the variance that this adds is taken from the kernel's.
/// Errors: UsageError for no positive weight, sizes that disagree, values not finite, b not positive.
[[nodiscard]] KernelDensity kernel_density(std::span<const double> values, std::span<const double> weights,
                                           double bandwidth);

}  // namespace knothe::numerics
