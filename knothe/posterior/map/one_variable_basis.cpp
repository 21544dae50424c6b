#include "knothe/posterior/map/one_variable_basis.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"
#include "knothe/numerics/integrate/quadrature.hpp"

namespace knothe::posterior {

namespace {

using Piece = OneVariableBasis::Piece;

std::vector<Piece> make_pieces(const Parametrisation& p, int n) {
  const double end = p.radii.level + 2 * p.radii.bend, infinity = std::numeric_limits<double>::infinity();
  // h² has degree 2n, on the bend 4n.
  if (p.rectifier == Rectifier::square) return {{p.radii.level, n + 1}, {end, 2 * n + 1}, {infinity, 1}};
  // As measured, at unit length of a piece and more for longer ones.
  const auto smooth = [n](double length) {
    return std::min(k_max_piece_nodes, 12 + static_cast<int>(std::ceil(length * (4 + 0.5 * n))));
  };
  return {{p.radii.level, smooth(p.radii.level)}, {end, smooth(2 * p.radii.bend)}, {infinity, 1}};
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
  return rules[points];
}

OneVariableBasis::OneVariableBasis(const Parametrisation& parametrisation)
    : parametrisation_(parametrisation), hermite_(parametrisation.radii) {
  for (int n = 0; n <= k_max_order; ++n) pieces_[n] = make_pieces(parametrisation_, n);
}

void OneVariableBasis::integration_rule(double x, int degree, IntegrationRule& rule) const {
  rule.node.clear();
  rule.weight.clear();
  const double sign = x < 0 ? -1 : 1, length = std::abs(x);
  double from = 0;
  for (const Piece& piece : pieces(degree)) {
    const double width = std::min(length, piece.end) - from;
    const UnitRule& unit = unit_rule(piece.nodes);
    for (Index q = 0; q < std::ssize(unit.node); ++q) {
      rule.node.push_back(sign * (from + width * unit.node[q]));
      rule.weight.push_back(sign * width * unit.weight[q]);
    }
    if (length <= piece.end) break;
    from = piece.end;
  }
}

}  // namespace knothe::posterior
