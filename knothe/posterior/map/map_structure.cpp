#include "knothe/posterior/map/map_structure.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::posterior {

namespace {

/// Refuses what cannot be a set of one component; `variables` are those it may have.
void check_set(std::vector<MultiIndex>& set, const char* name, std::size_t component, int variables) {
  std::set<std::vector<MultiIndex::Factor>> known;
  const auto where = [&] { return fmt::format("triangular map, {} of component {}", name, component); };
  for (MultiIndex& index : set) {
    index.total = 0;
    int last = -1;
    for (const auto& [variable, degree] : index.factors) {
      if (variable <= last || degree < 1)
        throw UsageError(where() +
                         ": factors of an index must have increasing variables and degrees of at least 1");
      if (variable >= variables)
        throw UsageError(fmt::format("{}: an index contains variable {}; only those below {} may be there",
                                     where(), variable, variables));
      if (degree > k_max_order)
        throw UsageError(fmt::format("{}: degree {} of variable {}; at most {} is possible", where(), degree,
                                     variable, k_max_order));
      last = variable;
      index.total += degree;
    }
    if (!known.insert(index.factors).second) throw UsageError(where() + ": an index occurs twice");
  }
  if (!known.contains({})) throw UsageError(where() + ": the empty index (the constant 1) is missing");
}

}  // namespace

MapStructure::MapStructure(MapSpecification specification) : basis(specification.parametrisation) {
  const TailRadii& radii = specification.parametrisation.radii;
  if (specification.components.empty())
    throw UsageError("triangular map in 0 dimensions: at least 1 is needed");
  if (!(radii.level > 0 && radii.bend > 0 && radii.tangent > 0 && radii.level + 2 * radii.bend < 1e6 &&
        radii.tangent < 1e6))
    throw UsageError("triangular map: the radii of the tails must be positive (and below 1e6)");
  constant_degree.assign(specification.components.size(), 0);
  monotone_degree.assign(specification.components.size(), 0);
  for (Index k = 0; k < std::ssize(specification.components); ++k) {
    auto& [constant, monotone] = specification.components[k];
    check_set(constant, "Φ_c", k, k);
    check_set(monotone, "Φ_e", k, k + 1);
    MapComponent component{std::move(constant), std::move(monotone), coefficient_count, 0};
    const auto raise = [](std::vector<int>& degrees, const std::vector<MultiIndex>& set) {
      for (const MultiIndex& index : set)
        for (const auto& f : index.factors) {
          int& degree = degrees[f.variable];
          degree = std::max(degree, f.degree);
        }
    };
    raise(constant_degree, component.constant);
    raise(monotone_degree, component.monotone);
    for (const MultiIndex& index : component.monotone)
      component.degree = std::max(component.degree, index.degree_of(k));
    for (const MultiIndex& index : component.constant) order = std::max(order, index.total);
    for (const MultiIndex& index : component.monotone) order = std::max(order, index.total + 1);
    coefficient_count += component.constant_count() + component.monotone_count();
    components.push_back(std::move(component));
  }
}

}  // namespace knothe::posterior
