#include "knothe/posterior/map/tailed_hermite.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/numerics/integrate/hermite.hpp"
#include "knothe/numerics/integrate/quadrature.hpp"

namespace knothe::posterior {

namespace {

/// Gauss–Legendre rules on [0, 1] with 1, 2, … points, made once.
const std::vector<numerics::Quadrature>& unit_rules() {
  static const std::vector<numerics::Quadrature> rules = [] {
    std::vector<numerics::Quadrature> made;
    for (int n = 1; n <= 2 * k_max_order + 2; ++n) made.push_back(numerics::gauss_legendre(n, 0, 1));
    return made;
  }();
  return rules;
}

/// ĥ and its first two derivatives at x.
void hermite(double x, int n, TailedHermite::Values& value, TailedHermite::Values& first,
             TailedHermite::Values& second) {
  struct Roots {
    TailedHermite::Values of_degree{}, of_two{};  ///< √j, √(j (j − 1))
  };
  static const Roots roots = [] {
    Roots made;
    for (Index j = 1; j < std::ssize(made.of_degree); ++j) {
      const double degree = j;
      made.of_degree[j] = std::sqrt(degree), made.of_two[j] = std::sqrt(degree * (degree - 1));
    }
    return made;
  }();
  numerics::normalised_hermite(x, std::span<double>(value.data(), n + 1));
  for (Index i = 0; i <= n; ++i) {
    first[i] = i >= 1 ? roots.of_degree[i] * value[i - 1] : 0;
    second[i] = i >= 2 ? roots.of_two[i] * value[i - 2] : 0;
  }
}

}  // namespace

BentCoordinate::BentCoordinate(double x, const TailRadii& r) {
  const double sign = x < 0 ? -1 : 1, over = std::abs(x) - r.level;
  if (over <= 0) {
    value = x, first = 1, second = 0;
  } else if (over < 2 * r.bend) {
    value = sign * (r.level + over - over * over / (4 * r.bend));
    first = 1 - over / (2 * r.bend);
    second = -sign / (2 * r.bend);
  } else {
    value = sign * (r.level + r.bend), first = 0, second = 0;
  }
}

void TailedHermite::tangent(double x, int n, Values& value, Values& first, Values& second) const {
  const double inside = std::clamp(x, -radii_.tangent, radii_.tangent), beyond = x - inside;
  hermite(inside, n, value, first, second);
  if (beyond == 0) return;
  for (Index i = 0; i <= n; ++i) {
    value[i] += beyond * first[i];
    second[i] = 0;
  }
}

void TailedHermite::level(double x, int n, Values& value, Values& first, Values& second) const {
  const BentCoordinate tau(x, radii_);
  hermite(tau.value, n, value, first, second);
  for (Index i = 0; i <= n; ++i) {
    second[i] = second[i] * tau.first * tau.first + first[i] * tau.second;
    first[i] *= tau.first;
  }
}

void TailedHermite::level(double x, int n, Values& value) const {
  const BentCoordinate tau(x, radii_);
  numerics::normalised_hermite(tau.value, std::span<double>(value.data(), n + 1));
}

SquareRule::SquareRule(double x, int n, const TailRadii& radii) {
  const double sign = x < 0 ? -1 : 1, length = std::abs(x);
  const auto add = [&](double from, double to, int points) {
    const auto& rule = unit_rules()[points - 1];
    for (int q = 0; q < points; ++q) {
      argument[count] = BentCoordinate(sign * (from + (to - from) * rule.nodes[q]), radii).value;
      weight[count++] = sign * (to - from) * rule.weights[q];
    }
  };
  const double end = radii.level + 2 * radii.bend;
  add(0, std::min(length, radii.level), n + 1);
  if (length > radii.level) add(radii.level, std::min(length, end), 2 * n + 1);
  if (length > end) {
    argument[count] = sign * (radii.level + radii.bend);
    weight[count++] = sign * (length - end);
  }
}

void TailedHermite::product_integrals(double x, int n, std::span<double> packed) const {
  std::fill(packed.begin(), packed.end(), 0.0);
  const SquareRule rule(x, n, radii_);
  Values value{};
  for (Index q = 0; q < rule.count; ++q) {
    numerics::normalised_hermite(rule.argument[q], std::span<double>(value.data(), n + 1));
    std::size_t at = 0;
    for (Index i = 0; i <= n; ++i)
      for (Index j = 0; j <= i; ++j) packed[at++] += rule.weight[q] * value[i] * value[j];
  }
}

}  // namespace knothe::posterior
