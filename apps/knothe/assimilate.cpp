#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "apps/knothe/commands.hpp"
#include "apps/knothe/crack_line.hpp"
#include "knothe/assimilation/data/measurements.hpp"
#include "knothe/assimilation/data/time_matching.hpp"
#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/forecast/forecaster.hpp"
#include "knothe/imaging/series/camera_drift.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/project/forecast_scoring.hpp"
#include "knothe/project/model_comparison.hpp"
#include "knothe/project/picture_measurements.hpp"
#include "knothe/project/picture_registration.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/report/results/results_writer.hpp"
#include "knothe/report/results/step_record.hpp"

namespace knothe::commands {
namespace {

/// The line a person sees while it happens, and a row of the table that stays.
class Display {
 public:
  Display(bool json, std::vector<std::string> names, std::size_t steps)
      : json_(json), live_(!json && isatty(STDERR_FILENO) == 1), names_(std::move(names)), steps_(steps) {}

  void show(const assimilation::UpdateResult& r, const std::vector<forecast::NamedForecast>& forecasts,
            double total_us) {
    if (json_) return;
    std::string text = fmt::format("step {:3}", r.step);
    for (std::size_t k = 0; k < names_.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      text += fmt::format("  {} {:.3f} ± {:.3f}", names_[k], r.mean[i], std::sqrt(r.covariance(i, i)));
    }
    text += fmt::format("  order {}{}", r.map_order, r.trusted ? " " : "!");
    if (!forecasts.empty()) {
      const auto& f = forecasts.front();
      text += fmt::format("  {} {}", f.name, value_with_unit(f));
    }
    text += fmt::format("  {:.0f} µs", total_us);
    const bool keep = (r.step + 1) % 10 == 0 || ++shown_ == steps_;
    if (live_) std::fprintf(stderr, "\r\033[K%s", text.c_str());
    if (keep) {
      if (live_) std::fputs("\r\033[K", stderr);
      fmt::print("{}\n", text);
      std::fflush(stdout);
    }
  }

  ~Display() {
    if (live_) std::fputs("\r\033[K", stderr);
  }

 private:
  static std::string value_with_unit(const forecast::NamedForecast& f) {
    if (f.units == "m") return fmt::format("{:.1f} ± {:.1f} mm", f.forecast.mean * 1e3, f.forecast.std * 1e3);
    return fmt::format("{:.4g} ± {:.2g} {}", f.forecast.mean, f.forecast.std, f.units);
  }

  bool json_, live_;
  std::vector<std::string> names_;
  std::size_t steps_, shown_ = 0;
};

std::string joined(const std::vector<std::size_t>& steps) {
  return steps.empty() ? "none" : fmt::format("{}", fmt::join(steps, ", "));
}

/// One way of assimilating, whichever the project asks for.
class Assimilation {
 public:
  explicit Assimilation(const project::UpdateSetup& setup) {
    const auto& noise = setup.measurements.noise;
    assimilation::Features features = features_of(setup.options);
    add(features, assimilation::Feature::baseline, setup.baseline.has_value());
    add(features, assimilation::Feature::gate, setup.robust.gate > 0);
    add(features, assimilation::Feature::student_t, setup.robust.degrees_of_freedom > 0);
    assimilation::require_compatible(features);
    if (setup.baseline) {
      baseline_ = std::make_unique<assimilation::BaselineUpdate>(setup.observed, noise, setup.priors,
                                                                 *setup.baseline);
    } else if (setup.robust.is_active()) {
      robust_ = std::make_unique<assimilation::RobustUpdate>(setup.observed, noise, setup.priors,
                                                             setup.options, setup.robust);
    } else {
      maps_ = std::make_unique<assimilation::SequentialUpdate>(setup.observed, noise, setup.priors,
                                                               setup.options);
    }
  }

  const assimilation::UpdateResult& update(std::size_t step, std::size_t time_index,
                                           const Eigen::VectorXd& values) {
    if (baseline_) return baseline_->update(step, time_index, values);
    return robust_ ? robust_->update(step, time_index, values) : maps_->update(step, time_index, values);
  }
  [[nodiscard]] const assimilation::WeightedPosterior& posterior() const {
    if (baseline_) return baseline_->posterior();
    return robust_ ? robust_->posterior() : maps_->posterior();
  }
  /// A picture from which elements were taken out. The methods without a map know only the noise of complete
  /// data, of which they take the part that the values present have.
  void set_step_noise(std::size_t step, assimilation::NoiseModel noise) {
    if (maps_) maps_->set_step_noise(step, std::move(noise));
  }
  void redo(std::size_t from, std::size_t to) { maps_->redo(from, to); }
  /// Of gating or a Student-t likelihood, else null.
  [[nodiscard]] const assimilation::SensorReport* sensors() const {
    return robust_ ? &robust_->sensors() : nullptr;
  }

 private:
  std::unique_ptr<assimilation::BaselineUpdate> baseline_;
  std::unique_ptr<assimilation::RobustUpdate> robust_;
  std::unique_ptr<assimilation::SequentialUpdate> maps_;
};

std::vector<assimilation::Prior> truncated_priors(const project::UpdateSetup& setup) {
  std::vector<assimilation::Prior> priors;
  for (std::size_t k = 0; k < setup.priors.size(); ++k) {
    const auto& axis = setup.model.contents().axes[k];
    priors.push_back(setup.priors[k].truncated(axis.nodes.front(), axis.nodes.back(), axis.name));
  }
  return priors;
}

/// Innovation and test ratio of the sensors that reported, and those that are not to be believed.
nlohmann::ordered_json sensor_record(const assimilation::SensorReport& sensors) {
  nlohmann::ordered_json record = {{"indices", nlohmann::ordered_json::array()},
                                   {"innovation", nlohmann::ordered_json::array()},
                                   {"test_ratio", nlohmann::ordered_json::array()},
                                   {"weight", nlohmann::ordered_json::array()}};
  for (Eigen::Index i = 0; i < sensors.innovation.size(); ++i) {
    if (std::isnan(sensors.innovation[i])) continue;
    record["indices"].push_back(i);
    record["innovation"].push_back(sensors.innovation[i]);
    record["test_ratio"].push_back(sensors.test_ratio[i]);
    record["weight"].push_back(sensors.weight[i]);
  }
  record["rejected"] = sensors.rejected;
  record["stuck"] = sensors.stuck;
  record["absent"] = sensors.absent;
  return record;
}

/// What a person should know of the sensors, once for each that goes.
void report_sensors(const assimilation::SensorWatch& watch, std::size_t step, std::set<Eigen::Index>& known) {
  for (const auto& [sensors, what] :
       {std::pair(&watch.stuck(), "is stuck: the same value at five steps while the model moves"),
        std::pair(&watch.absent(), "is silent: no value at five steps")}) {
    for (const Eigen::Index i : *sensors) {
      if (known.insert(i).second)
        std::fprintf(stderr, "%s", fmt::format("step {}: sensor {} {}\n", step, i, what).c_str());
    }
  }
}

/// The next picture's displacements as the datum of `step`; a picture that is missing is named.
project::PictureDatum next_picture(project::PictureMeasurements& pictures, std::size_t step,
                                   project::UpdateSetup& setup, Assimilation& update,
                                   project::ModelComparison& comparison, report::ResultsWriter& results) {
  project::PictureDatum datum = pictures.next();
  if (datum.picture.missing) fmt::print(stderr, "{}\n", datum.picture.message);
  if (datum.noise) {
    update.set_step_noise(step, *datum.noise);
    comparison.set_step_noise(step, *datum.noise);
  }
  setup.measurements.values.col(static_cast<Eigen::Index>(step)) = datum.values;
  results.set_values(step, datum.values);
  return datum;
}

/// What a step's line says of its picture; the time line begins where the picture is in memory.
void add_picture(nlohmann::ordered_json& line, const project::PictureDatum& datum,
                 const project::PictureMeasurements& pictures) {
  const imaging::PictureResult& r = datum.picture;
  // The camera's motions are no data that are missing.
  line["missing"] = line["missing"].get<int>() - imaging::drift_modes(pictures.series().options().drift);
  line["picture"] = {{"name", r.picture},
                     {"missing", r.missing},
                     {"iterations", r.correlation.iterations},
                     {"start", r.correlation.searched    ? "search"
                               : r.correlation.predicted ? "model"
                                                         : "last"},
                     {"residual_rms", r.correlation.residual_rms},
                     {"elements_rejected", r.correlation.elements_rejected}};
  if (r.missing) line["picture"]["message"] = r.message;
  if (r.crack) line["picture"]["crack"] = crack_line(*r.crack, pictures.frame());
  auto& elapsed = line["elapsed_us"];
  elapsed["correlation"] = datum.correlation_us;
  elapsed["precision"] = datum.precision_us;
  double total = elapsed["total"].get<double>() + datum.correlation_us + datum.precision_us;
  elapsed["wait"] = datum.wait_us;
  if (r.crack) elapsed["crack"] = 1e3 * r.crack_ms, total += 1e3 * r.crack_ms;
  elapsed["total"] = total;
}

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

}  // namespace

int assimilate(const AssimilateArguments& arguments) {
  project::Project project = project::read_project(arguments.project);
  if (const auto kind = from_text<assimilation::Method>(arguments.method)) project.method.kind = *kind;
  if (!arguments.results.empty()) project.results = arguments.results;
  project::UpdateSetup setup = project::set_up(project, true);

  setup.options.learn_bias = !arguments.redo.empty();
  Assimilation update(setup);
  assimilation::SensorWatch watch(setup.measurements.noise);
  const std::vector<assimilation::Prior> priors = truncated_priors(setup);
  Eigen::VectorXd middle(static_cast<Eigen::Index>(priors.size()));
  for (std::size_t k = 0; k < priors.size(); ++k)
    middle[static_cast<Eigen::Index>(k)] = priors[k].from_standard_normal(0).value;
  std::set<Eigen::Index> reported;
  if (!arguments.redo.empty()) {
    // What is taken out and put back equals what came corrected in the first place, to the bit.
    const auto [from, to] = redo_range(arguments.redo, setup.measurements.time.size());
    update.redo(from, to);
  }
  if (setup.pictures && setup.pictures->registration())
    fmt::print(stderr, "{}\n", project::registration_text(*setup.pictures->registration()));
  project::ModelComparison comparison(project);
  forecast::Forecaster forecaster = project::make_forecaster(project, setup);
  files::require_writable_folder(project.results);
  report::ResultsWriter results(project, setup.model, setup.measurements, priors, setup.observed);
  for (const std::string& name : setup.unused)
    fmt::print(stderr, "{}: the series \"{}\" is not used: it has no std\n", project.data, name);
  forecast::ForecastScores awaited = project::forecasts_to_score(project, setup);
  Display display(arguments.json, setup.model.parameter_names(), setup.measurements.time.size());
  const auto start = monotonic_now();
  bool interrupted = false;
  std::vector<std::size_t> untrusted;
  Eigen::VectorXd mean;  // of the parameters, after the last step
  std::size_t steps = 0;
  for (std::size_t step = 0; step < setup.measurements.time.size() && !interrupted; ++step) {
    std::optional<project::PictureDatum> picture;
    if (setup.pictures && mean.size() != 0 && step + 1 < setup.time_indices.size())
      setup.pictures->set_increment(setup.observed->predict(mean, setup.time_indices[step + 1]) -
                                    setup.observed->predict(mean, setup.time_indices[step]));
    if (setup.pictures) picture = next_picture(*setup.pictures, step, setup, update, comparison, results);
    const auto scores = awaited.look(setup.time_indices[step],
                                     setup.measurements.values.col(static_cast<Eigen::Index>(step)));
    const assimilation::UpdateResult& result = update.update(
        step, setup.time_indices[step], setup.measurements.values.col(static_cast<Eigen::Index>(step)));
    mean = result.mean;
    // A node on a crack is no sensor that fell silent, nor is a camera's drift.
    if (!picture && setup.measurements.noise.is_independent())
      watch.look(setup.measurements.values.col(static_cast<Eigen::Index>(step)),
                 setup.observed->predict(middle, setup.time_indices[step]));
    report_sensors(watch, step, reported);
    const auto forecast_start = monotonic_now();
    const auto forecasts = forecaster.update(update.posterior().points, update.posterior().weights);
    const double forecast_us = microseconds_since(forecast_start);
    if (!result.trusted) untrusted.push_back(step);
    comparison.update(step, result.log_evidence,
                      setup.measurements.values.col(static_cast<Eigen::Index>(step)));
    if (arguments.json) {
      auto record = report::step_record(result, forecasts, forecast_us);
      if (update.sensors() != nullptr) record["sensors"] = sensor_record(*update.sensors());
      if (!watch.stuck().empty()) record["stuck"] = watch.stuck();
      if (!watch.absent().empty()) record["absent"] = watch.absent();
      if (picture) add_picture(record, *picture, *setup.pictures);
      if (!scores.empty()) record["scores"] = report::score_records(scores);
      if (!comparison.empty()) record["models"] = report::model_records(comparison);
      fmt::print("{}\n", files::json_line(record));
      std::fflush(stdout);
    }
    const double picture_us = picture ? picture->correlation_us + picture->precision_us : 0;
    if (!result.notice.empty()) fmt::print(stderr, "step {}: {}\n", step, result.notice);
    display.show(result, forecasts, picture_us + result.elapsed_us.total() + forecast_us);
    // Not part of the forecast's time: a cross-check for the report, from fewer points.
    const auto direct = forecaster.direct(update.posterior().points, update.posterior().weights, 256);
    results.add_step(result, update.posterior(), forecasts, direct, forecast_us, setup.time_indices[step],
                     scores, &comparison);
    awaited.keep(step, result.time, update.posterior().points, update.posterior().weights);
    ++steps;
    interrupted = cancellation_requested();
  }
  const double elapsed_s = microseconds_since(start) * 1e-6;
  results.write(project.results, untrusted, elapsed_s);
  if (setup.pictures)
    imaging::write_displacements((std::filesystem::path(project.results) / "displacements.h5").string(),
                                 setup.pictures->series(), setup.pictures->results(), setup.pictures->frame(),
                                 project.text);
  if (interrupted) {
    throw Interrupted(fmt::format("interrupted after {} of {} steps; their results are in {}", steps,
                                  setup.measurements.time.size(), project.results));
  }
  if (arguments.json) {
    const nlohmann::ordered_json last = {
        {"done", true}, {"steps", steps}, {"untrusted", untrusted}, {"elapsed_s", elapsed_s}};
    fmt::print("{}\n", files::json_line(last));
  } else {
    fmt::print("{} steps in {:.2f} s, untrusted: {}; results in {}\n", steps, elapsed_s, joined(untrusted),
               project.results);
    if (!comparison.empty()) fmt::print("{}\n", comparison.verdict());
  }
  return 0;
}

}  // namespace knothe::commands
