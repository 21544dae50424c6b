#pragma once
/// @file Sets of multi-indices: which products of one-variable functions span a multivariate basis.
#include <Eigen/Core>
#include <vector>

namespace knothe::transport {

/// A multi-index, by what is not zero in it: the factors (variable, degree ≥ 1), variables increasing.
struct MultiIndex {
  struct Factor {
    int variable;
    int degree;
  };
  std::vector<Factor> factors;
  int total = 0;  ///< sum of the degrees

  [[nodiscard]] int degree_of(int variable) const {
    for (const Factor& f : factors)
      if (f.variable == variable) return f.degree;
    return 0;
  }
};

/// All multi-indices in `variables` ≥ 0 variables with sum of degrees ≤ `order`, by increasing sum: the set
/// of a lower order is the beginning of that of a higher one.
[[nodiscard]] std::vector<MultiIndex> total_order_indices(int variables, int order);

/// Their number, (variables + order)! / (variables! order!).
[[nodiscard]] Eigen::Index total_order_count(int variables, int order);

}  // namespace knothe::transport
