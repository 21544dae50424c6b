#pragma once
/// @file Eight doubles that are worked on at once, and columns of them: the points of a block. Compiler
/// vectors (GCC and Clang turn them into whatever the machine has), so that sums stay in registers and an
/// expression is written as for one number.
#include <Eigen/Core>
#include <algorithm>
#include <cstring>

namespace knothe::posterior {

inline constexpr int k_lane_width = 8;
using Lanes = double __attribute__((vector_size(k_lane_width * sizeof(double))));

/// Points of one block of the kernel, in lanes.
inline constexpr int k_block_lanes = 8;
inline constexpr int k_block_points = k_lane_width * k_block_lanes;

/// One quantity at all points of a block.
struct Column {
  Lanes lane[k_block_lanes];
};

[[nodiscard]] inline Lanes lanes(double x) {
  return Lanes{} + x;
}
[[nodiscard]] inline Lanes smaller(Lanes a, Lanes b) {
  return a < b ? a : b;
}
[[nodiscard]] inline Lanes larger(Lanes a, Lanes b) {
  return a > b ? a : b;
}
[[nodiscard]] inline Lanes absolute(Lanes a) {
  return a < 0 ? -a : a;
}
[[nodiscard]] inline Lanes clamp(Lanes x, double bound) {
  return larger(smaller(x, lanes(bound)), lanes(-bound));
}

[[nodiscard]] inline Lanes exponential(Lanes x) {
  Eigen::Array<double, k_lane_width, 1> a;
  std::memcpy(a.data(), &x, sizeof x);
  a = a.exp();
  std::memcpy(&x, a.data(), sizeof x);
  return x;
}

[[nodiscard]] inline Lanes logarithm(Lanes x) {
  Eigen::Array<double, k_lane_width, 1> a;
  std::memcpy(a.data(), &x, sizeof x);
  a = a.log();
  std::memcpy(&x, a.data(), sizeof x);
  return x;
}

/// log(1 + u) for u ≥ 0, accurate for tiny u too (Kahan).
[[nodiscard]] inline Lanes logarithm_of_one_plus(Lanes u) {
  const Lanes one_plus = 1 + u, exact = one_plus - 1;
  const Lanes divisor = exact == 0 ? lanes(1) : exact;
  return exact == 0 ? u : u * logarithm(one_plus) / divisor;
}

/// Writes the first `count` points of a column.
inline void store(const Column& column, double* out, int count) {
  std::memcpy(out, column.lane, count * sizeof(double));
}

}  // namespace knothe::posterior
