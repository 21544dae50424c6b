/// @file Time of one update on the beam: the claim of docs/explanation/assimilation.md.
///
/// usage: update_bench PROJECT.toml [REPEATS] [METHOD]   (model and data of the project must be there;
/// bench/run.sh makes them) Prints machine, threads, median, 99th percentile and maximum over all steps and
/// repeats of what the engine does with a datum: posterior, monitor, verdict; forecasts apart.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <numeric>
#include <string>
#include <vector>

#include "knothe/assimilation/engine/engine.hpp"
#include "knothe/project/project_engine.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"

namespace {

using namespace knothe;
using Clock = std::chrono::steady_clock;

/// Of this thread: what a busy machine does not lengthen.
double processor_us() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

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
  project::Project project = project::read_project(argv[1]);
  const int repeats = argc > 2 ? std::atoi(argv[2]) : 10;
  if (argc > 3) project.method.kind = from_text<posterior::Method>(argv[3]).value();
  const project::UpdateSetup setup = project::set_up(project);
  const assimilation::EngineSetup engine_setup = project::engine_setup(project, setup);
  const std::size_t steps = setup.measurements.time.size();
  fmt::print("{}, 1 thread; {} form, r = {}, {} dofs, {} steps, {} repeats, method {}, tolerance {:g}\n",
             processor(), model::to_text(setup.model.contents().form),
             setup.problem.model->functions->count(), setup.problem.model->observations(), steps, repeats,
             to_text(project.method.kind), project.method.update.map.tolerance);
  std::vector<double> all, processor_time, forecast, early, middle, late, posterior, watch, verdict;
  for (int repeat = 0; repeat < repeats + 1; ++repeat) {
    assimilation::Engine engine(engine_setup);
    for (std::size_t i = 0; i < steps; ++i) {
      const likelihood::Datum datum{
          {}, i, setup.time_indices[i], setup.measurements.values.col(static_cast<Eigen::Index>(i)), {}};
      const double processor_start = processor_us();
      const auto start = Clock::now();
      const assimilation::StepResult result = engine.assimilate(datum);
      const double us =
          std::chrono::duration<double, std::micro>(Clock::now() - start).count() - result.forecast_us;
      const double of_processor = processor_us() - processor_start - result.forecast_us;
      if (repeat == 0) continue;  // warm-up: tables are made
      const assimilation::UpdateTimes& times = result.update.elapsed_us;
      all.push_back(us);
      processor_time.push_back(of_processor);
      (i < steps / 3 ? early : i < 2 * steps / 3 ? middle : late).push_back(us);
      posterior.push_back(times.map + times.correction);
      watch.push_back(times.watch);
      verdict.push_back(times.verdict);
      forecast.push_back(result.forecast_us);
    }
  }
  print("datum to verdict, all steps", all);
  print("  of the processor", processor_time);
  print("  first third of the steps", early);
  print("  second third", middle);
  print("  last third", late);
  print("  of which posterior", posterior);
  print("  of which monitor", watch);
  print("  of which verdict", verdict);
  print(fmt::format("forecast, {} quantities", project.forecasts.size()), forecast);
  return 0;
}
