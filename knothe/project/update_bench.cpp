/// @file Time of one update on the beam: the claim of docs/explanation/assimilation.md.
///
/// usage: update_bench PROJECT.toml [REPEATS]   (model and data of the project must be there; bench/run.sh
/// makes them) Prints machine, threads, median and 99th percentile over all steps and repeats, forecasts
/// apart.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <numeric>
#include <string>
#include <vector>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/forecast/forecaster.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"

namespace {

using namespace knothe;
using Clock = std::chrono::steady_clock;

double percentile(std::vector<double> values, double fraction) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(fraction * static_cast<double>(values.size() - 1) + 0.5)];
}

std::string processor() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown processor";
}

void print(const std::string& what, const std::vector<double>& us) {
  fmt::print("  {:<28} median {:8.1f} µs   p99 {:8.1f} µs   max {:8.1f} µs\n", what, percentile(us, 0.5),
             percentile(us, 0.99), percentile(us, 1));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    fmt::print(stderr, "usage: update_bench PROJECT.toml [REPEATS]\n");
    return 2;
  }
  const project::Project project = project::read_project(argv[1]);
  const int repeats = argc > 2 ? std::atoi(argv[2]) : 10;
  const project::UpdateSetup setup = project::set_up(project);
  const std::size_t steps = setup.measurements.time.size();
  fmt::print("{}, 1 thread; {} form, r = {}, {} dofs, {} steps, {} repeats, tolerance {:g}\n", processor(),
             reduction::to_text(setup.model.contents().form), setup.observed->functions->count(),
             setup.observed->observations(), steps, repeats, project.method.update.map.tolerance);
  std::vector<double> update_us, forecast_us, early, middle, late, projection, map, correction;
  forecast::Forecaster forecaster(setup.model, setup.measurements.sensors, project.forecasts);
  for (int repeat = 0; repeat < repeats + 1; ++repeat) {
    assimilation::SequentialUpdate update(setup.observed, setup.measurements.noise, setup.priors,
                                          setup.options);
    for (std::size_t i = 0; i < steps; ++i) {
      const auto start = Clock::now();
      const auto& r = update.update(i, setup.time_indices[i],
                                    setup.measurements.values.col(static_cast<Eigen::Index>(i)));
      const double us = std::chrono::duration<double, std::micro>(Clock::now() - start).count();
      const auto forecast_start = Clock::now();
      const auto forecasts = forecaster.update(update.posterior().points, update.posterior().weights);
      const double f = std::chrono::duration<double, std::micro>(Clock::now() - forecast_start).count();
      if (repeat == 0) continue;  // warm-up: tables are made
      update_us.push_back(us);
      forecast_us.push_back(f);
      (i < steps / 3 ? early : i < 2 * steps / 3 ? middle : late).push_back(us);
      projection.push_back(r.elapsed_us.projection);
      map.push_back(r.elapsed_us.map);
      correction.push_back(r.elapsed_us.correction);
      if (forecasts.empty() && !project.forecasts.empty()) return 1;
    }
  }
  print("update, all steps", update_us);
  print("  first third of the steps", early);
  print("  second third", middle);
  print("  last third", late);
  print("  of which projection", projection);
  print("  of which map, verified", map);
  print("  of which correction", correction);
  print(fmt::format("forecast, {} quantities", project.forecasts.size()), forecast_us);
  return 0;
}
