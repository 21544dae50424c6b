#include "knothe/transport/multi_index.hpp"

namespace knothe::transport {

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

Eigen::Index total_order_count(int variables, int order) {
  Eigen::Index count = 1;
  for (int k = 1; k <= variables; ++k) count = count * (order + k) / k;
  return count;
}

}  // namespace knothe::transport
