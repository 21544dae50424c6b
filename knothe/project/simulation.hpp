#pragma once
/// @file `knothe simulate`: what the reduced and the full-order way have in common.
#include <functional>
#include <map>
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

/// What measurements are made of: a model at the truth.
struct SimulatedField {
  const model::Dofs& dofs;
  const std::vector<model::Quantity>& quantities;  ///< instead of dofs
  const std::vector<double>& time;
  DisplacementField field;
  std::vector<model::SnapshotOutput> outputs;  ///< a value for each time
};

/// Those of `names` that [simulate] noise names, as indices, with its standard deviations. ProjectError for
/// one that is not among them.
struct MeasuredQuantities {
  std::vector<std::size_t> dofs;
  std::vector<double> std;
};
[[nodiscard]] MeasuredQuantities measured_quantities(const Project& project,
                                                     const std::vector<std::string>& names);
/// Of a model without a place; ProjectError where [simulate] names none.
[[nodiscard]] MeasuredQuantities measured_quantities(const Project& project,
                                                     const std::vector<model::Quantity>& quantities);

/// The outputs that [simulate] noise names, with noise.
[[nodiscard]] std::map<std::string, likelihood::MeasuredSeries> simulated_series(
    const Project& project, const SimulatedField& simulated, std::uint64_t seed);

/// Chooses dofs, evaluates the field there at every time, adds noise, writes the measurement file with the
/// truth beside them, and the outputs that are measured.
void simulate_measurements(const Project& project, const SimulatedField& simulated,
                           std::optional<std::uint64_t> seed, const std::string& output);

}  // namespace knothe::project
