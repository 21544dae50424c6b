#pragma once
/// @file From a project file to the candidates of a data selection.
#include <vector>

#include "knothe/assimilation/select/selection_study.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/model/separated_model.hpp"
#include "knothe/reduction/observe/sensors.hpp"

namespace knothe::project {

struct SelectionSetup {
  reduction::SeparatedModel model;
  std::vector<std::size_t> candidates;  ///< their indices in the data file or in the model
  bool from_data = false;
  reduction::Sensors sensors;                ///< the candidates
  reduction::ObservedModel observed, whole;  ///< at the measured steps, and at all of the model
  assimilation::NoiseModel noise;
  assimilation::SelectionProblem problem;
};

/// Reads what [select] needs. Errors: ProjectError where the file is to blame, DataError for what model or
/// data lack.
[[nodiscard]] SelectionSetup set_up_selection(const Project& project);

}  // namespace knothe::project
