#include "knothe/posterior/map/multi_index.hpp"

#include <algorithm>

namespace knothe::posterior {

namespace {

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

/// Appends all indices in the variables from `variable` on with Σ α_i / orders_i ≤ `budget`.
void append_affordable(std::span<const int> orders, std::size_t variable, double budget, MultiIndex& prefix,
                       std::vector<MultiIndex>& set) {
  if (variable == orders.size()) {
    set.push_back(prefix);
    return;
  }
  append_affordable(orders, variable + 1, budget, prefix, set);
  const int order = orders[variable];
  for (int degree = 1; order > 0; ++degree) {
    const double rest = budget - static_cast<double>(degree) / order;
    if (rest < 0) return;
    prefix.factors.push_back({static_cast<int>(variable), degree});
    prefix.total += degree;
    append_affordable(orders, variable + 1, rest, prefix, set);
    prefix.total -= degree;
    prefix.factors.pop_back();
  }
}

}  // namespace

std::vector<MultiIndex> total_order_indices(int variables, int order) {
  std::vector<MultiIndex> set;
  for (int total = 0; total <= order; ++total) {
    MultiIndex prefix;
    prefix.total = total;
    append(variables, 0, total, prefix, set);
  }
  return set;
}

std::vector<MultiIndex> anisotropic_indices(std::span<const int> orders) {
  constexpr double k_rounding = 1e-12;  // of sums like 1/3 + 2/3
  std::vector<MultiIndex> set;
  MultiIndex prefix;
  append_affordable(orders, 0, 1 + k_rounding, prefix, set);
  std::stable_sort(set.begin(), set.end(),
                   [](const MultiIndex& a, const MultiIndex& b) { return a.total < b.total; });
  return set;
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

}  // namespace knothe::posterior
