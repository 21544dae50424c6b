#pragma once
/// @file `knothe simulate`: what the reduced and the full-order way have in common.
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/likelihood/data/synthetic_measurements.hpp"
#include "knothe/model/compress/snapshots.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

/// The true values in the order of `names`. Throws ProjectError where one is missing or unknown.
[[nodiscard]] std::vector<double> simulated_truth(const Project& project,
                                                  const std::vector<std::string>& names);

/// A warning for each parameter whose truth is outside its bounds under [offline.parameters].
[[nodiscard]] std::vector<std::string> truth_outside_box(const Project& project);

/// Displacements at time step `step` at the dofs asked for, m.
using DisplacementField =
    std::function<std::vector<double>(std::size_t step, std::span<const std::size_t> dofs)>;

/// What measurements are made of.
struct SimulatedField {
  const model::Dofs& dofs;
  const std::vector<model::Quantity>& quantities;  ///< instead of dofs
  const std::vector<double>& time;
  DisplacementField field;
};

/// The quantities that [simulate] noise names, as indices, with its standard deviations. ProjectError for one
/// that the model has not, or where it names none.
struct MeasuredQuantities {
  std::vector<std::size_t> dofs;
  std::vector<double> std;
};
[[nodiscard]] MeasuredQuantities measured_quantities(const Project& project,
                                                     const std::vector<model::Quantity>& quantities);

/// Chooses dofs, evaluates the field there at every time, adds noise, writes the measurement file with the
/// truth beside them.
void simulate_measurements(const Project& project, const SimulatedField& simulated,
                           std::optional<std::uint64_t> seed, const std::string& output);

}  // namespace knothe::project
