#pragma once
/// @file Are numbers in [0, 1] uniform? A band around the empirical distribution function that holds
/// everywhere at once: how ranks of simulation-based calibration are judged.
#include <Eigen/Core>
#include <span>

namespace knothe::numerics {

/// For n values and the points i/K, i = 1 … K − 1: the number of values ≤ i/K lies in lower_i … upper_i for
/// all i at once with probability `coverage` if the values are independent and uniform. T. Säilynoja, P.-C.
/// Bürkner, A. Vehtari, "Graphical test for discrete uniformity", Statistics and Computing 32 (2022),
/// section 2.3.
struct EcdfBand {
  int values = 0;                ///< n
  Eigen::VectorXd at;            ///< K − 1
  Eigen::VectorXi lower, upper;  ///< counts, K − 1
  double pointwise_level = 0;    ///< every point's own interval is that of the binomial law at this level
  double coverage = 0;           ///< exact, ≥ the level asked for: counts are whole numbers

  /// Largest excess of the counts of `sample` over the band, as a fraction of n; ≤ 0 if all lie inside.
  /// Errors: UsageError for another number of values or one outside [0, 1].
  [[nodiscard]] double excess(std::span<const double> sample) const;
};

/// The narrowest such band whose coverage is at least `level`. The probability is computed, not simulated:
/// the counts are a Markov chain with binomial steps. For values that are themselves ranks among L draws, K
/// must divide L + 1. Errors: UsageError for n < 2, K < 2, level outside (0, 1).
[[nodiscard]] EcdfBand simultaneous_ecdf_band(int n, int intervals, double level);

}  // namespace knothe::numerics
