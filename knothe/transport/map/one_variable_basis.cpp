#include "knothe/transport/map/one_variable_basis.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "knothe/numerics/integrate/hermite.hpp"
#include "knothe/numerics/integrate/quadrature.hpp"

namespace knothe::transport {

namespace {

using Values = OneVariableBasis::Values;
using Piece = OneVariableBasis::Piece;

constexpr double k_infinity = std::numeric_limits<double>::infinity();

void polynomials(double x, int n, Values& value, Values& first, Values& second) {
  const double inside = std::clamp(x, -k_polynomial_limit, k_polynomial_limit);
  numerics::normalised_hermite(inside, std::span<double>(value.data(), static_cast<std::size_t>(n) + 1));
  for (int j = 0; j <= n; ++j) {
    const auto i = static_cast<std::size_t>(j);
    first[i] = j >= 1 && inside == x ? std::sqrt(j) * value[i - 1] : 0;
    second[i] = j >= 2 && inside == x ? std::sqrt(j * (j - 1.0)) * value[i - 2] : 0;
  }
}

/// φ_j = ĥ_m e^{−x²/4}, m = j − 2:  φ' = (√m ĥ_{m−1} − x/2 ĥ_m) e^{−x²/4},
/// φ'' = (√(m(m−1)) ĥ_{m−2} − x √m ĥ_{m−1} + (x²/4 − ½) ĥ_m) e^{−x²/4}.
void hermite_functions(double x, int n, Values& value, Values& first, Values& second) {
  Values h{};
  const bool decayed = std::abs(x) > k_hermite_functions_end;
  if (!decayed && n >= 2)
    numerics::normalised_hermite(x, std::span<double>(h.data(), static_cast<std::size_t>(n) - 1));
  const double decay = decayed ? 0 : std::exp(-0.25 * x * x), q = decayed ? 0 : 0.25 * x * x - 0.5;
  value[0] = 1, first[0] = 0, second[0] = 0;
  if (n >= 1) value[1] = x, first[1] = 1, second[1] = 0;
  for (int j = 2; j <= n; ++j) {
    const auto i = static_cast<std::size_t>(j), m = i - 2;
    const double lower = j >= 3 ? std::sqrt(j - 2.0) * h[m - 1] : 0;
    const double lowest = j >= 4 ? std::sqrt((j - 2.0) * (j - 3.0)) * h[m - 2] : 0;
    value[i] = h[m] * decay;
    first[i] = decayed ? 0 : (lower - 0.5 * x * h[m]) * decay;
    second[i] = decayed ? 0 : (lowest - x * lower + q * h[m]) * decay;
  }
}

/// Stretches of doubling length, after which the functions are straight lines on a scale of which nobody
/// asks: the rule there is not accurate but positive.
void append_doubling(std::vector<Piece>& pieces, double from, double length, int nodes) {
  constexpr int k_stretches = 8;
  for (int k = 0; k < k_stretches; ++k, length *= 2) pieces.push_back({from += length, nodes});
  pieces.push_back({k_infinity, nodes});
}

std::vector<Piece> make_pieces(const Parametrisation& p, int n) {
  const bool square = p.rectifier == Rectifier::square, hermite = p.basis == BasisFamily::hermite;
  const TailRadii& r = p.radii;
  // h² has degree 2n, on the bend 4n. Otherwise as measured, at unit length of a piece and more for longer
  // ones.
  const auto smooth = [&](double length) {
    return std::min(k_max_piece_nodes, 12 + static_cast<int>(std::ceil(length * (4 + 0.5 * n))));
  };
  const int exact = n + 1;
  if (p.tails == Tails::bent) {
    const double end = r.level + 2 * r.bend;
    if (square && hermite) return {{r.level, exact}, {end, 2 * n + 1}, {k_infinity, 1}};
    return {{r.level, smooth(r.level)}, {end, smooth(2 * r.bend)}, {k_infinity, 1}};
  }
  std::vector<Piece> pieces;
  if (hermite && square) {
    if (p.tails == Tails::polynomial) return {{k_polynomial_limit, exact}, {k_infinity, 1}};
    return {{r.tangent, exact}, {k_infinity, 2}};
  }
  if (hermite && p.tails == Tails::tangent) {
    pieces.push_back({r.tangent, smooth(r.tangent)});
    append_doubling(pieces, r.tangent, 2, smooth(2));
    return pieces;
  }
  for (int k = 1; k <= 8; ++k) pieces.push_back({2.0 * k, smooth(2)});
  if (square)
    pieces.push_back({k_infinity, 2});  // h is a straight line
  else
    append_doubling(pieces, 16, 4, smooth(2));
  return pieces;
}

}  // namespace

const UnitRule& unit_rule(int points) {
  static const std::vector<UnitRule> rules = [] {
    std::vector<UnitRule> made(1);
    for (int n = 1; n <= k_max_piece_nodes; ++n) {
      const numerics::Quadrature rule = numerics::gauss_legendre(n, 0, 1);
      made.push_back({{rule.nodes.begin(), rule.nodes.end()}, {rule.weights.begin(), rule.weights.end()}});
    }
    return made;
  }();
  assert(points >= 1 && points <= k_max_piece_nodes);
  return rules[static_cast<std::size_t>(points)];
}

OneVariableBasis::OneVariableBasis(const Parametrisation& parametrisation)
    : parametrisation_(parametrisation), hermite_(parametrisation.radii) {
  for (int n = 0; n <= k_max_order; ++n)
    pieces_[static_cast<std::size_t>(n)] = make_pieces(parametrisation_, n);
}

void OneVariableBasis::constant(double x, int n, Values& value, Values& first, Values& second) const {
  if (parametrisation_.basis == BasisFamily::hermite_functions)
    hermite_functions(x, n, value, first, second);
  else if (parametrisation_.tails == Tails::polynomial)
    polynomials(x, n, value, first, second);
  else
    hermite_.tangent(x, n, value, first, second);
}

void OneVariableBasis::monotone(double x, int n, Values& value) const {
  if (parametrisation_.tails == Tails::bent && parametrisation_.basis == BasisFamily::hermite)
    return hermite_.level(x, n, value);
  Values first, second;
  monotone(x, n, value, first, second);
}

void OneVariableBasis::monotone(double x, int n, Values& value, Values& first, Values& second) const {
  if (parametrisation_.tails != Tails::bent) {
    constant(x, n, value, first, second);
    return;
  }
  if (parametrisation_.basis == BasisFamily::hermite) {
    hermite_.level(x, n, value, first, second);
    return;
  }
  const BentCoordinate tau(x, parametrisation_.radii);
  hermite_functions(tau.value, n, value, first, second);
  for (std::size_t i = 0; i <= static_cast<std::size_t>(n); ++i) {
    second[i] = second[i] * tau.first * tau.first + first[i] * tau.second;
    first[i] *= tau.first;
  }
}

void OneVariableBasis::integration_rule(double x, int degree, IntegrationRule& rule) const {
  rule.node.clear();
  rule.weight.clear();
  const double sign = x < 0 ? -1 : 1, length = std::abs(x);
  double from = 0;
  for (const Piece& piece : pieces(degree)) {
    const double width = std::min(length, piece.end) - from;
    const UnitRule& unit = unit_rule(piece.nodes);
    for (std::size_t q = 0; q < unit.node.size(); ++q) {
      rule.node.push_back(sign * (from + width * unit.node[q]));
      rule.weight.push_back(sign * width * unit.weight[q]);
    }
    if (length <= piece.end) break;
    from = piece.end;
  }
}

}  // namespace knothe::transport
