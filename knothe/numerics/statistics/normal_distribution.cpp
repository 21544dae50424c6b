#include "knothe/numerics/statistics/normal_distribution.hpp"

#include <boost/math/special_functions/erf.hpp>
#include <cmath>
#include <limits>
#include <numbers>

namespace knothe::numerics {

namespace {

using Policy = boost::math::policies::policy<boost::math::policies::promote_double<false>>;

constexpr double k_log_sqrt_two_pi = 0.91893853320467274178;
constexpr double k_inverse_sqrt_two_pi = 0.39894228040143267794;

/// Mills' ratio (1 − Φ(x))/φ(x) for x ≥ 8 by its continued fraction 1/(x + 1/(x + 2/(x + 3/(x + …
/// (Abramowitz and Stegun, 26.2.14); 40 terms are exact to rounding there.
double mills_ratio(double x) {
  double fraction = x;
  for (int k = 40; k >= 1; --k) fraction = x + k / fraction;
  return 1 / fraction;
}

/// x²/2 carries a rounding error that exp would magnify: split x so that the large part squares exactly.
double exp_minus_half_square(double x) {
  const double high = static_cast<float>(x), low = x - high;
  return std::exp(-0.5 * high * high) * std::exp(-low * (high + 0.5 * low));
}

}  // namespace

double normal_pdf(double x) {
  return k_inverse_sqrt_two_pi * exp_minus_half_square(x);
}

double normal_log_pdf(double x) {
  return -0.5 * x * x - k_log_sqrt_two_pi;
}

double normal_cdf(double x) {
  if (x < -8) return x < -39 ? 0.0 : normal_pdf(x) * mills_ratio(-x);
  return 0.5 * std::erfc(-x / std::numbers::sqrt2);
}

double normal_quantile(double u) {
  if (!(u >= 0 && u <= 1)) return std::numeric_limits<double>::quiet_NaN();
  if (u == 0) return -std::numeric_limits<double>::infinity();
  if (u == 1) return std::numeric_limits<double>::infinity();
  // In the lower tail, where 2u is exact and Φ has small relative error; 1 − u is exact for u ≥ 1/2.
  constexpr double to_standard = -std::numbers::sqrt2;
  return u > 0.5 ? -to_standard * boost::math::erfc_inv(2 * (1 - u), Policy())
                 : to_standard * boost::math::erfc_inv(2 * u, Policy());
}

}  // namespace knothe::numerics
