#include "knothe/transport/map/parametrisation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"

namespace knothe::transport {

namespace {

void check(Eigen::Index d, int order) {
  if (d < 1) throw UsageError(fmt::format("triangular map in {} dimensions: at least 1 is needed", d));
  if (order < 1 || order > k_max_order)
    throw UsageError(fmt::format("triangular map of order {}: 1 to {} are possible", order, k_max_order));
}

/// A map whose sets for component k (from 0) are `constant(k)` and `monotone(k)`.
template <class Constant, class Monotone>
MapSpecification make(Eigen::Index d, const Parametrisation& parametrisation, const Constant& constant,
                      const Monotone& monotone) {
  MapSpecification map{parametrisation, {}};
  for (int k = 0; k < static_cast<int>(d); ++k) map.components.push_back({constant(k), monotone(k)});
  return map;
}

void unite_sets(std::vector<MultiIndex>& set, const std::vector<MultiIndex>& other) {
  std::set<std::vector<MultiIndex::Factor>> known;
  for (const MultiIndex& index : set) known.insert(index.factors);
  for (const MultiIndex& index : other)
    if (known.insert(index.factors).second) set.push_back(index);
}

/// The entry of `value` in a table of names, and back.
template <class Enum, std::size_t n>
std::string name_in(const std::array<std::pair<Enum, const char*>, n>& table, Enum value) {
  for (const auto& [entry, name] : table)
    if (entry == value) return name;
  throw UsageError(fmt::format("no name for choice {} of a map", static_cast<int>(value)));
}

template <class Enum, std::size_t n>
Enum value_in(const std::array<std::pair<Enum, const char*>, n>& table, const char* what,
              const std::string& name) {
  std::vector<std::string> names;
  std::string listed;
  for (const auto& [entry, known] : table) {
    if (name == known) return entry;
    names.emplace_back(known);
    listed += fmt::format("{}\"{}\"", listed.empty() ? "" : ", ", known);
  }
  throw UsageError(
      fmt::format("unknown {} \"{}\"{}; the choices are {}", what, name, did_you_mean(name, names), listed));
}

constexpr std::array<std::pair<Rectifier, const char*>, 3> k_rectifiers{
    {{Rectifier::square, "square"},
     {Rectifier::softplus, "softplus"},
     {Rectifier::exponential, "exponential"}}};
constexpr std::array<std::pair<BasisFamily, const char*>, 2> k_families{
    {{BasisFamily::hermite, "hermite"}, {BasisFamily::hermite_functions, "hermite_functions"}}};
constexpr std::array<std::pair<Tails, const char*>, 3> k_tails{
    {{Tails::bent, "bent"}, {Tails::tangent, "tangent"}, {Tails::polynomial, "polynomial"}}};

}  // namespace

Eigen::Index MapSpecification::coefficient_count() const {
  std::size_t count = 0;
  for (const ComponentIndices& c : components) count += c.constant.size() + c.monotone.size();
  return static_cast<Eigen::Index>(count);
}

int MapSpecification::order() const {
  int order = 0;
  for (const ComponentIndices& c : components) {
    for (const MultiIndex& index : c.constant) order = std::max(order, index.total);
    for (const MultiIndex& index : c.monotone) order = std::max(order, index.total + 1);
  }
  return order;
}

void MapSpecification::unite(const MapSpecification& other) {
  if (!(other.parametrisation == parametrisation))
    throw UsageError("uniting two maps: they differ in rectifier, basis, tails or radii");
  if (other.dimension() != dimension())
    throw UsageError(
        fmt::format("uniting two maps: one has {} dimensions, the other {}", dimension(), other.dimension()));
  for (std::size_t k = 0; k < components.size(); ++k) {
    unite_sets(components[k].constant, other.components[k].constant);
    unite_sets(components[k].monotone, other.components[k].monotone);
  }
}

MapSpecification total_order_map(Eigen::Index d, int order, Parametrisation parametrisation) {
  check(d, order);
  return make(
      d, parametrisation, [&](int k) { return total_order_indices(k, order); },
      [&](int k) { return total_order_indices(k + 1, order - 1); });
}

MapSpecification hyperbolic_cross_map(Eigen::Index d, int order, Parametrisation parametrisation) {
  check(d, order);
  return make(
      d, parametrisation, [&](int k) { return hyperbolic_cross_indices(k, order); },
      [&](int k) { return hyperbolic_cross_indices(k + 1, order - 1); });
}

MapSpecification per_variable_map(std::span<const int> orders, Parametrisation parametrisation) {
  const auto d = static_cast<Eigen::Index>(orders.size());
  if (d == 0) check(0, 1);
  std::vector<int> lower;
  for (const int order : orders) {
    check(d, order);
    lower.push_back(order - 1);
  }
  return make(
      d, parametrisation,
      [&](int k) { return anisotropic_indices(orders.first(static_cast<std::size_t>(k))); },
      [&](int k) {
        return anisotropic_indices(std::span<const int>(lower).first(static_cast<std::size_t>(k) + 1));
      });
}

MapSpecification diagonal_map(Eigen::Index d, int order, Parametrisation parametrisation) {
  check(d, order);
  return make(
      d, parametrisation, [](int) { return std::vector<MultiIndex>(1); },
      [&](int k) {
        std::vector<MultiIndex> powers(1);
        for (int degree = 1; degree < order; ++degree) powers.push_back({{{k, degree}}, degree});
        return powers;
      });
}

MapSpecification sparse_map(MapSpecification full, const Parents& parents) {
  if (parents.size() != full.components.size())
    throw UsageError(fmt::format("sparse map in {} dimensions: parents are given for {} components",
                                 full.components.size(), parents.size()));
  for (std::size_t k = 0; k < parents.size(); ++k) {
    for (const int parent : parents[k])
      if (parent < 0 || parent >= static_cast<int>(k))
        throw UsageError(fmt::format(
            "sparse map: {} cannot be a parent of component {} (only variables before it can)", parent, k));
    std::vector<int> allowed = parents[k];
    full.components[k].constant = restricted_to(full.components[k].constant, allowed);
    allowed.push_back(static_cast<int>(k));
    full.components[k].monotone = restricted_to(full.components[k].monotone, allowed);
  }
  return full;
}

Parents parents_by_elimination(Eigen::Index d, const std::vector<std::pair<int, int>>& edges) {
  if (d < 1) throw UsageError(fmt::format("graph of {} variables: at least 1 is needed", d));
  std::vector<std::set<int>> neighbours(static_cast<std::size_t>(d));
  const auto connect = [&](int a, int b) {
    neighbours[static_cast<std::size_t>(a)].insert(b);
    neighbours[static_cast<std::size_t>(b)].insert(a);
  };
  for (const auto& [a, b] : edges) {
    if (a < 0 || b < 0 || a >= d || b >= d || a == b)
      throw UsageError(
          fmt::format("graph of {} variables: ({}, {}) is no pair of two of them, counted from 0", d, a, b));
    connect(a, b);
  }
  Parents parents(static_cast<std::size_t>(d));
  for (std::size_t k = parents.size(); k-- > 0;) {
    for (const int neighbour : neighbours[k])
      if (neighbour < static_cast<int>(k)) parents[k].push_back(neighbour);
    for (const int a : parents[k])  // marginalising x_k couples its neighbours
      for (const int b : parents[k])
        if (a < b) connect(a, b);
  }
  return parents;
}

std::string to_string(Rectifier rectifier) {
  return name_in(k_rectifiers, rectifier);
}
Rectifier rectifier_from(const std::string& name) {
  return value_in(k_rectifiers, "rectifier", name);
}
std::string to_string(BasisFamily family) {
  return name_in(k_families, family);
}
BasisFamily basis_family_from(const std::string& name) {
  return value_in(k_families, "basis", name);
}
std::string to_string(Tails tails) {
  return name_in(k_tails, tails);
}
Tails tails_from(const std::string& name) {
  return value_in(k_tails, "tails", name);
}

}  // namespace knothe::transport
