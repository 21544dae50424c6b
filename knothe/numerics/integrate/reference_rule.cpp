#include "knothe/numerics/integrate/reference_rule.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/halton.hpp"
#include "knothe/numerics/integrate/smolyak.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::numerics {

std::string_view name_of(ReferenceRuleKind kind) {
  switch (kind) {
    case ReferenceRuleKind::tensor_gauss_hermite:
      return "tensor Gauss-Hermite";
    case ReferenceRuleKind::smolyak:
      return "Smolyak";
    case ReferenceRuleKind::sobol:
      return "Sobol";
    case ReferenceRuleKind::halton:
      return "Halton";
    case ReferenceRuleKind::monte_carlo:
      return "Monte Carlo";
  }
  return "";
}

namespace {

PointRule equal_weights(Eigen::MatrixXd points, bool match_moments) {
  if (match_moments) match_standard_moments(points);
  const Eigen::Index n = points.rows();
  return {std::move(points), Eigen::VectorXd::Constant(n, 1.0 / static_cast<double>(n))};
}

PointRule tensor_gauss_hermite(const ReferenceRule& rule, Eigen::Index d) {
  const Quadrature one = gauss_hermite(rule.nodes);
  if (static_cast<double>(d) * std::log(rule.nodes) > std::log(2e7))
    throw UsageError(fmt::format(
        "tensor Gauss-Hermite rule of {} nodes per variable in {} dimensions: more than 20,000,000 "
        "points; use a Smolyak or Sobol rule",
        rule.nodes, d));
  return tensor_rule(one, d, rule.drop);
}

}  // namespace

PointRule reference_rule(const ReferenceRule& rule, Eigen::Index d) {
  if (d < 1)
    throw UsageError(fmt::format("{} rule in {} dimensions: at least 1 is needed", name_of(rule.kind), d));
  if (rule.kind == ReferenceRuleKind::tensor_gauss_hermite) return tensor_gauss_hermite(rule, d);
  if (rule.kind == ReferenceRuleKind::smolyak) return smolyak_rule(d, rule.level);
  if (rule.points < 1)
    throw UsageError(
        fmt::format("{} rule of {} points: at least 1 is needed", name_of(rule.kind), rule.points));
  if (rule.kind == ReferenceRuleKind::sobol)
    return equal_weights(sobol_normal_points(rule.points, d, rule.seed), rule.match_moments);
  if (rule.kind == ReferenceRuleKind::halton)
    return equal_weights(halton_normal_points(rule.points, d, rule.seed), rule.match_moments);
  return equal_weights(monte_carlo_normal_points(rule.points, d, rule.seed), rule.match_moments);
}

}  // namespace knothe::numerics
