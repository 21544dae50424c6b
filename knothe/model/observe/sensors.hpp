#pragma once
/// @file What a structure is measured with.
#include <string>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"

namespace knothe::model {

/// Displacement components at points, then scalar series (forces, gauges): a datum has a value for each, in
/// this order.
struct Sensors : Dofs {
  std::vector<std::string> scalars;  ///< names; their values stand behind the displacements
  std::vector<std::string> names;    ///< of the displacements' sensors, where the data name them; else empty

  Sensors() = default;
  explicit Sensors(Dofs displacements, std::vector<std::string> series = {})
      : Dofs(std::move(displacements)), scalars(std::move(series)) {}

  [[nodiscard]] std::size_t displacement_count() const { return components.size(); }
  /// Of displacement `i`: the name that the data give it, else direction and number, "y3".
  [[nodiscard]] std::string label(std::size_t i) const {
    return names.size() == components.size() ? names[i] : "xyz"[components[i]] + std::to_string(i);
  }
  [[nodiscard]] std::size_t size() const { return components.size() + scalars.size(); }
};

}  // namespace knothe::model
