#pragma once
/// @file Outputs of a model: by their names, and as functions of its parameters.
#include <span>
#include <string>
#include <vector>

#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/model/reduced/spline_functions.hpp"

namespace knothe::model {

/// The output of that name. UsageError, which says what there is, where the model has none.
[[nodiscard]] const SnapshotOutput& output_of(const SeparatedModel& model, const std::string& name);

/// Its values at the n_t times as n_t functions of the parameters.
[[nodiscard]] JointFunctions functions_of(const ModelContents& contents, const SnapshotOutput& output);

/// The nodes of each axis.
[[nodiscard]] std::vector<std::vector<double>> nodes_of(std::span<const Axis> axes);

}  // namespace knothe::model
