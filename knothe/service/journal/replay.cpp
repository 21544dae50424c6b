#include "knothe/service/journal/replay.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/console.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/record/assimilation_output.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/record/results_writer.hpp"
#include "knothe/record/step_record.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/served_model.hpp"
#include "knothe/service/journal/step_matching.hpp"

namespace knothe::service {
namespace {

/// A journal with the setup that it was written under, checked to fit.
struct Opened {
  ServedModel model;
  std::vector<JournalEntry> entries;  ///< that count, by step and key
};

ServedModel model_of(const JournalReader& journal, const project::Project& project,
                     const project::UpdateSetup& setup) {
  return served_model(project, setup, journal.path(),
                      last_verification(journal.logbook(), to_hex(sha256_of_file(project.model))));
}

/// The data that count, by step and key, as the engine is to see them.
std::vector<JournalEntry> counting_entries(const JournalReader& journal, const project::UpdateSetup& setup) {
  const std::size_t sensors = setup.measurements.observation_count();
  SensorSwitches switches(setup.problem.model->time);
  for (const LogbookEntry& entry : journal.logbook()) switches.add(entry);
  std::vector<JournalEntry> entries;
  journal.for_each([&](JournalEntry entry) {
    if (!entry.counts()) return;
    if (entry.measurement.values.size() != sensors)
      throw DataError(fmt::format("{}: record {} has {} values; the project has {} sensors", journal.path(),
                                  entry.id, entry.measurement.values.size(), sensors));
    match_step(entry, setup.problem.model->time, journal.path());
    entry.measurement = switches.seen(std::move(entry.measurement));
    entries.push_back(std::move(entry));
  });
  std::stable_sort(entries.begin(), entries.end(), [](const JournalEntry& a, const JournalEntry& b) {
    return a.measurement.step != b.measurement.step ? a.measurement.step < b.measurement.step
                                                    : a.measurement.key < b.measurement.key;
  });
  return entries;
}

Opened open_both(const std::string& path, const std::string& project_path) {
  const JournalReader journal(path);
  const project::Project project = project::read_project(project_path);
  const project::UpdateSetup setup = project::set_up_online(project);
  return {model_of(journal, project, setup), counting_entries(journal, setup)};
}

std::string csv_of(const Opened& opened) {
  std::string text = "time,sensor,x,y,z,component,value,std\n";
  const auto& setup = opened.model.setup;
  const model::Sensors& sensors = setup.measurements.sensors;
  const Eigen::VectorXd std = setup.measurements.noise.measurement().standard_deviations();
  const auto value = [](double v) { return std::isnan(v) ? "" : files::format_number(v); };
  for (const JournalEntry& entry : opened.entries) {
    const std::vector<double> values = entry.measurement.effective_values();
    for (std::size_t i = sensors.displacement_count(); i < values.size(); ++i)
      text += fmt::format("{0},{1},,,,{1},{2},{3}\n", files::format_number(entry.measurement.time),
                          sensors.scalars[i - sensors.displacement_count()], value(values[i]),
                          files::format_number(std[i]));
    for (std::size_t i = 0; i < sensors.displacement_count(); ++i) {
      const auto at = sensors.point(i);
      text +=
          fmt::format("{},s{},{},{},{},{},{},{}\n", files::format_number(entry.measurement.time), i,
                      files::format_number(at[0]), files::format_number(at[1]), files::format_number(at[2]),
                      "xyz"[sensors.components[i]], value(values[i]), files::format_number(std[i]));
    }
  }
  return text;
}

assimilation::Engine engine_of(const Opened& opened) {
  assimilation::Engine engine(opened.model.engine_setup());
  for (const JournalEntry& entry : opened.entries) engine.add(entry.measurement.datum());
  return engine;
}

void write_results(const Opened& opened, const std::string& folder) {
  files::require_writable_folder(folder);
  const project::UpdateSetup& setup = opened.model.setup;
  assimilation::Engine engine = engine_of(opened);
  const std::vector<std::size_t> steps(engine.stale().begin(), engine.stale().end());
  // The data as a file has them: one column per step, the last datum of each.
  likelihood::Measurements measurements = setup.measurements;
  measurements.time.clear();
  for (const std::size_t step : steps) measurements.time.push_back(setup.problem.model->time[step]);
  measurements.values.resize(measurements.values.rows(), std::ssize(steps));
  record::ResultsWriter writer(opened.model.project, setup.model, measurements, engine.priors(),
                               setup.problem.model);
  const auto start = std::chrono::steady_clock::now();
  for (const std::size_t step : steps) {
    check_cancellation("nothing was written");
    assimilation::StepResult result = engine.posterior_at(step);
    opened.model.amend(result);
    writer.add_step(result, engine.published_forecasts(result), engine.last_datum(step));
  }
  writer.write(folder, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
}

}  // namespace

void for_each_result(const JournalReader& journal, const project::Project& project,
                     const project::UpdateSetup& setup,
                     const std::function<void(const assimilation::StepResult&)>& visit) {
  const ServedModel model = model_of(journal, project, setup);
  assimilation::Engine engine(model.engine_setup());
  for (const JournalEntry& entry : counting_entries(journal, setup)) engine.add(entry.measurement.datum());
  const std::vector<std::size_t> steps(engine.stale().begin(), engine.stale().end());
  for (const std::size_t step : steps) {
    check_cancellation("a replay changes nothing");
    assimilation::StepResult result = engine.posterior_at(step);
    model.amend(result);
    visit(result);
  }
}

std::string project_of_journal(const std::string& journal, const std::string& project) {
  if (!project.empty()) return project;
  // NAME.journal, or NAME.TEST.journal.
  for (std::filesystem::path stem = std::filesystem::path(journal).replace_extension();;
       stem.replace_extension()) {
    const std::string beside = stem.string() + ".toml";
    if (std::filesystem::exists(beside)) return beside;
    if (!stem.has_extension()) return "";
  }
}

void replay_journal(const std::string& path, const std::string& project_path, bool json) {
  const auto start = std::chrono::steady_clock::now();
  if (!json) {
    const JournalReader journal(path);
    const auto identity = journal.identity();
    fmt::print("{}: {} records, {} in quarantine, {} withdrawn, whole; seal {}\n", path, journal.count(),
               journal.quarantined().size(), journal.withdrawals(), journal.seal());
    if (!journal.lost().empty()) fmt::print("{}\n", journal.lost());
    if (identity)
      fmt::print("model {}\nconfiguration {}\nsensors {}\n", identity->model, identity->configuration,
                 identity->sensors);
  }
  if (project_path.empty()) {
    if (json) throw UsageError("the posterior needs the project file: --project FILE.toml");
    return;
  }
  Opened opened = open_both(path, project_path);
  assimilation::Engine engine = engine_of(opened);
  std::vector<std::size_t> steps(engine.stale().begin(), engine.stale().end()), untrusted;
  assimilation::RunVerdict run;
  if (!json && !steps.empty()) steps = {steps.back()};
  for (const std::size_t step : steps) {
    check_cancellation("a replay changes nothing");
    assimilation::StepResult result = json ? engine.posterior_at(step) : engine.preview(step);
    opened.model.amend(result);
    if (!result.update.trusted) untrusted.push_back(step);
    run.add(result.update.verdict);
    if (json) {
      fmt::print("{}\n",
                 files::json_line(record::step_record(result, opened.model.setup.model.contents().axes)));
    } else {
      fmt::print("after step {}: ", step);
      for (Eigen::Index k = 0; k < result.update.mean.size(); ++k)
        fmt::print(
            " {} {}", opened.model.project.parameters[k].name,
            record::with_uncertainty(result.update.mean[k], std::sqrt(result.update.covariance(k, k))));
      fmt::print("  log-evidence {:.6g}\n", result.update.log_evidence);
    }
  }
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (json) {
    const nlohmann::ordered_json last = {{"done", true},
                                         {"steps", steps.size()},
                                         {"verdict", record::verdict_record(run.verdict())},
                                         {"untrusted", untrusted},
                                         {"elapsed_s", elapsed}};
    fmt::print("{}\n", files::json_line(last));
  } else {
    fmt::print("{}\nreplayed in {:.2f} s\n",
               for_people(record::shown_verdict(run.verdict(), stdout), stdout, 2), elapsed);
  }
}

void export_journal(const std::string& path, const std::string& project_path, const std::string& output) {
  if (project_path.empty()) throw UsageError("the sensors are needed: --project FILE.toml");
  Opened opened = open_both(path, project_path);
  if (output.ends_with(".csv")) {
    files::write_text_atomically(output, csv_of(opened));
  } else {
    if (opened.entries.empty())
      throw DataError(fmt::format("{}: holds no data yet: there is nothing to export", path));
    write_results(opened, output);
  }
  fmt::print("{} data written to {}\n", opened.entries.size(), output);
}

}  // namespace knothe::service
