#pragma once
/// @file Load–displacement curves, dissipated energy and crack length of a project's beam on several meshes.
#include <string>
#include <vector>

#include "knothe/files/command_output.hpp"
#include "knothe/project/offline_options.hpp"

namespace knothe::offline {

struct MeshStudyOptions {
  std::string project;                                      ///< file with [offline]
  std::vector<double> elements = {0.005, 0.0025, 0.00125};  ///< m
  std::vector<project::DamageRegularisation> laws = {project::DamageRegularisation::none,
                                                     project::DamageRegularisation::crack_band,
                                                     project::DamageRegularisation::gradient};
  int steps = 0;       ///< 0: the project's
  std::string figure;  ///< page (.html), none if empty
};
/// Prints a row for each law and mesh, then how far each run is from the next finer one. ProjectError for a
/// mesh from a file, UsageError for a page of another name.
void study_meshes(const MeshStudyOptions& options, const files::CommandOutput& output);

}  // namespace knothe::offline
