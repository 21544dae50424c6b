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
  std::string share;    ///< "I/N": make the runs of share I (from 0) of N only, and no model
};
/// Solves on the grid of parameters, chooses the number of modes, compresses and writes the model. Call it on
/// every rank of an MPI job. Errors: UsageError for a share that is none, or of runs that are chosen on the
/// way.
void build_model(const BuildOptions& build, const files::CommandOutput& output);

}  // namespace knothe::offline
