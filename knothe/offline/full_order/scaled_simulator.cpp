#include "knothe/offline/full_order/scaled_simulator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"

namespace knothe::offline {
namespace {

BeamProblem with_finer_steps(BeamProblem problem, int substeps) {
  problem.solver.steps *= substeps;
  return problem;
}

/// Number of the axis of this name; −1 without.
Index axis_of(const std::vector<model::Axis>& axes, std::string_view name) {
  const auto found = std::ranges::find(axes, name, &model::Axis::name);
  return found == axes.end() ? -1 : found - axes.begin();
}

/// The same number for products that differ by rounding.
double rounded(double product) {
  constexpr double k_parts = 1e11;
  return std::exp(std::round(std::log(product) * k_parts) / k_parts);
}

/// The axis whose product with that of Y₀ counts, and the power of its parameter in it.
struct Brittleness {
  Index axis = -1;
  double power = 1;
};
Brittleness brittleness_axis(const std::vector<model::Axis>& axes) {
  const Index fracture_energy = axis_of(axes, "Gf");  // A_d ∝ 1 / G_f
  return fracture_energy < 0 ? Brittleness{axis_of(axes, "Ad"), 1} : Brittleness{fracture_energy, -1};
}

/// Where a step of the wanted times is among those that were solved: between number `before` (0: nothing is
/// loaded) and the next.
struct Place {
  Index before;
  double share;  ///< of the next
};
Place place_of(double steps) {
  const Index nearest = std::round(steps), below = std::floor(steps);
  if (std::abs(steps - nearest) < 1e-9) return {nearest, 0};
  return {below, steps - below};
}

}  // namespace

ScaledSimulator::ScaledSimulator(const BeamProblem& problem, std::vector<model::Axis> axes, int substeps)
    : problem_(problem),
      axes_(std::move(axes)),
      substeps_(substeps),
      reference_(with_finer_steps(problem, substeps), axes_),
      frame_(*reference_.frame()),
      scales_modulus_(problem.beam.support_stiffness == 0 && axis_of(axes_, "support_stiffness") < 0) {
  frame_.time = model_time(problem.solver);
  const std::size_t n_dof = frame_.dofs.components.size();
  std::vector<double> lift;  // of every `substeps`-th step
  for (std::size_t i = 1; i <= frame_.time.size(); ++i) {
    const auto row = frame_.lift.begin() + (i * substeps - 1) * n_dof;
    lift.insert(lift.end(), row, row + n_dof);
  }
  frame_.lift = std::move(lift);
}

std::vector<double> ScaledSimulator::reference_of(std::span<const double> parameters) const {
  std::vector<double> reference(parameters.begin(), parameters.end());
  if (const Index modulus = axis_of(axes_, "E"); modulus >= 0 && scales_modulus_)
    reference[modulus] = axes_[modulus].nodes.back();
  const Index threshold = axis_of(axes_, "Y0");
  const auto [other, power] = brittleness_axis(axes_);
  if (threshold < 0 || other < 0) return reference;
  const double product = rounded(parameters[threshold] * std::pow(parameters[other], power));
  const std::vector<double>& nodes = axes_[other].nodes;
  const double most_brittle = std::pow(power > 0 ? nodes.back() : nodes.front(), power);
  reference[threshold] = std::max(axes_[threshold].nodes.front(), product / most_brittle);
  reference[other] = std::clamp(std::pow(product / reference[threshold], power), nodes.front(), nodes.back());
  return reference;
}

std::string ScaledSimulator::key(std::span<const double> parameters) const {
  const BeamProblem point = problem_at(problem_, axes_, parameters);
  return fmt::format("{} | scaled from: {}", run_key(point), reference_.key(reference_of(parameters)));
}

model::Snapshots ScaledSimulator::solve(std::span<const double> parameters) {
  const std::vector<double> solved = reference_of(parameters);
  model::Snapshots solution = scaled({reference_.solve(solved), {}}, solved, parameters).solution;
  solution.dofs = frame_.dofs;
  solution.lift = frame_.lift;
  solution.mesh = frame_.mesh;
  return solution;
}

model::FinishedRun ScaledSimulator::scaled(const model::FinishedRun& reference,
                                           std::span<const double> solved,
                                           std::span<const double> parameters) const {
  const BeamProblem from = problem_at(problem_, axes_, solved), to = problem_at(problem_, axes_, parameters);
  const double modulus = to.elastic.young_modulus / from.elastic.young_modulus;
  const double amplitude = std::sqrt(to.reference.threshold / from.reference.threshold / modulus);
  model::FinishedRun run;
  run.record.numbers = reference.record.numbers;
  model::Snapshots& solution = run.solution;
  solution.time = frame_.time;
  solution.axes = axes_;
  for (Index k = 0; k < std::ssize(axes_); ++k) solution.axes[k].nodes = {parameters[k]};
  const std::size_t n_dof = frame_.dofs.components.size();
  solution.values.assign(frame_.time.size() * n_dof, 0.0);
  for (const model::SnapshotOutput& output : reference.solution.outputs)
    solution.outputs.push_back({output.name, output.labels, {}});
  const std::vector<int>& loose = reference.record.steps_without_equilibrium;
  for (std::size_t i = 0; i < frame_.time.size(); ++i) {
    const auto [before, share] = place_of((i + 1) * substeps_ / amplitude);
    const auto add = [&](Index step, double weight) {  // step numbers from 1
      if (step == 0 || weight == 0) return;
      const double* const from_row = &reference.solution.values[(step - 1) * n_dof];
      double* const to_row = &solution.values[i * n_dof];
      for (std::size_t j = 0; j < n_dof; ++j) to_row[j] += weight * from_row[j];
    };
    add(before, amplitude * (1 - share));
    add(before + 1, amplitude * share);
    for (std::size_t k = 0; k < solution.outputs.size(); ++k) {
      const std::vector<double>& values = reference.solution.outputs[k].values;
      const double left = before > 0 ? values[before - 1] : 0, right = share > 0 ? values[before] : left;
      const bool is_residual = solution.outputs[k].name == "equilibrium_residual";
      const double factor = solution.outputs[k].name == "reaction_force" ? modulus * amplitude : amplitude;
      solution.outputs[k].values.push_back(is_residual ? std::max(left, right)
                                                       : factor * ((1 - share) * left + share * right));
    }
    if (std::ranges::count(loose, before - 1) + (share > 0 ? std::ranges::count(loose, before) : 0) > 0)
      run.record.steps_without_equilibrium.push_back(i);
  }
  return run;
}

std::vector<model::RunFailure> ScaledSimulator::solve_to_files(
    std::span<const model::Run> runs, int processes, const std::function<void(std::size_t)>& finished) {
  std::map<std::vector<double>, std::vector<std::size_t>> groups;
  for (std::size_t i = 0; i < runs.size(); ++i) groups[reference_of(runs[i].parameters)].push_back(i);
  std::vector<model::Run> all, missing;
  std::vector<std::size_t> first;  // run of each that is missing
  for (const auto& [point, members] : groups) {
    const std::string key = reference_.key(point);
    const auto folder = std::filesystem::path(runs[members[0]].file).parent_path();
    all.push_back({point, key, (folder / fmt::format("run-steps-{:016x}.h5", fnv1a(key))).string()});
    if (model::is_there(all.back())) continue;
    missing.push_back(all.back());
    first.push_back(members[0]);
  }
  std::vector<model::RunFailure> failures = reference_.solve_to_files(
      missing, processes, [&](std::size_t count) { finished(count * runs.size() / missing.size()); });
  if (!failures.empty()) {
    for (model::RunFailure& failure : failures) failure.run = first[failure.run];
    return failures;
  }
  for (std::size_t g = 0; const auto& [point, members] : groups) {
    const model::FinishedRun reference = model::read_run(all[g++]);
    for (const std::size_t i : members) {
      const model::FinishedRun run = scaled(reference, point, runs[i].parameters);
      model::write_run(runs[i], run.solution, run.record);
    }
  }
  for (const model::Run& run : all) {
    std::error_code ignored;
    std::filesystem::remove(run.file, ignored);
  }
  finished(runs.size());
  return {};
}

void space_by_ratio(std::vector<model::Axis>& axes) {
  const Index threshold = axis_of(axes, "Y0"), other = brittleness_axis(axes).axis;
  if (threshold < 0 || other < 0) return;
  std::vector<double> steps;
  for (const Index k : {threshold, other}) {
    std::vector<double>& nodes = axes[k].nodes;
    const double lower = nodes.front(), upper = nodes.back(), intervals = std::ssize(nodes) - 1;
    steps.push_back(std::log(upper / lower) / intervals);
    for (Index i = 1; i + 1 < std::ssize(nodes); ++i) nodes[i] = lower * std::exp(steps.back() * i);
  }
  if (std::abs(steps[0] - steps[1]) > 1e-9 * steps[0])
    throw ProjectError(
        fmt::format("[offline] scaling = \"on\": runs serve several points where the nodes of Y0 and {} have "
                    "the same ratio, "
                    "(upper / lower)^(1 / (nodes - 1)); it is {:.4g} for Y0 and {:.4g} for {}: choose their "
                    "numbers of nodes, "
                    "or their ends, so that it is the same",
                    axes[other].name, std::exp(steps[0]), std::exp(steps[1]), axes[other].name));
}

}  // namespace knothe::offline
