#include "knothe/posterior/map/product_tree.hpp"

#include <algorithm>
#include <map>

#include "knothe/base/index.hpp"

namespace knothe::posterior {

ProductTree::ProductTree(const std::vector<const std::vector<MultiIndex>*>& sets) {
  // Sorted by last variable, then by length, so that a product comes after the one it is made from.
  using Factors = std::vector<MultiIndex::Factor>;
  const auto before = [](const Factors& a, const Factors& b) {
    const int last_a = a.empty() ? -1 : a.back().variable, last_b = b.empty() ? -1 : b.back().variable;
    return last_a != last_b ? last_a < last_b : a < b;
  };
  std::map<Factors, int, decltype(before)> number(before);
  const auto prefix_of = [](const MultiIndex& index, Index k) {
    Factors factors = index.factors;
    while (!factors.empty() && factors.back().variable >= k) factors.pop_back();
    return factors;
  };
  for (Index k = 0; k < std::ssize(sets); ++k)
    for (const MultiIndex& index : *sets[k])
      for (Factors factors = prefix_of(index, k);; factors.pop_back()) {
        number[factors] = 0;
        if (factors.empty()) break;
      }
  begin.assign(sets.size() + 1, -1);
  for (auto& [factors, place] : number) {
    place = products.size();
    if (factors.empty()) {
      products.push_back({-1, -1, 0});
      continue;
    }
    const auto [variable, degree] = factors.back();
    Factors rest(factors.begin(), factors.end() - 1);
    products.push_back({number.at(rest), variable, degree});
  }
  for (Index v = 0; v <= std::ssize(sets); ++v)
    begin[v] = std::partition_point(products.begin(), products.end(),
                                    [&](const Product& p) { return p.variable < v; }) -
               products.begin();
  for (Index k = 0; k < std::ssize(sets); ++k) {
    of_index.emplace_back();
    for (const MultiIndex& index : *sets[k]) of_index[k].push_back(number.at(prefix_of(index, k)));
  }
}

}  // namespace knothe::posterior
