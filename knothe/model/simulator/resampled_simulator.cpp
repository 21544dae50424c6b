#include "knothe/model/simulator/resampled_simulator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/model/simulator/run_file.hpp"

namespace knothe::model {
namespace {

/// An output, or a dof that has a name.
SnapshotOutput output_of(const Snapshots& solution, const std::string& name) {
  std::vector<std::string> known;
  for (const SnapshotOutput& output : solution.outputs) {
    if (output.name == name) return output;
    known.push_back(output.name);
  }
  for (Index i = 0; i < std::ssize(solution.quantities); ++i) {
    known.push_back(solution.quantities[i].name);
    if (known.back() != name) continue;
    SnapshotOutput output{name, {solution.quantities[i].units, ""}, {}};
    for (std::size_t k = i; k < solution.values.size(); k += solution.quantities.size())
      output.values.push_back(solution.values[k]);
    return output;
  }
  throw ProjectError(fmt::format(
      "[offline] time = \"{}\": the full-order model has no such output{}; it has {}", name,
      did_you_mean(name, known), known.empty() ? "none" : fmt::format("{}", fmt::join(known, ", "))));
}

/// Refuses what cannot be an axis, or does not hold the whole of it.
void check_growth(const Snapshots& solution, const SnapshotOutput& output, const TimeAxis& axis) {
  const std::vector<double>& values = output.values;
  const std::string& unit = output.labels.units;
  for (Index i = 1; i < std::ssize(values); ++i)
    if (!(values[i] > values[i - 1]))
      throw NumericalError(fmt::format(
          "{} cannot be the time of [offline]: it must grow from step to step, but is {:g} {} at {:g} after "
          "{:g} {} at {:g}; take an output that grows, more steps, or a smaller box of parameters",
          axis.output, values[i], unit, solution.time[i], values[i - 1], unit, solution.time[i - 1]));
  if (values.back() < axis.values.back())
    throw NumericalError(fmt::format(
        "{} reaches {:g} {} only, and [offline] time_values end at {:g}: let the solver go on further "
        "([offline] displacement), or end the axis before",
        axis.output, values.back(), unit, axis.values.back()));
  if (values.front() > axis.values.front())
    throw NumericalError(fmt::format(
        "{} is {:g} {} at the first step already, and [offline] time_values begin at {:g}: take more steps, "
        "or begin the axis later",
        axis.output, values.front(), unit, axis.values.front()));
}

/// A value of the axis between two steps: (1 − share) at `step` and share at the next one.
struct Place {
  std::size_t step;
  double share;
};

std::vector<Place> places_of(const std::vector<double>& axis, const std::vector<double>& values) {
  std::vector<Place> places;
  for (const double value : axis) {
    const auto above = std::upper_bound(values.begin(), values.end(), value);
    if (above == values.end()) {  // the last step itself
      places.push_back({values.size() - 1, 0});
      continue;
    }
    const std::size_t next = above - values.begin();
    places.push_back({next - 1, (value - values[next - 1]) / (values[next] - values[next - 1])});
  }
  return places;
}

std::vector<double> at_places(const std::vector<double>& values, std::size_t width,
                              const std::vector<Place>& places) {
  std::vector<double> result;
  result.reserve(places.size() * width);
  for (const Place& place : places)
    for (std::size_t i = 0; i < width; ++i) {
      const double before = values[place.step * width + i];
      result.push_back(
          place.share == 0 ? before : before + place.share * (values[(place.step + 1) * width + i] - before));
    }
  return result;
}

}  // namespace

Snapshots resampled(const Snapshots& solution, const TimeAxis& axis) {
  const SnapshotOutput output = output_of(solution, axis.output);
  check_growth(solution, output, axis);
  const std::vector<Place> places = places_of(axis.values, output.values);
  Snapshots result = solution;
  result.time = axis.values;
  result.time_units = output.labels.units;
  result.lift.clear();
  result.values = at_places(solution.values, solution.dof_count(), places);
  for (Index k = 0; k < std::ssize(result.outputs); ++k)
    result.outputs[k].values = at_places(solution.outputs[k].values, 1, places);
  return result;
}

ResampledSimulator::ResampledSimulator(std::unique_ptr<Simulator> simulator, TimeAxis axis)
    : simulator_(std::move(simulator)), axis_(std::move(axis)) {}

std::string ResampledSimulator::key(std::span<const double> parameters) const {
  return fmt::format("{} | at {} {:a}", simulator_->key(parameters), axis_.output,
                     fmt::join(axis_.values, " "));
}

Snapshots ResampledSimulator::solve(std::span<const double> parameters) {
  return resampled(simulator_->solve(parameters), axis_);
}

std::vector<Snapshots> ResampledSimulator::solve_all(std::span<const std::vector<double>> points,
                                                     const std::function<void(std::size_t)>& finished) {
  std::vector<Snapshots> solutions = simulator_->solve_all(points, finished);
  for (Snapshots& solution : solutions) solution = resampled(solution, axis_);
  return solutions;
}

std::optional<Snapshots> ResampledSimulator::frame() const {
  std::optional<Snapshots> frame = simulator_->frame();
  if (!frame) return frame;
  frame->time_units = output_of(*frame, axis_.output).labels.units;
  frame->time = axis_.values;
  frame->lift.clear();
  return frame;
}

std::vector<RunFailure> ResampledSimulator::solve_to_files(std::span<const Run> runs, int processes,
                                                           const std::function<void(std::size_t)>& finished) {
  std::vector<Run> own, missing;
  std::vector<std::size_t> place;  // of `missing` among `runs`
  for (const Run& run : runs) {
    const std::string key = simulator_->key(run.parameters);
    const std::filesystem::path folder = std::filesystem::path(run.file).parent_path();
    own.push_back({run.parameters, key, (folder / fmt::format("full-{:016x}.h5", fnv1a(key))).string()});
    if (is_there(own.back())) continue;
    place.push_back(own.size() - 1);
    missing.push_back(own.back());
  }
  std::vector<RunFailure> failures;
  const auto resample = [&] {
    for (std::size_t i = 0; i < runs.size(); ++i) {
      if (!is_there(own[i])) continue;
      try {
        const FinishedRun run = read_run(own[i]);
        write_run(runs[i], resampled(run.solution, axis_), run.record);
      } catch (const NumericalError& error) {
        failures.push_back({i, error.status(), error.what()});
      }
    }
  };
  try {
    if (!missing.empty())
      failures = simulator_->solve_to_files(
          missing, processes, [&](std::size_t done) { finished(runs.size() - missing.size() + done); });
  } catch (const Interrupted&) {
    resample();
    throw;
  }
  for (RunFailure& failure : failures) failure.run = place[failure.run];
  resample();
  return failures;
}

}  // namespace knothe::model
