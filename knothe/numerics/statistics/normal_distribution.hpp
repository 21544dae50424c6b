#pragma once
/// @file The standard normal distribution, accurate to full double precision in both tails.
namespace knothe::numerics {

/// φ(x) = exp(−x²/2)/√(2π).
[[nodiscard]] double normal_pdf(double x);
/// log φ(x).
[[nodiscard]] double normal_log_pdf(double x);
/// Φ(x), with small relative error down to the smallest double; use Φ(−x) for the upper tail.
[[nodiscard]] double normal_cdf(double x);
/// Φ⁻¹(u); −∞ at 0, +∞ at 1, NaN outside [0, 1]. For the upper tail use −Φ⁻¹(1 − u) with 1 − u known exactly.
[[nodiscard]] double normal_quantile(double u);

}  // namespace knothe::numerics
