#include "knothe/numerics/sobol.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <array>
#include <bit>

#include "knothe/base/error.hpp"
#include "knothe/numerics/normal_distribution.hpp"

namespace knothe::numerics {

namespace {

constexpr int k_bits = 32;
using Directions = std::array<std::uint32_t, k_bits>;

/// Primitive polynomial (degree s, inner coefficients a) and the first s direction numbers of one dimension.
struct Initial {
  std::uint32_t s, a;
  std::array<std::uint32_t, 8> m;
};

// Dimensions 2 … 40; the first dimension is the van der Corput sequence.
constexpr std::array<Initial, 39> k_joe_kuo = {{
    {1, 0, {1}},
    {2, 1, {1, 3}},
    {3, 1, {1, 3, 1}},
    {3, 2, {1, 1, 1}},
    {4, 1, {1, 1, 3, 3}},
    {4, 4, {1, 3, 5, 13}},
    {5, 2, {1, 1, 5, 5, 17}},
    {5, 4, {1, 1, 5, 5, 5}},
    {5, 7, {1, 1, 7, 11, 19}},
    {5, 11, {1, 1, 5, 1, 1}},
    {5, 13, {1, 1, 1, 3, 11}},
    {5, 14, {1, 3, 5, 5, 31}},
    {6, 1, {1, 3, 3, 9, 7, 49}},
    {6, 13, {1, 1, 1, 15, 21, 21}},
    {6, 16, {1, 3, 1, 13, 27, 49}},
    {6, 19, {1, 1, 1, 15, 7, 5}},
    {6, 22, {1, 3, 1, 15, 13, 25}},
    {6, 25, {1, 1, 5, 5, 19, 61}},
    {7, 1, {1, 3, 7, 11, 23, 15, 103}},
    {7, 4, {1, 3, 7, 13, 13, 15, 69}},
    {7, 7, {1, 1, 3, 13, 7, 35, 63}},
    {7, 8, {1, 3, 5, 9, 1, 25, 53}},
    {7, 14, {1, 3, 1, 13, 9, 35, 107}},
    {7, 19, {1, 3, 1, 5, 27, 61, 31}},
    {7, 21, {1, 1, 5, 11, 19, 41, 61}},
    {7, 28, {1, 3, 5, 3, 3, 13, 69}},
    {7, 31, {1, 1, 7, 13, 1, 19, 1}},
    {7, 32, {1, 3, 7, 5, 13, 19, 59}},
    {7, 37, {1, 1, 3, 9, 25, 29, 41}},
    {7, 41, {1, 3, 5, 13, 23, 1, 55}},
    {7, 42, {1, 3, 7, 3, 13, 59, 17}},
    {7, 50, {1, 3, 1, 3, 5, 53, 69}},
    {7, 55, {1, 1, 5, 5, 23, 33, 13}},
    {7, 56, {1, 1, 7, 7, 1, 61, 123}},
    {7, 59, {1, 1, 7, 9, 13, 61, 49}},
    {7, 62, {1, 3, 3, 5, 3, 55, 33}},
    {8, 14, {1, 3, 1, 15, 31, 13, 49, 245}},
    {8, 21, {1, 3, 5, 15, 31, 59, 63, 97}},
    {8, 22, {1, 3, 1, 11, 11, 11, 77, 249}},
}};

/// Column b of the generating matrix, leading bit first (Joe and Kuo 2008, Eq. 2.2).
Directions directions_of(Eigen::Index dimension) {
  Directions v{};
  if (dimension == 0) {
    for (int b = 0; b < k_bits; ++b) v[static_cast<std::size_t>(b)] = 1u << (31 - b);
    return v;
  }
  const Initial& initial = k_joe_kuo[static_cast<std::size_t>(dimension - 1)];
  const std::uint32_t s = initial.s;
  for (std::uint32_t b = 0; b < k_bits; ++b) {
    if (b < s) {
      v[b] = initial.m[b] << (31 - b);
      continue;
    }
    v[b] = v[b - s] ^ (v[b - s] >> s);
    for (std::uint32_t k = 1; k < s; ++k)
      if ((initial.a >> (s - 1 - k)) & 1u) v[b] ^= v[b - k];
  }
  return v;
}

/// Steele, Lea, Flood 2014: a 64-bit generator fit for seeding.
std::uint64_t split_mix(std::uint64_t& state) {
  std::uint64_t z = (state += 0x9e3779b97f4a7c15ULL);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// Multiplies every direction by one random lower triangular matrix with unit diagonal (over the field of two
/// elements).
void scramble(Directions& v, std::uint64_t& state) {
  std::array<std::uint32_t, k_bits> row{};
  for (std::uint32_t i = 0; i < k_bits; ++i) {
    const std::uint32_t above = i == 0 ? 0u : ~0u << (32 - i);
    row[i] = (static_cast<std::uint32_t>(split_mix(state)) & above) | (1u << (31 - i));
  }
  for (auto& direction : v) {
    std::uint32_t product = 0;
    for (std::uint32_t i = 0; i < k_bits; ++i)
      product |= (static_cast<std::uint32_t>(std::popcount(row[i] & direction)) & 1u) << (31 - i);
    direction = product;
  }
}

}  // namespace

Eigen::MatrixXd sobol_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed) {
  if (d < 1 || d > k_sobol_max_dimension)
    throw UsageError(
        fmt::format("Sobol sequence in {} dimensions: 1 to {} are possible", d, k_sobol_max_dimension));
  Eigen::MatrixXd points(n, d);
  std::uint64_t state = seed;
  for (Eigen::Index k = 0; k < d; ++k) {
    Directions v = directions_of(k);
    std::uint32_t x = 0;
    if (seed != 0) {
      scramble(v, state);
      x = static_cast<std::uint32_t>(split_mix(state));
    }
    for (Eigen::Index i = 0; i < n; ++i) {
      points(i, k) = (x + 0.5) * 0x1p-32;
      x ^= v[static_cast<std::size_t>(std::countr_one(static_cast<std::uint32_t>(i)))];  // Gray code order
    }
  }
  return points;
}

Eigen::MatrixXd sobol_normal_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed) {
  return sobol_points(n, d, seed).unaryExpr([](double u) { return normal_quantile(u); });
}

void match_standard_moments(Eigen::MatrixXd& points) {
  if (points.rows() <= points.cols()) return;
  // Twice, because the first pass leaves rounding errors of the size of its own correction.
  for (int pass = 0; pass < 2; ++pass) {
    points.rowwise() -= points.colwise().mean().eval();
    const Eigen::MatrixXd covariance = points.transpose() * points / static_cast<double>(points.rows());
    const Eigen::MatrixXd factor = covariance.llt().matrixL();
    points = factor.triangularView<Eigen::Lower>().solve(points.transpose()).transpose().eval();
  }
}

}  // namespace knothe::numerics
