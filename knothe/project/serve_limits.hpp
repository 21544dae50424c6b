#pragma once
/// @file Which values the service takes for measurements.
#include "knothe/assimilation/data/plausible_range.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {

/// From [serve.limits], and the model where that says nothing. ProjectError where it names a series that is
/// not measured.
[[nodiscard]] assimilation::PlausibleRange serve_limits(const Project& project, const UpdateSetup& setup);

}  // namespace knothe::project
