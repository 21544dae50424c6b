#include "knothe/offline/law/damage_law.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::offline {
namespace {

using Vector3 = std::array<double, 3>;

Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Vector3 times(const Matrix3& m, const Vector3& v) {
  return {dot(m[0], v), dot(m[1], v), dot(m[2], v)};
}

/// The eigenvector of a simple eigenvalue: the longest cross product of two rows of (m - value I).
Vector3 simple_eigenvector(Matrix3 m, double value) {
  for (int i = 0; i < 3; ++i) m[i][i] -= value;
  Vector3 best{1, 0, 0};
  double best_square = 0;
  for (int i = 0; i < 3; ++i) {
    const Vector3 candidate = cross(m[i], m[(i + 1) % 3]);
    const double square = dot(candidate, candidate);
    if (square > best_square) {
      best_square = square;
      best = candidate;
    }
  }
  if (best_square == 0) return {1, 0, 0};
  const double scale = 1 / std::sqrt(best_square);
  return {best[0] * scale, best[1] * scale, best[2] * scale};
}

/// Two unit vectors that complete `axis` to an orthonormal frame.
std::array<Vector3, 2> complement(const Vector3& axis) {
  Vector3 first;
  if (std::abs(axis[0]) > std::abs(axis[1])) {
    const double scale = 1 / std::hypot(axis[0], axis[2]);
    first = {-axis[2] * scale, 0, axis[0] * scale};
  } else {
    const double scale = 1 / std::hypot(axis[1], axis[2]);
    first = {0, axis[2] * scale, -axis[1] * scale};
  }
  return {first, cross(axis, first)};
}

struct PlaneEigen {
  double larger, smaller;
  Vector3 larger_direction, smaller_direction;
};
/// Eigenvalues and vectors of `m` restricted to the plane across `axis`: one exact Jacobi rotation.
PlaneEigen plane_eigen(const Matrix3& m, const Vector3& axis) {
  const auto [u, v] = complement(axis);
  const Vector3 mu = times(m, u), mv = times(m, v);
  const double a = dot(u, mu), b = dot(u, mv), c = dot(v, mv);
  const double half = 0.5 * (a - c), radius = std::hypot(half, b), mean = 0.5 * (a + c);
  // cos 2θ = half / radius; the larger eigenvalue's direction is u cos θ + v sin θ.
  double cosine = 1, sine = 0;
  if (radius > 0) {
    if (half >= 0) {
      cosine = std::sqrt(0.5 * (1 + half / radius));
      sine = b / (2 * radius * cosine);
    } else {
      sine = std::sqrt(0.5 * (1 - half / radius));
      cosine = b / (2 * radius * sine);
    }
  }
  PlaneEigen result{mean + radius, mean - radius, {}, {}};
  for (int i = 0; i < 3; ++i) {
    result.larger_direction[i] = cosine * u[i] + sine * v[i];
    result.smaller_direction[i] = -sine * u[i] + cosine * v[i];
  }
  return result;
}

}  // namespace

void ElasticConstants::validate() const {
  if (!(young_modulus > 0) || !std::isfinite(young_modulus))
    throw ProjectError(fmt::format("Young's modulus is {} Pa; it must be positive", young_modulus));
  if (!(poisson_ratio > -1 && poisson_ratio < 0.5))
    throw ProjectError(fmt::format("Poisson's ratio is {}; it must be between -1 and 0.5", poisson_ratio));
}

void DamageParameters::validate() const {
  if (!(threshold >= 0) || !std::isfinite(threshold))
    throw ProjectError(
        fmt::format("the damage threshold Y0 is {} J/m3; it must be 0 or positive", threshold));
  if (!(brittleness > 0) || !std::isfinite(brittleness))
    throw ProjectError(fmt::format("the brittleness Ad is {} m3/J; it must be positive", brittleness));
}

PrincipalStrains principal_strains(const Voigt& e) {
  double scale = 0;
  for (int i = 0; i < 6; ++i) scale = std::max(scale, std::abs(e[i]));
  PrincipalStrains result;
  result.directions = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  if (scale == 0) return result;

  // Scaled to entries of order one, so that nothing under- or overflows.
  const double s = 1 / scale;
  const Matrix3 m = {{{e[0] * s, 0.5 * e[3] * s, 0.5 * e[5] * s},
                      {0.5 * e[3] * s, e[1] * s, 0.5 * e[4] * s},
                      {0.5 * e[5] * s, 0.5 * e[4] * s, e[2] * s}}};
  const double mean = (m[0][0] + m[1][1] + m[2][2]) / 3;
  const double a = m[0][0] - mean, b = m[1][1] - mean, c = m[2][2] - mean;
  const double off = m[0][1] * m[0][1] + m[1][2] * m[1][2] + m[0][2] * m[0][2];
  const double p = std::sqrt((a * a + b * b + c * c + 2 * off) / 6);
  if (p < 1e-150) {
    result.values = {mean * scale, mean * scale, mean * scale};
    return result;
  }
  // The deviator is p B with eigenvalues 2 cos(θ + 2πk/3) of B and det B = 2 cos 3θ.
  const double determinant = a * (b * c - m[1][2] * m[1][2]) - m[0][1] * (m[0][1] * c - m[1][2] * m[0][2]) +
                             m[0][2] * (m[0][1] * m[1][2] - b * m[0][2]);
  const double half_determinant = std::clamp(determinant / (2 * p * p * p), -1.0, 1.0);
  const double angle = std::acos(half_determinant) / 3;
  if (half_determinant >= 0) {  // the largest eigenvalue is the best separated
    const double largest = mean + 2 * p * std::cos(angle);
    const Vector3 axis = simple_eigenvector(m, largest);
    const PlaneEigen plane = plane_eigen(m, axis);
    result.values = {dot(axis, times(m, axis)) * scale, plane.larger * scale, plane.smaller * scale};
    result.directions = {axis, plane.larger_direction, plane.smaller_direction};
  } else {
    const double smallest = mean + 2 * p * std::cos(angle + 2.0943951023931954923);
    const Vector3 axis = simple_eigenvector(m, smallest);
    const PlaneEigen plane = plane_eigen(m, axis);
    result.values = {plane.larger * scale, plane.smaller * scale, dot(axis, times(m, axis)) * scale};
    result.directions = {plane.larger_direction, plane.smaller_direction, axis};
  }
  return result;
}

double energy_release_rate(const PrincipalStrains& principal, const ElasticConstants& elastic) {
  double trace = 0, square = 0;
  for (const double value : principal.values) {
    const double positive = std::max(value, 0.0);
    trace += positive;
    square += positive * positive;
  }
  return 0.5 * elastic.lambda() * trace * trace + elastic.mu() * square;
}

double energy_release_rate(const Voigt& strain, const ElasticConstants& elastic) {
  return energy_release_rate(principal_strains(strain), elastic);
}

Voigt energy_release_rate_derivative(const PrincipalStrains& principal, const ElasticConstants& elastic) {
  double trace = 0;
  for (const double value : principal.values) trace += std::max(value, 0.0);
  Voigt result{};
  for (int i = 0; i < 3; ++i) {
    if (principal.values[i] <= 0) continue;
    const double factor = elastic.lambda() * trace + 2 * elastic.mu() * principal.values[i];
    const Vector3& n = principal.directions[i];
    result[0] += factor * n[0] * n[0];
    result[1] += factor * n[1] * n[1];
    result[2] += factor * n[2] * n[2];
    // dY = T : dε counts a shear component twice, engineering shear is twice the tensor's: the factors
    // cancel.
    result[3] += factor * n[0] * n[1];
    result[4] += factor * n[1] * n[2];
    result[5] += factor * n[2] * n[0];
  }
  return result;
}

double damage(double energy_release_rate, const DamageParameters& parameters) {
  const double excess = parameters.brittleness * (energy_release_rate - parameters.threshold);
  return excess > 0 ? excess / (1 + excess) : 0.0;
}

namespace {

/// `band_damage` of the exponential law.
BandDamage exponential_damage(double rate, const DamageParameters& parameters, double r) {
  if (!(rate > parameters.threshold) || !(parameters.threshold > 0)) return {};
  const double s = std::sqrt(rate / parameters.threshold);
  const double q = parameters.brittleness * parameters.threshold / r;
  // s - x - exp(-q x) is concave and falls (q < 1): Newton's method from x = s, beyond the root, is monotone.
  double x = s;
  for (int i = 0; i < 100; ++i) {
    const double stress = std::exp(-q * x);
    const double next = x + (s - x - stress) / (1 - q * stress);
    const double change = x - next;
    x = next;
    if (!(change > 4e-16 * s)) break;
  }
  x = std::clamp(x, s - 1, s);
  const double growth = 1 / (1 - q * std::exp(-q * x));  // dx/ds
  return {x / s, (growth - x / s) / s / (2 * s * parameters.threshold)};
}

/// Stress / f_t = at_0 - fall v, v = f_t w / G_f, up to v = end.
struct SofteningLine {
  double at_0, fall, end;
};
constexpr SofteningLine k_petersson[] = {{1, 5.0 / 6, 0.8}, {3.0 / 7, 5.0 / 42, 3.6}};

/// `band_damage` of a law of straight lines: the root of s - x = at_0 - fall q x, of the line on which it
/// lies.
template <const auto& lines>
BandDamage straight_damage(double rate, const DamageParameters& parameters, double r) {
  constexpr double k_max_damage = 1 - 1e-9;  // an element that bears nothing has no stiffness either
  if (!(rate > parameters.threshold) || !(parameters.threshold > 0)) return {};
  const double s = std::sqrt(rate / parameters.threshold);
  const double q = parameters.brittleness * parameters.threshold / r;
  for (const SofteningLine& line : lines) {
    const double growth = 1 / (1 - line.fall * q), x = (s - line.at_0) * growth;  // growth: dx/ds
    if (q * x > line.end || x > k_max_damage * s) continue;
    return {x / s, (growth - x / s) / s / (2 * s * parameters.threshold)};
  }
  return {k_max_damage, 0};
}

/// A law of stress against opening: its `band_damage`, and -d(stress / f_t) / dv where the crack begins.
struct OpeningLaw {
  SofteningLaw law;
  BandDamage (*damage)(double rate, const DamageParameters& parameters, double r);
  double first_fall;
};
constexpr OpeningLaw k_opening_laws[] = {
    {SofteningLaw::exponential, exponential_damage, 1},
    {SofteningLaw::bilinear, straight_damage<k_petersson>, k_petersson[0].fall},
};

/// Null for the brittle law.
const OpeningLaw* opening_law(SofteningLaw law) {
  for (const OpeningLaw& known : k_opening_laws)
    if (known.law == law) return &known;
  return nullptr;
}

}  // namespace

BandDamage band_damage(double rate, const DamageParameters& parameters, double r) {
  if (const OpeningLaw* law = opening_law(parameters.law)) return law->damage(rate, parameters, r);
  const double first = parameters.brittleness * (rate - parameters.threshold);
  if (!(first > 0)) return {};
  if (r == 1) {
    const double d = first / (1 + first);
    return {d, parameters.brittleness * (1 - d) * (1 - d)};
  }
  // With a = A_d (s² Y - Y₀), d = a / (1 + a): s = (1 + a) / (1 + r a), D = r a / (1 + r a), and a is the
  // root of f(a) = a + A_d Y₀ - A_d Y s². s lies between 1 and 1 / r, which brackets a; f grows
  // (smallest_band_ratio).
  const double b = parameters.brittleness * parameters.threshold, y = parameters.brittleness * rate;
  const double last = std::max(y / (r * r) - b, 0.0);
  double low = std::min(first, last), high = std::max(first, last);
  double a = r > 1 ? low : high;
  for (int i = 0; i < 100; ++i) {
    const double s = (1 + a) / (1 + r * a);
    const double f = a + b - y * s * s;
    (f < 0 ? low : high) = a;
    const double slope = 1 + 2 * y * s * (r - 1) / ((1 + r * a) * (1 + r * a));
    double next = a - f / slope;
    if (!(next >= low && next <= high)) next = 0.5 * (low + high);
    const double change = std::abs(next - a);
    a = next;
    if (change <= 4e-16 * (1 + a)) break;
  }
  const double scale = 1 / (1 + r * a), s = (1 + a) * scale;
  return {r * a * scale,
          r * scale * scale * parameters.brittleness * s * s / (1 + 2 * y * s * (r - 1) * scale * scale)};
}

double smallest_band_ratio(const DamageParameters& parameters) {
  // g(a) = d(d ε_r)/dε_r = (a² + 3 a + 2 b) / (1 + a)², a = A_d (Y - Y₀), b = A_d Y₀; largest at a = 3 - 4 b.
  const double b = parameters.brittleness * parameters.threshold;
  if (const OpeningLaw* law = opening_law(parameters.law)) return law->first_fall * b;
  const double a = std::max(3 - 4 * b, 0.0);
  return 1 - (1 + a) * (1 + a) / (a * a + 3 * a + 2 * b);
}

MaterialResponse respond(const Voigt& strain, double previous_damage, const ElasticConstants& elastic,
                         const DamageParameters& parameters, double band_ratio) {
  const double lambda = elastic.lambda(), mu = elastic.mu();
  const PrincipalStrains principal = principal_strains(strain);
  const BandDamage current = band_damage(energy_release_rate(principal, elastic), parameters, band_ratio);
  MaterialResponse response;
  response.growing = current.damage > previous_damage;
  response.damage = response.growing ? current.damage : previous_damage;
  const double intact = 1 - response.damage;
  const Voigt effective = elastic_stress(strain, lambda, mu);
  for (int i = 0; i < 6; ++i) response.stress[i] = intact * effective[i];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) response.tangent[6 * i + j] = intact * (lambda + (i == j ? 2 * mu : 0.0));
    response.tangent[6 * (i + 3) + i + 3] = intact * mu;
  }
  if (response.growing) {
    const Voigt derivative = energy_release_rate_derivative(principal, elastic);
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j) response.tangent[6 * i + j] -= current.slope * effective[i] * derivative[j];
  }
  return response;
}

}  // namespace knothe::offline
