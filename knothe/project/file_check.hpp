#pragma once
/// @file `knothe check`: what can be said of model and data before anything is assimilated.
#include <string>
#include <vector>

#include "knothe/project/project_file.hpp"

namespace knothe::project {

struct FileCheck {
  std::vector<std::string> missing;   ///< files that are not there: only the project file is checked then
  std::vector<std::string> facts;     ///< what was found: model, data, forecasts
  std::vector<std::string> warnings;  ///< what will probably not work, and what to do
};

/// Opens model and data as `assimilate` does: names, times, units, points inside the mesh, priors inside the
/// model's box, horizons inside its time. Then compares them: does each parameter move the sensors by more
/// than their noise; are the data as large as the model's answers over the prior? Of a full-order model that
/// is another program: its templates and files. Errors: those of `set_up`, `make_forecaster` and
/// `CommandSimulator`.
[[nodiscard]] FileCheck check_files(const Project& project);

}  // namespace knothe::project
