#include "knothe/numerics/statistics/normal_distribution.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace knothe::numerics {

namespace {

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
  const double high = static_cast<double>(static_cast<float>(x)), low = x - high;
  return std::exp(-0.5 * high * high) * std::exp(-low * (high + 0.5 * low));
}

template <std::size_t N>
double polynomial(const std::array<double, N>& c, double x) {
  double sum = c[N - 1];
  for (std::size_t k = N - 1; k-- > 0;) sum = sum * x + c[k];
  return sum;
}

/// AS 241, routine PPND16, for 0 < u < 1.
double wichura(double u) {
  static constexpr std::array<double, 8> a = {
      3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
      4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3};
  static constexpr std::array<double, 8> b = {1.0,
                                              4.2313330701600911252e1,
                                              6.8718700749205790830e2,
                                              5.3941960214247511077e3,
                                              2.1213794301586595867e4,
                                              3.9307895800092710610e4,
                                              2.8729085735721942674e4,
                                              5.2264952788528545610e3};
  static constexpr std::array<double, 8> c = {1.42343711074968357734e0,  4.63033784615654529590e0,
                                              5.76949722146069140550e0,  3.64784832476320460504e0,
                                              1.27045825245236838258e0,  2.41780725177450611770e-1,
                                              2.27238449892691845833e-2, 7.74545014278341407640e-4};
  static constexpr std::array<double, 8> d = {1.0,
                                              2.05319162663775882187e0,
                                              1.67638483018380384940e0,
                                              6.89767334985100004550e-1,
                                              1.48103976427480074590e-1,
                                              1.51986665636164571966e-2,
                                              5.47593808499534494600e-4,
                                              1.05075007164441684324e-9};
  static constexpr std::array<double, 8> e = {6.65790464350110377720e0,  5.46378491116411436990e0,
                                              1.78482653991729133580e0,  2.96560571828504891230e-1,
                                              2.65321895265761230930e-2, 1.24266094738807843860e-3,
                                              2.71155556874348757815e-5, 2.01033439929228813265e-7};
  static constexpr std::array<double, 8> f = {1.0,
                                              5.99832206555887937690e-1,
                                              1.36929880922735805310e-1,
                                              1.48753612908506148525e-2,
                                              7.86869131145613259100e-4,
                                              1.84631831751005468180e-5,
                                              1.42151175831644588870e-7,
                                              2.04426310338993978564e-15};
  const double q = u - 0.5;
  if (std::abs(q) <= 0.425) {
    const double r = 0.180625 - q * q;
    return q * polynomial(a, r) / polynomial(b, r);
  }
  const double r = std::sqrt(-std::log(q < 0 ? u : 1 - u));
  const double x =
      r <= 5 ? polynomial(c, r - 1.6) / polynomial(d, r - 1.6) : polynomial(e, r - 5) / polynomial(f, r - 5);
  return q < 0 ? -x : x;
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

double normal_log_cdf(double x) {
  if (x < -8) return normal_log_pdf(x) + std::log(mills_ratio(-x));
  if (x > 0) return std::log1p(-normal_cdf(-x));
  return std::log(normal_cdf(x));
}

double normal_quantile(double u) {
  if (!(u >= 0 && u <= 1)) return std::numeric_limits<double>::quiet_NaN();
  if (u == 0) return -std::numeric_limits<double>::infinity();
  if (u == 1) return std::numeric_limits<double>::infinity();
  // Work in the lower tail, where Φ has small relative error; 1 − u is exact for u ≥ 1/2.
  const double sign = u > 0.5 ? -1.0 : 1.0, tail = u > 0.5 ? 1 - u : u;
  const double x = wichura(tail);
  if (tail < 1e-300) return sign * x;
  const double error = (normal_cdf(x) - tail) / normal_pdf(x);
  return sign * (x - error / (1 + 0.5 * x * error));
}

}  // namespace knothe::numerics
