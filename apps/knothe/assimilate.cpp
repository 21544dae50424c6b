#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "knothe/assimilation/measurements.hpp"
#include "knothe/assimilation/sequential_update.hpp"
#include "knothe/assimilation/time_matching.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/forecast/forecaster.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/report/results_writer.hpp"
#include "knothe/report/step_record.hpp"

namespace knothe::commands {
namespace {

using Clock = std::chrono::steady_clock;

double microseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::micro>(Clock::now() - start).count();
}

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

}  // namespace

int assimilate(const AssimilateArguments& arguments) {
  project::Project project = project::read_project(arguments.project);
  if (!arguments.method.empty()) project.method.kind = arguments.method;
  if (!arguments.results.empty()) project.results = arguments.results;
  project::UpdateSetup setup = project::set_up(project);

  assimilation::SequentialUpdate update(setup.observed, setup.measurements.noise, setup.priors,
                                        setup.options);
  forecast::Forecaster forecaster = project::make_forecaster(project, setup);
  files::require_writable_folder(project.results);
  report::ResultsWriter results(project, setup.model, setup.measurements, update.priors());
  Display display(arguments.json, setup.model.parameter_names(), setup.measurements.time.size());
  const auto start = Clock::now();
  bool interrupted = false;
  std::vector<std::size_t> untrusted;
  for (std::size_t step = 0; step < setup.measurements.time.size() && !interrupted; ++step) {
    const assimilation::UpdateResult& result = update.update(
        step, setup.time_indices[step], setup.measurements.values.col(static_cast<Eigen::Index>(step)));
    const auto forecast_start = Clock::now();
    const auto forecasts = forecaster.update(update.posterior().points, update.posterior().weights);
    const double forecast_us = microseconds_since(forecast_start);
    if (!result.trusted) untrusted.push_back(step);
    if (arguments.json) {
      fmt::print("{}\n", files::json_line(report::step_record(result, forecasts, forecast_us)));
      std::fflush(stdout);
    }
    display.show(result, forecasts, result.elapsed_us.total() + forecast_us);
    // Not part of the forecast's time: a cross-check for the report, from fewer points.
    const auto direct = forecaster.direct(update.posterior().points, update.posterior().weights, 256);
    results.add_step(result, update.posterior(), forecasts, direct, forecast_us, setup.time_indices[step]);
    interrupted = cancellation_requested();
  }
  const double elapsed_s = microseconds_since(start) * 1e-6;
  results.write(project.results, untrusted, elapsed_s);
  const std::size_t steps = update.steps().size();
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
  }
  return 0;
}

}  // namespace knothe::commands
