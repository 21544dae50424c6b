#pragma once
/// @file From a project file to the candidates of a data selection.
#include <vector>

#include "knothe/assimilation/select/selection_study.hpp"
#include "knothe/model/observe/sensors.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

struct SelectionSetup {
  model::SeparatedModel model;
  std::vector<std::size_t> candidates;  ///< their indices in the data file or in the model
  bool from_data = false;
  model::Sensors sensors;                ///< the candidates
  model::ObservedModel observed, whole;  ///< at the measured steps, and at all of the model
  likelihood::NoiseModel noise;
  assimilation::SelectionProblem problem;
};

/// Reads what [select] needs. Errors: ProjectError where the file is to blame, DataError for what model or
/// data lack.
[[nodiscard]] SelectionSetup set_up_selection(const Project& project);

}  // namespace knothe::project
