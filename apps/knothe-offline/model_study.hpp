#pragma once
/// @file What the number of modes costs: errors of the field, and of the posterior, for both forms.
#include <optional>
#include <vector>

#include "knothe/assimilation/posterior_shift.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/compression.hpp"

namespace knothe::offline_commands {

/// One line: a model, its error on the grid, and how far it moves the posterior of synthetic data from that
/// of the uncompressed snapshots (absent where the project has no [parameters] or no [simulate]).
struct StudyLine {
  reduction::Form form;
  reduction::CompressionRow errors;
  std::optional<assimilation::ShiftSummary> shift;
};

/// Both forms with 3, 6, 10, 20 and 30 modes (tree: 50 too), as far as the snapshots have so many.
/// `off_grid`: full-order solutions at parameters that are no grid points.
[[nodiscard]] std::vector<StudyLine> study_models(const project::Project& project,
                                                  const reduction::Snapshots& snapshots,
                                                  const std::vector<reduction::OffGridSolution>& off_grid);

/// A table on stdout, or JSON lines.
void report_study(const std::vector<StudyLine>& lines, bool json);

}  // namespace knothe::offline_commands
