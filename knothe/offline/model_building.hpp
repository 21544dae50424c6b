#pragma once
/// @file `knothe offline`: the reduced model of a project.
#include <string>

#include "knothe/files/command_output.hpp"

namespace knothe::offline {

struct BuildOptions {
  std::string project;  ///< file
  std::string model;    ///< file to write
  std::string method;   ///< overrides the project's, if not empty
  bool study = false;   ///< print what the number of modes costs (study_models)
};
/// Solves on the grid of parameters, chooses the number of modes, compresses and writes the model. Call it on
/// every rank of an MPI job.
void build_model(const BuildOptions& build, const files::CommandOutput& output);

}  // namespace knothe::offline
