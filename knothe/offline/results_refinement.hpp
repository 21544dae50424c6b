#pragma once
/// @file `knothe offline --refine`: the project's model made finer around the last posterior of a results
/// folder.
#include <string>

#include "knothe/files/command_output.hpp"

namespace knothe::offline {

struct RefineOptions {
  std::string project;  ///< file; its model is the one that is refined
  std::string results;  ///< folder of `knothe assimilate`
  std::string model;    ///< file to write
};
/// Solves at the posterior's mean and along its principal axes, and refines the model by these solutions and
/// all others that MODEL.parts/ has from calls before. DataError for results of other parameters.
void refine_model(const RefineOptions& options, const files::CommandOutput& output);

}  // namespace knothe::offline
