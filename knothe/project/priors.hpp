#pragma once
/// @file The priors that a project names, posteriors of earlier tests among them.
#include <span>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

/// Of the parameters that are inferred, in their order. Each file of results is read once, and its parameters
/// are one joint prior. Errors: DataError of a file; ProjectError for a parameter that it does not have.
[[nodiscard]] std::vector<posterior::Prior> priors_of(const Project& project);
/// The same, truncated to the box of a model whose first axes these are. ProjectError, with its place in the
/// file, for one that has no mass there.
[[nodiscard]] std::vector<posterior::Prior> priors_of(const Project& project,
                                                      std::span<const model::Axis> axes);

}  // namespace knothe::project
