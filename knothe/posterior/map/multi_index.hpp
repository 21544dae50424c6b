#pragma once
/// @file Sets of multi-indices: which products of one-variable functions span a multivariate basis.
#include <Eigen/Core>
#include <span>
#include <vector>

namespace knothe::posterior {

/// A multi-index, by what is not zero in it: the factors (variable, degree ≥ 1), variables increasing.
struct MultiIndex {
  struct Factor {
    int variable;
    int degree;
    friend auto operator<=>(const Factor&, const Factor&) = default;
  };
  std::vector<Factor> factors;
  int total = 0;  ///< sum of the degrees

  [[nodiscard]] int degree_of(int variable) const {
    for (const Factor& f : factors)
      if (f.variable == variable) return f.degree;
    return 0;
  }
  friend bool operator==(const MultiIndex& a, const MultiIndex& b) { return a.factors == b.factors; }
};

/// All multi-indices in `variables` ≥ 0 variables with sum of degrees ≤ `order`, by increasing sum: the set
/// of a lower order is the beginning of that of a higher one.
[[nodiscard]] std::vector<MultiIndex> total_order_indices(int variables, int order);

/// Σ α_i / orders_i ≤ 1, one order per variable (0: the variable is absent): the total-order set, stretched.
/// By increasing sum.
[[nodiscard]] std::vector<MultiIndex> anisotropic_indices(std::span<const int> orders);

/// Those of `set` in which only the variables `allowed` occur.
[[nodiscard]] std::vector<MultiIndex> restricted_to(const std::vector<MultiIndex>& set,
                                                    std::span<const int> allowed);

}  // namespace knothe::posterior
