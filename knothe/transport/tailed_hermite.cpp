#include "knothe/transport/tailed_hermite.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "knothe/numerics/hermite.hpp"
#include "knothe/numerics/quadrature.hpp"
#include "knothe/transport/log_density.hpp"

namespace knothe::transport {

namespace {

/// Gauss–Legendre rules on [0, 1] with 1 … k_max_order + 1 points, made once.
const std::vector<numerics::Quadrature>& unit_rules() {
  static const std::vector<numerics::Quadrature> rules = [] {
    std::vector<numerics::Quadrature> made;
    for (int n = 1; n <= k_max_order + 1; ++n) made.push_back(numerics::gauss_legendre(n, 0, 1));
    return made;
  }();
  return rules;
}

/// 1/√k and √k: no divisions in the recursion.
const std::array<double, k_max_order + 2> k_root = [] {
  std::array<double, k_max_order + 2> root{};
  for (std::size_t k = 0; k < root.size(); ++k) root[k] = std::sqrt(static_cast<double>(k));
  return root;
}();

}  // namespace

TailedHermite::TailedHermite(double radius) : radius_(radius) {}

void TailedHermite::evaluate(double x, int n, Values& value) const {
  const double inside = std::clamp(x, -radius_, radius_), beyond = x - inside;
  const std::span<double> span(value.data(), static_cast<std::size_t>(n) + 1);
  numerics::normalised_hermite(inside, span);
  if (beyond != 0)
    for (int j = n; j >= 1; --j) {
      const auto i = static_cast<std::size_t>(j);
      value[i] += beyond * k_root[i] * value[i - 1];
    }
}

void TailedHermite::evaluate(double x, int n, Values& value, Values& first, Values& second) const {
  const double inside = std::clamp(x, -radius_, radius_), beyond = x - inside;
  numerics::normalised_hermite(inside, std::span<double>(value.data(), static_cast<std::size_t>(n) + 1));
  for (int j = 0; j <= n; ++j) {
    const auto i = static_cast<std::size_t>(j);
    first[i] = j >= 1 ? k_root[i] * value[i - 1] : 0;
    second[i] = j >= 2 && beyond == 0 ? k_root[i] * k_root[i - 1] * value[i - 2] : 0;
  }
  if (beyond != 0)
    for (int j = 0; j <= n; ++j)
      value[static_cast<std::size_t>(j)] += beyond * first[static_cast<std::size_t>(j)];
}

SquareRule::SquareRule(double x, int n, double radius) {
  const double inside = std::clamp(x, -radius, radius);
  const auto& rule = unit_rules()[static_cast<std::size_t>(n)];
  count = n + 1;
  for (int q = 0; q < count; ++q) {
    node[static_cast<std::size_t>(q)] = inside * rule.nodes[q];
    weight[static_cast<std::size_t>(q)] = inside * rule.weights[q];
  }
  kink = inside;
  length = x - inside;
}

void TailedHermite::product_integrals(double x, int n, std::span<double> packed) const {
  std::fill(packed.begin(), packed.end(), 0.0);
  const SquareRule rule(x, n, radius_);
  Values value{}, first{}, second{};
  for (int q = 0; q < rule.count; ++q) {
    evaluate(rule.node[static_cast<std::size_t>(q)], n, value);
    std::size_t at = 0;
    for (std::size_t i = 0; i <= static_cast<std::size_t>(n); ++i)
      for (std::size_t j = 0; j <= i; ++j)
        packed[at++] += rule.weight[static_cast<std::size_t>(q)] * value[i] * value[j];
  }
  if (rule.length == 0) return;
  evaluate(rule.kink, n, value, first, second);
  std::size_t at = 0;
  for (std::size_t i = 0; i <= static_cast<std::size_t>(n); ++i)
    for (std::size_t j = 0; j <= i; ++j) packed[at++] += rule.tail(value[i], first[i], value[j], first[j]);
}

}  // namespace knothe::transport
