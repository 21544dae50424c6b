#include "knothe/numerics/integrate/halton.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::numerics {

namespace {

constexpr Eigen::Index k_max_dimension = 1000;

std::vector<std::uint32_t> first_primes(Eigen::Index count) {
  std::vector<std::uint32_t> primes;
  for (std::uint32_t candidate = 2; static_cast<Eigen::Index>(primes.size()) < count; ++candidate) {
    const bool divisible = std::any_of(primes.begin(), primes.end(), [&](std::uint32_t p) {
      return p * p <= candidate && candidate % p == 0;
    });
    if (!divisible) primes.push_back(candidate);
  }
  return primes;
}

/// What a digit is worth after its permutation: row `position`, column `digit` holds π(digit) /
/// base^{position
/// + 1}. As many positions as a double can tell.
std::vector<double> digit_values(std::uint32_t base, std::uint64_t seed, Eigen::Index dimension,
                                 std::size_t& positions) {
  std::uint64_t state = seed;
  state = split_mix(state) + static_cast<std::uint64_t>(dimension);
  std::vector<double> values;
  std::vector<std::uint32_t> permutation(base);
  positions = 0;
  for (double unit = 1.0 / base; unit > 0x1p-55; unit /= base, ++positions) {
    std::iota(permutation.begin(), permutation.end(), 0u);
    if (seed != 0)
      for (std::uint32_t i = base - 1; i > 0; --i)
        std::swap(permutation[i], permutation[(split_mix(state) >> 32) * (i + 1) >> 32]);
    for (const std::uint32_t digit : permutation) values.push_back(digit * unit);
  }
  return values;
}

}  // namespace

Eigen::MatrixXd halton_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed, std::uint64_t first) {
  if (d < 1 || d > k_max_dimension)
    throw UsageError(
        fmt::format("Halton sequence in {} dimensions: 1 to {} are possible", d, k_max_dimension));
  const std::vector<std::uint32_t> primes = first_primes(d);
  Eigen::MatrixXd points(n, d);
  std::vector<double> tail;
  for (Eigen::Index k = 0; k < d; ++k) {
    const std::uint32_t base = primes[k];
    std::size_t positions = 0;
    const std::vector<double> values = digit_values(base, seed, k, positions);
    // tail[p]: what positions p, p + 1, … are worth when their digits are zero (not 0 once permuted).
    tail.assign(positions + 1, 0.0);
    for (std::size_t p = positions; p-- > 0;) tail[p] = tail[p + 1] + values[p * base];
    for (Eigen::Index i = 0; i < n; ++i) {
      double x = 0;
      std::size_t p = 0;
      for (std::uint64_t rest = first + static_cast<std::uint64_t>(i); rest > 0 && p < positions;
           rest /= base, ++p)
        x += values[p * base + rest % base];
      points(i, k) = std::clamp(x + tail[p], 0x1p-54, 1 - 0x1p-53);
    }
  }
  return points;
}

Eigen::MatrixXd halton_normal_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed,
                                     std::uint64_t first) {
  return halton_points(n, d, seed, first).unaryExpr([](double u) { return normal_quantile(u); });
}

}  // namespace knothe::numerics
