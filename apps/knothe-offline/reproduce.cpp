#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/knothe-offline/commands.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/command_output.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/reproduction/study_files.hpp"

namespace knothe::offline_commands {
namespace {

void show(const reproduction::FigureRecord& figure, const files::CommandOutput& output) {
  for (const nlohmann::ordered_json& row : reproduction::row_records(figure)) output.record(row);
  output.text(reproduction::heading(figure));
  for (const reproduction::Row& row : figure.rows)
    output.text(fmt::format("  {}{}\n    paper: {}\n    here:  {}", row.quantity,
                            row.unit == "1" ? "" : ", " + row.unit, row.paper, row.here));
}

}  // namespace

int reproduce(const ReproduceArguments& arguments) {
  namespace fs = std::filesystem;
  const files::CommandOutput output(arguments.json);
  const fs::path folder(arguments.output);
  files::require_writable_folder(folder.string());
  reproduction::StudyOptions options =
      arguments.quick ? reproduction::StudyOptions::quickly() : reproduction::StudyOptions();
  options.models_folder = (folder / "models").string();
  options.seed = arguments.seed;
  options.processes = static_cast<int>(default_threads());
  const reproduction::Study study = reproduction::run_study(
      options, [&](const reproduction::FigureRecord& figure) { show(figure, output); });
  const std::string page = (folder / "reproduce.html").string(),
                    record = (folder / "reproduce.json").string();
  files::write_text_atomically(page, reproduction::study_page(study, options));
  files::write_text_atomically(record, files::json_line(reproduction::study_record(study, options)) + "\n");
  reproduction::remove_runs(options.models_folder);
  output.line({{"done", true},
               {"figures", study.figures.size()},
               {"page", page},
               {"record", record},
               {"elapsed_s", study.elapsed_s}},
              fmt::format("{} and {} in {:.0f} s", page, record, study.elapsed_s));
  return 0;
}

}  // namespace knothe::offline_commands
