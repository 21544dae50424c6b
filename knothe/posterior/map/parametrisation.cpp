#include "knothe/posterior/map/parametrisation.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/enum_names.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"

namespace knothe::posterior {

namespace {

void check(Index d, int order) {
  if (d < 1) throw UsageError(fmt::format("triangular map in {} dimensions: at least 1 is needed", d));
  if (order < 1 || order > k_max_order)
    throw UsageError(fmt::format("triangular map of order {}: 1 to {} are possible", order, k_max_order));
}

/// A map whose sets for component k (from 0) are `constant(k)` and `monotone(k)`.
template <class Constant, class Monotone>
MapSpecification make(Index d, const Parametrisation& parametrisation, const Constant& constant,
                      const Monotone& monotone) {
  MapSpecification map{parametrisation, {}};
  for (int k = 0; k < d; ++k) map.components.push_back({constant(k), monotone(k)});
  return map;
}

}  // namespace

Index MapSpecification::coefficient_count() const {
  std::size_t count = 0;
  for (const ComponentIndices& c : components) count += c.constant.size() + c.monotone.size();
  return count;
}

int MapSpecification::order() const {
  int order = 0;
  for (const ComponentIndices& c : components) {
    for (const MultiIndex& index : c.constant) order = std::max(order, index.total);
    for (const MultiIndex& index : c.monotone) order = std::max(order, index.total + 1);
  }
  return order;
}

MapSpecification total_order_map(Index d, int order, Parametrisation parametrisation) {
  check(d, order);
  return make(
      d, parametrisation, [&](int k) { return total_order_indices(k, order); },
      [&](int k) { return total_order_indices(k + 1, order - 1); });
}

MapSpecification per_variable_map(std::span<const int> orders, Parametrisation parametrisation) {
  const auto d = std::ssize(orders);
  if (d == 0) check(0, 1);
  std::vector<int> lower;
  for (const int order : orders) {
    check(d, order);
    lower.push_back(order - 1);
  }
  return make(
      d, parametrisation, [&](int k) { return anisotropic_indices(orders.first(k)); },
      [&](int k) { return anisotropic_indices(std::span<const int>(lower).first(k + 1)); });
}

MapSpecification sparse_map(MapSpecification full, const Parents& parents) {
  if (parents.size() != full.components.size())
    throw UsageError(fmt::format("sparse map in {} dimensions: parents are given for {} components",
                                 full.components.size(), parents.size()));
  for (Index k = 0; k < std::ssize(parents); ++k) {
    for (const int parent : parents[k])
      if (parent < 0 || parent >= k)
        throw UsageError(fmt::format(
            "sparse map: {} cannot be a parent of component {} (only variables before it can)", parent, k));
    std::vector<int> allowed = parents[k];
    full.components[k].constant = restricted_to(full.components[k].constant, allowed);
    allowed.push_back(k);
    full.components[k].monotone = restricted_to(full.components[k].monotone, allowed);
  }
  return full;
}

Rectifier rectifier_from(const std::string& name) {
  if (const auto known = from_text<Rectifier>(name)) return *known;
  const std::vector<std::string> words = words_of<Rectifier>();
  throw UsageError(fmt::format("unknown rectifier \"{}\"{}; the choices are \"{}\"", name,
                               did_you_mean(name, words), fmt::join(words, "\", \"")));
}

}  // namespace knothe::posterior
