#pragma once
/// @file From a project file to the full-order problem.
#include <cstdint>
#include <memory>
#include <vector>

#include "knothe/model/compress/compression.hpp"
#include "knothe/offline/full_order/beam_simulator.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::offline {

/// Throws ProjectError if the project has no table [offline].
[[nodiscard]] BeamProblem beam_problem(const project::Project& project);

/// The parameter axes of the grid, in the order of [offline.parameters].
[[nodiscard]] std::vector<model::Axis> parameter_axes(const project::Project& project);
[[nodiscard]] std::vector<std::string> parameter_names(const project::Project& project);

/// Points of the box of `axes`, a scrambled Sobol sequence.
[[nodiscard]] std::vector<std::vector<double>> points_in_box(const std::vector<model::Axis>& axes, int count,
                                                             std::uint64_t seed);

/// The project's full-order model, at multiples of the references of `axes`. Errors: as beam_problem and
/// BeamSimulator.
[[nodiscard]] std::unique_ptr<model::Simulator> project_simulator(const project::Project& project,
                                                                  std::vector<model::Axis> axes);

}  // namespace knothe::offline
