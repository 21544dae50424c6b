#pragma once
/// @file Which products of one-variable functions a map needs, and from which shorter one each is made.
#include <vector>

#include "knothe/posterior/map/multi_index.hpp"

namespace knothe::posterior {

/// Products of functions of several variables, sorted by their last variable, each made from a shorter one.
struct ProductTree {
  struct Product {
    int parent;  ///< −1: this is the constant 1, the first one
    int variable, degree;
  };
  std::vector<Product> products;
  std::vector<int> begin;  ///< per variable v: the first product whose last variable is v
  std::vector<std::vector<int>>
      of_index;  ///< [k][m]: the product over variables < k of index m of component k

  ProductTree() = default;
  /// `sets[k]`: the indices of component k, of which the factors below k count.
  explicit ProductTree(const std::vector<const std::vector<MultiIndex>*>& sets);
};

}  // namespace knothe::posterior
