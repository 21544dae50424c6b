#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "knothe/base/console.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/project/selection_setup.hpp"
#include "knothe/report/pages/selection_report.hpp"

namespace knothe::commands {

int select(const SelectArguments& arguments) {
  project::Project project = project::read_project(arguments.project);
  if (!arguments.results.empty()) project.results = arguments.results;
  const project::SelectionSetup setup = project::set_up_selection(project);
  const assimilation::SelectionStudy study =
      assimilation::study_selection(setup.observed, setup.whole, setup.noise, setup.problem);
  const auto records = report::selection_records(project, setup, study);
  std::string lines;
  for (const auto& record : records) lines += files::json_line(record) + "\n";
  files::require_writable_folder(project.results);
  const auto folder = std::filesystem::path(project.results);
  files::write_text_atomically((folder / "selection.jsonl").string(), lines);
  files::write_text_atomically((folder / "selection.html").string(),
                               report::selection_page(project, setup, study));
  if (arguments.json) {
    fmt::print("{}", lines);
    return 0;
  }
  const auto names = setup.model.parameter_names();
  for (std::size_t i = 0; i < study.ranked.size(); ++i) {
    const auto& r = study.ranked[i];
    const std::size_t k = r.dof;
    const std::string line =
        fmt::format("{:3}  dof {} ({} at {:.1f}, {:.1f}, {:.1f} mm) {}", i + 1, setup.candidates[k],
                    "xyz"[setup.sensors.components[k]], 1e3 * setup.problem.positions(r.dof, 0),
                    1e3 * setup.problem.positions(r.dof, 1), 1e3 * setup.problem.positions(r.dof, 2),
                    assimilation::explain(study, i, names));
    fmt::print("{}\n", for_people(line, stdout, 5));
  }
  fmt::print("{} of {} dofs by {} in {:.2f} s; fields and comparison: {}\n", study.ranked.size(),
             setup.candidates.size(), to_text(project.select.criterion), study.choice_seconds,
             (folder / "selection.html").string());
  return 0;
}

}  // namespace knothe::commands
