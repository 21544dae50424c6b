#pragma once
/// @file What `knothe select` found: JSON lines, and a page with the sensitivity fields and the chosen
/// points.
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "knothe/project/selection_setup.hpp"

namespace knothe::report {

/// One line per chosen dof, best first, a last one of the choice (docs/explanation/assimilation.md).
[[nodiscard]] std::vector<nlohmann::ordered_json> selection_records(
    const project::Project& project, const project::SelectionSetup& setup,
    const assimilation::SelectionStudy& study);

/// The page.
[[nodiscard]] std::string selection_page(const project::Project& project,
                                         const project::SelectionSetup& setup,
                                         const assimilation::SelectionStudy& study);

}  // namespace knothe::report
