#include "knothe/numerics/statistics/chi_squared.hpp"

#include <algorithm>
#include <boost/math/special_functions/gamma.hpp>
#include <cassert>
#include <cmath>
#include <utility>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::numerics {
namespace {

namespace policies = boost::math::policies;
/// What is not a number gives one that is not.
using Policy =
    policies::policy<policies::promote_double<false>, policies::domain_error<policies::ignore_error>>;

/// Poisson terms further from the mean than this, in standard deviations, do not count (below 1e-15).
constexpr double k_reach = 8.5;
/// Noncentralities above have their tail from a normal distribution: relative error of the order λ^−½.
constexpr double k_largest = 4e4;

/// x^a e^−x / Γ(a + 1).
double power_term(double a, double x) {
  return std::exp(a * std::log(x) - x - std::lgamma(a + 1));
}

/// Poisson-weighted mean of Q(a + j, ·), from a table of them.
double poisson_mean(double half, const std::vector<double>& upper) {
  const double reach = k_reach * std::sqrt(half) + 12;
  const std::size_t first = std::max(0.0, std::floor(half - reach));
  const auto last = std::min<std::size_t>(upper.size() - 1, half + reach);
  const double j0 = first;
  double weight = half > 0 ? std::exp(j0 * std::log(half) - half - std::lgamma(j0 + 1)) : 1;
  double sum = 0;
  for (std::size_t j = first; j <= last; ++j) {
    sum += weight * upper[j];
    weight *= half / (j + 1);
  }
  return sum;
}

}  // namespace

double upper_gamma(double a, double x) {
  // Boost 1.74 asks for Γ(a + 1) where x is tiny, which overflows. P(a, x) is below 1e-60 here.
  if (a > 100 && x < 0.1 * a) return 1;
  return boost::math::gamma_q(a, x, Policy());
}

double mean_noncentral_upper(double x, double degrees, std::span<const double> noncentralities,
                             std::span<const double> weights) {
  assert(!noncentralities.empty() && degrees > 0 && weights.size() == noncentralities.size());
  double largest = 0;
  for (const double lambda : noncentralities)
    if (lambda <= k_largest) largest = std::max(largest, lambda);
  const double half = 0.5 * largest, a = 0.5 * degrees, y = 0.5 * x;
  const std::size_t count = half + k_reach * std::sqrt(half) + 14;
  // Q(a + j + 1, y) = Q(a + j, y) + y^(a+j) e^−y/Γ(a + j + 1); the terms from the largest, where nothing
  // underflows, both ways.
  std::vector<double> upper(count);
  const std::size_t top = std::clamp<double>(y - a, 0.0, count - 1);
  upper[top] = y > 0 ? power_term(a + top, y) : 0;
  for (std::size_t j = top; j + 1 < count; ++j) upper[j + 1] = upper[j] * y / (a + (j + 1));
  for (std::size_t j = top; j > 0; --j) upper[j - 1] = y > 0 ? upper[j] * (a + j) / y : 0;
  double tail = upper_gamma(a, y);
  for (double& entry : upper) tail = std::min(1.0, tail + std::exchange(entry, tail));
  double sum = 0;
  for (Index k = 0; k < std::ssize(weights); ++k) {
    const double lambda = noncentralities[k];
    if (!(weights[k] > 0)) continue;
    if (lambda <= k_largest) {
      sum += weights[k] * poisson_mean(0.5 * lambda, upper);
    } else {
      sum += 0.5 * weights[k] * std::erfc((x - degrees - lambda) / std::sqrt(4 * (degrees + 2 * lambda)));
    }
  }
  return std::min(1.0, sum);
}

}  // namespace knothe::numerics
