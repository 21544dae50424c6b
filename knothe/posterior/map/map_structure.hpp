#pragma once
/// @file Everything about a triangular map that its coefficients do not change; copies of a map share it.
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/one_variable_basis.hpp"

namespace knothe::posterior {

/// The two bases of one component.
struct MapComponent {
  std::vector<MultiIndex> constant;  ///< Φ_c, in variables 0 … k−2 (counted from 0)
  std::vector<MultiIndex> monotone;  ///< Φ_e, in variables 0 … k−1
  Index offset = 0;                  ///< of a_c in the map's coefficients; a_e follows
  int degree = 0;                    ///< highest degree in Φ_e of the component's own variable
  [[nodiscard]] Index constant_count() const { return std::ssize(constant); }
  [[nodiscard]] Index monotone_count() const { return std::ssize(monotone); }
};

struct MapStructure {
  OneVariableBasis basis;
  std::vector<MapComponent> components;
  std::vector<int> constant_degree;  ///< per variable, its highest degree in any Φ_c
  std::vector<int> monotone_degree;  ///< and in any Φ_e
  int order = 0;                     ///< MapSpecification::order()
  Index coefficient_count = 0;

  /// Errors: those of TriangularMap(MapSpecification).
  explicit MapStructure(MapSpecification specification);
  [[nodiscard]] Index dimension() const { return std::ssize(components); }
};

}  // namespace knothe::posterior
