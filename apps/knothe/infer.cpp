#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/guarded_main.hpp"
#include "apps/knothe/commands.hpp"
#include "knothe/base/console.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/command_output.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/record/inference_results.hpp"
#include "knothe/record/inference_run.hpp"
#include "knothe/report/pages/inference_report.hpp"

namespace knothe::commands {
namespace {

using posterior::Method;

void require_possible(const project::Project& project, Method method, bool overridden) {
  if (method != Method::grid || project.parameters.size() <= 3) return;
  const std::string text =
      fmt::format("a grid takes at most 3 parameters, and there are {}: use transport, mcmc or smc",
                  project.parameters.size());
  if (overridden) throw UsageError(text);
  throw project.error_at("method.kind", text);
}

nlohmann::ordered_json record_of(const record::InferenceRun& run) {
  return record::inference_record(run.result, run.setup.axes, record::samples_path(run.folder));
}

/// Numbers that are not simply usable are grey.
record::InferenceRun run(const project::Project& project, Method method, const std::string& folder,
                         const files::CommandOutput& output) {
  record::InferenceRun run = record::run_inference(project, method, folder);
  const std::string text = for_people(record::inference_text(run), stdout, 2);
  const nlohmann::ordered_json content = record_of(run);
  const bool usable = report::judgement(content).usability == report::Usability::usable;
  output.line(content, usable ? text : coloured(text, Colour::grey, stdout));
  return run;
}

/// As the first line of the report.
std::string result_line(const record::InferenceRun& run) {
  using report::Usability;
  const Usability worth = report::judgement(record_of(run)).usability;
  const Colour colour = worth == Usability::usable         ? Colour::green
                        : worth == Usability::with_caveats ? Colour::yellow
                                                           : Colour::red;
  return coloured("Result: " + report::result_words(worth), colour, stdout);
}

int compare(const InferArguments& arguments, const project::Project& project) {
  const auto comma = arguments.compare.find(',');
  if (comma == std::string::npos || arguments.compare.find(',', comma + 1) != std::string::npos)
    throw UsageError("--compare takes two methods: --compare transport,mcmc");
  if (!arguments.method.empty()) throw UsageError("--compare and --method exclude each other");
  const Method first = assimilation::method_from(arguments.compare.substr(0, comma));
  const Method second = assimilation::method_from(arguments.compare.substr(comma + 1));
  if (first == second) throw UsageError("--compare takes two different methods");
  for (const Method method : {first, second}) require_possible(project, method, true);
  const files::CommandOutput output(arguments.json);
  const std::filesystem::path folder = project.results;
  std::vector<record::InferenceRun> runs;
  for (const Method method : {first, second})
    runs.push_back(run(project, method, (folder / assimilation::to_text(method)).string(), output));
  const assimilation::Comparison comparison = assimilation::compare(runs[0].result, runs[1].result);
  const auto record =
      record::comparison_record(comparison, assimilation::to_text(first), assimilation::to_text(second));
  files::write_text_atomically((folder / "comparison.json").string(), files::json_line(record) + "\n");
  output.line(record, record::comparison_text(runs[0], runs[1], comparison));
  output.text(for_people(comparison.in_words(), stdout, 2));
  for (const record::InferenceRun& run : runs)
    output.text(for_people(
        fmt::format("{}: {}", assimilation::to_text(run.result.method), run.result.verdict), stdout, 2));
  if (comparison.contradict() && runs[0].result.trusted && runs[1].result.trusted)
    return static_cast<int>(ExitStatus::rejected);
  return exit_status(runs[0].result.trusted && runs[1].result.trusted);
}

}  // namespace

int infer(const InferArguments& arguments) {
  project::Project project = project::read_project(arguments.project);
  if (!arguments.results.empty()) project.results = arguments.results;
  if (!arguments.compare.empty()) return compare(arguments, project);
  const bool overridden = !arguments.method.empty();
  if (!overridden && !assimilation::is_one_shot(project.method.kind)) {
    throw project.error_at("method.kind",
                           fmt::format("method.kind = \"{}\" is for `knothe assimilate`; one-shot inference "
                                       "takes \"auto\", \"transport\", \"mcmc\", \"smc\" or \"grid\"",
                                       to_text(project.method.kind)));
  }
  const Method method = overridden ? assimilation::method_from(arguments.method) : project.method.kind;
  require_possible(project, method, overridden);
  const files::CommandOutput output(arguments.json);
  const record::InferenceRun answer = run(project, method, project.results, output);
  output.text(result_line(answer));
  output.text(for_people(answer.result.verdict, stdout, 2));
  return exit_status(answer.result.trusted);
}

}  // namespace knothe::commands
