#include <fmt/format.h>

#include <array>
#include <charconv>
#include <filesystem>

#include "apps/knothe/commands.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/project/input_tolerances.hpp"
#include "knothe/project/picture_registration.hpp"
#include "knothe/project/project_engine.hpp"
#include "knothe/record/assimilation_output.hpp"
#include "knothe/record/results_writer.hpp"
#include "knothe/report/pages/stereo_output.hpp"

namespace knothe::commands {
namespace {

/// FROM:TO of `--redo`.
std::array<std::size_t, 2> redo_range(const std::string& text, std::size_t steps) {
  std::array<std::size_t, 2> range{};
  const char *at = text.data(), *end = at + text.size();
  const auto from = std::from_chars(at, end, range[0]);
  const bool colon = from.ec == std::errc() && from.ptr != end && *from.ptr == ':';
  const auto to = std::from_chars(colon ? from.ptr + 1 : end, end, range[1]);
  if (!colon || to.ec != std::errc() || to.ptr != end)
    throw UsageError(fmt::format("--redo {}: give two steps, FROM:TO, e.g. 20:40", text));
  if (range[0] > range[1] || range[1] >= steps) {
    throw UsageError(
        fmt::format("--redo {}: the data have steps 0 to {}, and FROM is not after TO", text, steps - 1));
  }
  return range;
}

assimilation::EngineSetup engine_setup(const project::Project& project, project::UpdateSetup& setup,
                                       const std::string& redo) {
  setup.problem.update.learn_bias = !redo.empty();
  assimilation::EngineSetup engine = project::engine_setup(project, setup);
  if (!redo.empty()) engine.corrected_steps = redo_range(redo, setup.time_indices.size());
  return engine;
}

void tell_what_was_found(const project::Project& project, const project::UpdateSetup& setup) {
  if (setup.pictures && setup.pictures->registration())
    fmt::print(stderr, "{}\n", project::registration_text(*setup.pictures->registration()));
  for (const std::string& name : setup.unused)
    fmt::print(stderr, "{}: the series \"{}\" is not used: it has no std\n", project.data, name);
}

}  // namespace

int assimilate(const AssimilateArguments& arguments) {
  project::Project project = project::read_project(arguments.project);
  if (const auto kind = from_text<posterior::Method>(arguments.method)) project.method.kind = *kind;
  if (!arguments.results.empty()) project.results = arguments.results;
  if (!project.pictures.cameras.empty()) report::measure_first(project);
  project::UpdateSetup setup = project::set_up(project);
  auto engine = std::make_unique<assimilation::Engine>(engine_setup(project, setup, arguments.redo));
  files::require_writable_folder(project.results);
  record::ResultsWriter results(project, setup.model, setup.measurements, engine->priors(),
                                setup.problem.model);
  tell_what_was_found(project, setup);
  const auto input_errors = project::input_errors(project, setup);
  project::RecordedData data(std::move(setup));
  project::PictureMeasurements* const pictures = data.setup().pictures.get();
  const auto refinement = project::make_refinement(project, data.setup());
  record::AssimilationOutput output(arguments.json, data.setup().model.contents().axes, data.size());
  const auto start = monotonic_now();
  Eigen::VectorXd mean;
  try {
    while (const auto item = cancellation_requested() ? std::nullopt : data.next(mean)) {
      const likelihood::Datum& datum = item->datum;
      assimilation::StepResult result = engine->assimilate(datum);
      const bool is_last = datum.step + 1 == data.size();
      if (refinement && refinement->refine_if_needed(engine, result, is_last)) {
        output.report_refinement(*refinement);
        results.use(*refinement);
      }
      mean = result.update.mean;
      output.show(result, item->picture, pictures);
      results.add_step(result, engine->published_forecasts(result), engine->last_datum(datum.step));
    }
    if (output.shown() > 0 && !cancellation_requested()) {
      const auto shifts = engine->shifts_by(input_errors, mean);
      results.set_input_shifts(shifts);
      output.report_input_errors(shifts);
    }
  } catch (const Interrupted&) {  // within a step: those before it are kept
    if (output.shown() == 0) throw;
  }
  const double elapsed_s = microseconds_since(start) * 1e-6;
  results.write(project.results, elapsed_s);
  if (pictures != nullptr)
    imaging::write_displacements((std::filesystem::path(project.results) / "displacements.h5").string(),
                                 pictures->series(), pictures->results(), pictures->frame(), project.text);
  if (cancellation_requested() && output.shown() < data.size()) {
    throw Interrupted(fmt::format("interrupted after {} of {} steps; their results are in {}", output.shown(),
                                  data.size(), project.results));
  }
  output.finish(elapsed_s, project.results,
                model::loading_of(data.setup().model, project.clock, {mean.begin(), mean.end()}));
  const bool rejected = output.verdict().level == assimilation::VerdictLevel::reject;
  return static_cast<int>(rejected ? ExitStatus::rejected : ExitStatus::done);
}

}  // namespace knothe::commands
