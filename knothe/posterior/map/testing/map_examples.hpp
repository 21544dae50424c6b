#pragma once
/// @file Maps known in closed form, for tests of what is done with maps.
#include <Eigen/Core>
#include <cmath>
#include <span>

#include "knothe/posterior/map/composed_map.hpp"

namespace knothe::posterior::examples {

/// A multi-index from its degrees, one per variable: {2, 0, 1} is x_0² x_2.
inline MultiIndex multi_index(std::span<const int> degrees) {
  MultiIndex index;
  for (std::size_t i = 0; i < degrees.size(); ++i) {
    if (degrees[i] > 0) index.factors.push_back({static_cast<int>(i), degrees[i]});
    index.total += degrees[i];
  }
  return index;
}

/// x ↦ (x_1, x_2 + b x_1²), exactly, to 20 standard deviations.
inline ComposedMap banana_map(double b) {
  TriangularMap map(2, 2, TailRadii{20, 0.5, 20});
  Eigen::VectorXd a = map.coefficients();
  const MapComponent& c = map.component(1);
  for (std::size_t i = 0; i < c.constant.size(); ++i) {  // x² = 1 + √2 ĥ_2(x)
    if (c.constant[i].total == 0) a[c.offset + static_cast<Eigen::Index>(i)] = b;
    if (c.constant[i].degree_of(0) == 2) a[c.offset + static_cast<Eigen::Index>(i)] = std::sqrt(2.0) * b;
  }
  map.set_coefficients(a);
  ComposedMap composed(2);
  composed.append(map);
  return composed;
}

/// Lower triangular, with a spread.
inline AffineMap skew_affine_map(Eigen::Index d) {
  AffineMap map = AffineMap::identity(d);
  for (Eigen::Index i = 0; i < d; ++i) {
    map.shift[i] = 0.5 * static_cast<double>(i) - 0.3;
    for (Eigen::Index j = 0; j < i; ++j) map.lower(i, j) = 0.4 / static_cast<double>(1 + i - j);
    map.lower(i, i) = 0.8 + 0.3 * static_cast<double>(i % 3);
  }
  return map;
}

}  // namespace knothe::posterior::examples
