#include "knothe/transport/map/multi_index.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "knothe/base/error.hpp"

namespace knothe::transport {

namespace {

using Factors = std::vector<MultiIndex::Factor>;

/// Appends all indices of exact sum `remaining` in the variables from `variable` on to those begun in
/// `prefix`.
void append(int variables, int variable, int remaining, MultiIndex& prefix, std::vector<MultiIndex>& set) {
  if (remaining == 0) {
    set.push_back(prefix);
    return;
  }
  if (variable == variables) return;
  for (int degree = variable + 1 == variables ? remaining : 0; degree <= remaining; ++degree) {
    if (degree > 0) prefix.factors.push_back({variable, degree});
    append(variables, variable + 1, remaining - degree, prefix, set);
    if (degree > 0) prefix.factors.pop_back();
  }
}

/// Appends all indices in the variables from `variable` on whose degrees cost no more than `budget`, where
/// `left(variable, degree, budget)` is what remains of it, negative if too little.
template <class Left>
void append_affordable(int variables, int variable, double budget, const Left& left, MultiIndex& prefix,
                       std::vector<MultiIndex>& set) {
  if (variable == variables) {
    set.push_back(prefix);
    return;
  }
  append_affordable(variables, variable + 1, budget, left, prefix, set);
  for (int degree = 1;; ++degree) {
    const double rest = left(variable, degree, budget);
    if (rest < 0) return;
    prefix.factors.push_back({variable, degree});
    prefix.total += degree;
    append_affordable(variables, variable + 1, rest, left, prefix, set);
    prefix.total -= degree;
    prefix.factors.pop_back();
  }
}

template <class Left>
std::vector<MultiIndex> affordable_indices(int variables, double budget, const Left& left) {
  std::vector<MultiIndex> set;
  MultiIndex prefix;
  append_affordable(variables, 0, budget, left, prefix, set);
  std::stable_sort(set.begin(), set.end(),
                   [](const MultiIndex& a, const MultiIndex& b) { return a.total < b.total; });
  return set;
}

std::set<Factors> keys_of(const std::vector<MultiIndex>& set) {
  std::set<Factors> keys;
  for (const MultiIndex& index : set) keys.insert(index.factors);
  return keys;
}

/// The index with the degree of one of its factors lowered by one.
Factors lowered(const Factors& factors, std::size_t which) {
  Factors result = factors;
  if (--result[which].degree == 0) result.erase(result.begin() + static_cast<std::ptrdiff_t>(which));
  return result;
}

Factors raised(const Factors& factors, int variable) {
  Factors result = factors;
  const auto at = std::lower_bound(result.begin(), result.end(), variable,
                                   [](const MultiIndex::Factor& f, int v) { return f.variable < v; });
  if (at != result.end() && at->variable == variable)
    ++at->degree;
  else
    result.insert(at, {variable, 1});
  return result;
}

/// Whether all indices one step below are there.
bool has_all_below(const Factors& factors, const std::set<Factors>& keys) {
  for (std::size_t i = 0; i < factors.size(); ++i)
    if (!keys.contains(lowered(factors, i))) return false;
  return true;
}

}  // namespace

MultiIndex multi_index(std::span<const int> degrees) {
  MultiIndex index;
  for (std::size_t i = 0; i < degrees.size(); ++i) {
    if (degrees[i] < 0)
      throw UsageError(fmt::format("multi-index: degree {} of variable {} is negative", degrees[i], i));
    if (degrees[i] > 0) index.factors.push_back({static_cast<int>(i), degrees[i]});
    index.total += degrees[i];
  }
  return index;
}

std::vector<MultiIndex> total_order_indices(int variables, int order) {
  std::vector<MultiIndex> set;
  for (int total = 0; total <= order; ++total) {
    MultiIndex prefix;
    prefix.total = total;
    append(variables, 0, total, prefix, set);
  }
  return set;
}

std::vector<MultiIndex> hyperbolic_cross_indices(int variables, int order) {
  // Π (α_i + 1) ≤ order + 1 with whole numbers: a factor α + 1 leaves ⌊budget / (α + 1)⌋.
  return affordable_indices(variables, order + 1, [](int, int degree, double budget) {
    return budget < degree + 1 ? -1.0 : static_cast<double>(static_cast<int>(budget) / (degree + 1));
  });
}

std::vector<MultiIndex> anisotropic_indices(std::span<const int> orders) {
  constexpr double k_rounding = 1e-12;  // of sums like 1/3 + 2/3
  return affordable_indices(static_cast<int>(orders.size()), 1 + k_rounding,
                            [orders](int variable, int degree, double budget) {
                              const int order = orders[static_cast<std::size_t>(variable)];
                              return order <= 0 ? -1.0 : budget - static_cast<double>(degree) / order;
                            });
}

std::vector<MultiIndex> restricted_to(const std::vector<MultiIndex>& set, std::span<const int> allowed) {
  std::vector<MultiIndex> kept;
  for (const MultiIndex& index : set)
    if (std::all_of(index.factors.begin(), index.factors.end(), [&](const MultiIndex::Factor& f) {
          return std::find(allowed.begin(), allowed.end(), f.variable) != allowed.end();
        }))
      kept.push_back(index);
  return kept;
}

std::vector<MultiIndex> reduced_margin(const std::vector<MultiIndex>& set, int variables) {
  if (set.empty()) return {MultiIndex{}};
  const std::set<Factors> keys = keys_of(set);
  std::set<Factors> seen;
  std::vector<MultiIndex> margin;
  for (const MultiIndex& index : set)
    for (int v = 0; v < variables; ++v) {
      Factors candidate = raised(index.factors, v);
      if (keys.contains(candidate) || !has_all_below(candidate, keys) || !seen.insert(candidate).second)
        continue;
      margin.push_back({std::move(candidate), index.total + 1});
    }
  return margin;
}

bool is_downward_closed(const std::vector<MultiIndex>& set) {
  const std::set<Factors> keys = keys_of(set);
  return std::all_of(keys.begin(), keys.end(),
                     [&](const Factors& factors) { return has_all_below(factors, keys); });
}

}  // namespace knothe::transport
