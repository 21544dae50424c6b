#include "knothe/offline/full_order/beam_simulator.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "knothe/base/index.hpp"
#include "knothe/offline/distributed/ranks.hpp"
#include "knothe/offline/full_order/child_processes.hpp"
#include "knothe/offline/law/regularisation.hpp"

namespace knothe::offline {
namespace {

model::RunRecord record_of(const FullOrderResult& result) {
  model::RunRecord record;
  record.numbers = {{"newton_iterations", result.newton_iterations()},
                    {"secant_iterations", result.secant_iterations()},
                    {"cpu_seconds", result.cpu_seconds}};
  record.steps_without_equilibrium = result.steps_without_equilibrium();
  return record;
}

/// Axes of one node each, at this point.
std::vector<model::Axis> axes_at(std::vector<model::Axis> axes, std::span<const double> parameters) {
  for (Index i = 0; i < std::ssize(axes); ++i) axes[i].nodes = {parameters[i]};
  return axes;
}

/// Without what `frame` has.
model::Snapshots part_of(model::Snapshots solution) {
  solution.dofs = {};
  solution.lift.clear();
  solution.mesh.reset();
  return solution;
}

}  // namespace

BeamSimulator::BeamSimulator(BeamProblem problem, std::vector<model::Axis> axes)
    : problem_(std::move(problem)),
      axes_(std::move(axes)),
      model_(make_full_order_model(problem_)),
      band_ratios_(band_ratios(structure().mesh(), structure().elements(), problem_.solver.regularisation)) {}

std::string BeamSimulator::key(std::span<const double> parameters) const {
  return run_key(problem_at(problem_, axes_, parameters));
}

void BeamSimulator::check(std::span<const double> parameters) const {
  check_band(structure().mesh(), problem_.solver.regularisation, band_ratios_,
             problem_at(problem_, axes_, parameters).reference);
}

std::optional<model::Snapshots> BeamSimulator::frame() const {
  return as_snapshots(problem_, structure(), {});
}

model::Snapshots BeamSimulator::solve(std::span<const double> parameters) {
  const BeamProblem point = problem_at(problem_, axes_, parameters);
  model::Snapshots solution = as_snapshots(point, structure(), run_at(model_, problem_, axes_, parameters));
  solution.axes = axes_at(axes_, parameters);
  return solution;
}

std::vector<model::RunFailure> BeamSimulator::solve_to_files(
    std::span<const model::Run> runs, int processes, const std::function<void(std::size_t)>& finished) {
  std::vector<BeamProblem> problems;
  for (const model::Run& run : runs) problems.push_back(problem_at(problem_, axes_, run.parameters));
  std::vector<std::size_t> missing(runs.size());
  std::iota(missing.begin(), missing.end(), std::size_t{0});
  std::size_t done = 0;
  // A model is made here and not in the forked processes, where deal.II's threads (TBB) do not survive.
  while (!missing.empty()) {
    const BeamProblem& body = problems[missing.front()];
    const auto others = std::stable_partition(missing.begin(), missing.end(),
                                              [&](std::size_t i) { return same_body(problems[i], body); });
    const std::vector<std::size_t> now(missing.begin(), others);
    missing.erase(missing.begin(), others);
    std::optional<FullOrderModel> own;
    if (!same_body(body, problem_)) own = make_full_order_model(body);
    FullOrderModel& model = own ? *own : model_;
    const auto compute = [&](int job) {
      const std::size_t i = now[job];
      const FullOrderResult result = model.run(problems[i].reference);
      model::Snapshots solution = part_of(as_snapshots(problems[i], structure(), result));
      solution.axes = axes_at(axes_, runs[i].parameters);
      model::write_run(runs[i], solution, record_of(result));
    };
    try {
      run_in_processes(
          now.size(), processes, compute, [&](int count) { finished(done + count); },
          [] { return std::string(); });
    } catch (const JobFailure& failure) {
      const auto status = static_cast<ExitStatus>(failure.exit_status);
      if (status == ExitStatus::interrupted) throw Interrupted(failure.message);
      const std::string hint =
          status == ExitStatus::io
              ? ""
              : " (killed by signal 9 usually means that memory ran out: use fewer processes)";
      return {{now[failure.job], status, failure.message + hint}};
    }
    done += now.size();
  }
  return {};
}

model::JobShare share_of_ranks() {
  const Ranks ranks = Ranks::of_this_job();
  return {ranks.rank, ranks.size, [ranks] { ranks.wait(); }};
}

model::GridRuns run_snapshots(const BeamProblem& problem, const model::RunGrid& grid) {
  BeamSimulator beam(problem, grid.axes);
  return model::run_grid(beam, grid, share_of_ranks());
}

}  // namespace knothe::offline
