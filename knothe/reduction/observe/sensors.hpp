#pragma once
/// @file What a structure is measured with.
#include <string>
#include <vector>

#include "knothe/reduction/compress/snapshots.hpp"

namespace knothe::reduction {

/// Displacement components at points, then scalar series (forces, gauges): a datum has a value for each, in
/// this order.
struct Sensors : Dofs {
  std::vector<std::string> scalars;  ///< names; their values stand behind the displacements

  Sensors() = default;
  explicit Sensors(Dofs displacements, std::vector<std::string> names = {})
      : Dofs(std::move(displacements)), scalars(std::move(names)) {}

  [[nodiscard]] std::size_t displacement_count() const { return components.size(); }
  [[nodiscard]] std::size_t size() const { return components.size() + scalars.size(); }
};

}  // namespace knothe::reduction
