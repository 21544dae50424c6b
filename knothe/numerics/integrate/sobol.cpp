#include "knothe/numerics/integrate/sobol.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <array>
#include <bit>
#include <boost/random/sobol.hpp>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::numerics {

namespace {

using Table = boost::random::default_sobol_table;  // new-joe-kuo-6
static_assert(k_sobol_max_dimension <= Table::max_dimension);

constexpr int k_bits = 32;
using Directions = std::array<std::uint32_t, k_bits>;

/// Column b of the generating matrix, leading bit first (Joe and Kuo 2008, Eq. 2.2).
Directions directions_of(Index dimension) {
  Directions v{};
  if (dimension == 0) {
    for (int b = 0; b < k_bits; ++b) v[b] = 1u << (31 - b);
    return v;
  }
  const std::size_t row = dimension - 1;
  // Primitive polynomial x^s + a_1 x^{s−1} + … + a_{s−1} x + 1, its coefficients the bits of a number.
  const std::uint32_t polynomial = Table::polynomial(row), s = std::bit_width(polynomial) - 1;
  for (std::uint32_t b = 0; b < k_bits; ++b) {
    if (b < s) {
      v[b] = std::uint32_t{Table::minit(row, b)} << (31 - b);
      continue;
    }
    v[b] = v[b - s] ^ (v[b - s] >> s);
    for (std::uint32_t k = 1; k < s; ++k)
      if ((polynomial >> (s - k)) & 1u) v[b] ^= v[b - k];
  }
  return v;
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

Eigen::MatrixXd sobol_points(Index n, Index d, std::uint64_t seed) {
  if (d < 1 || d > k_sobol_max_dimension)
    throw UsageError(
        fmt::format("Sobol sequence in {} dimensions: 1 to {} are possible", d, k_sobol_max_dimension));
  Eigen::MatrixXd points(n, d);
  std::uint64_t state = seed;
  for (Index k = 0; k < d; ++k) {
    Directions v = directions_of(k);
    std::uint32_t x = 0;
    if (seed != 0) {
      scramble(v, state);
      x = split_mix(state);
    }
    for (Index i = 0; i < n; ++i) {
      points(i, k) = (x + 0.5) * 0x1p-32;
      x ^= v[std::countr_one(static_cast<std::uint32_t>(i))];  // Gray code order
    }
  }
  return points;
}

Eigen::MatrixXd sobol_normal_points(Index n, Index d, std::uint64_t seed) {
  return sobol_points(n, d, seed).unaryExpr([](double u) { return normal_quantile(u); });
}

void match_standard_moments(Eigen::MatrixXd& points) {
  if (points.rows() <= points.cols()) return;
  // Twice, because the first pass leaves rounding errors of the size of its own correction.
  for (int pass = 0; pass < 2; ++pass) {
    points.rowwise() -= points.colwise().mean().eval();
    const Eigen::MatrixXd covariance = points.transpose() * points / points.rows();
    const Eigen::MatrixXd factor = covariance.llt().matrixL();
    points = factor.triangularView<Eigen::Lower>().solve(points.transpose()).transpose().eval();
  }
}

std::vector<Index> reversed_bits(Index n) {
  // With one more bit the list is itself, twice as large, and then that plus one: 0; 0 1; 0 2 1 3 …
  std::vector<Index> order = {0};
  while (std::ssize(order) < n) {
    const std::size_t half = order.size();
    order.resize(2 * half);
    for (std::size_t i = 0; i < half; ++i) order[half + i] = (order[i] *= 2) + 1;
  }
  std::erase_if(order, [n](Index i) { return i >= n; });
  return order;
}

}  // namespace knothe::numerics
