#include "knothe/offline/similar_runs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/grid/registered_solutions.hpp"
#include "knothe/offline/problem.hpp"

namespace knothe::offline {
namespace {

using Eigen::MatrixXd;

/// The runs go on to so many times the last displacement.
constexpr double k_longer = 1.15;
/// Fields of the runs that their space modes are computed from, at most.
constexpr Index k_samples = 1500;
/// What the space modes leave out of these, relative; far below all other errors.
constexpr double k_left_out = 1e-7;

/// Number of the axis of this name; −1 without.
Index axis_of(const std::vector<model::Axis>& axes, std::string_view name) {
  const auto found = std::ranges::find(axes, name, &model::Axis::name);
  return found == axes.end() ? -1 : found - axes.begin();
}

int steps_of_runs(int steps) {
  return std::lround(steps * k_longer);
}

/// So many steps up to the last displacement, and further ones.
BeamProblem going_on(BeamProblem problem, int steps) {
  problem.solver.steps = steps_of_runs(steps);
  problem.solver.displacement *= 1.0 * problem.solver.steps / steps;
  return problem;
}

bool is_residual(const model::SnapshotOutput& output) {
  return output.name == "equilibrium_residual";
}

/// The runs in an orthonormal basis of space modes.
struct ReducedRuns {
  MatrixXd modes;                              ///< n_dof × R
  std::vector<model::History> histories;       ///< rows: coordinates of u − lift, outputs
  std::vector<model::SnapshotOutput> outputs;  ///< their names and units
  double largest_left_out = 0;
};

/// u − u_lift, n_dof × n.
MatrixXd deviation(const model::Snapshots& solution, const Eigen::VectorXd& unit_lift,
                   const std::vector<double>& time) {
  const Eigen::Map<const Eigen::RowVectorXd> t(time.data(), std::ssize(time));
  const Eigen::Map<const MatrixXd> field(solution.values.data(), unit_lift.size(), t.size());
  return field - unit_lift * t;
}

ReducedRuns reduced(const std::vector<model::Run>& runs, const Eigen::VectorXd& unit_lift,
                    const std::vector<double>& time) {
  ReducedRuns result;
  const Index steps = std::ssize(time), every = (std::ssize(runs) * steps + k_samples - 1) / k_samples;
  const Index sampled = (steps + every - 1) / every;
  MatrixXd samples(unit_lift.size(), sampled * std::ssize(runs));
  for (Index j = 0; j < std::ssize(runs); ++j) {
    const MatrixXd u = deviation(model::read_run(runs[j]).solution, unit_lift, time);
    for (Index k = 0; k < sampled; ++k) samples.col(j * sampled + k) = u.col(steps - 1 - k * every);
  }
  result.modes = model::dominant_space(samples, k_left_out * k_left_out * samples.squaredNorm(), 1, 0).basis;
  for (const model::Run& run : runs) {
    const model::Snapshots solution = model::read_run(run).solution;
    const MatrixXd u = deviation(solution, unit_lift, time), c = result.modes.transpose() * u;
    result.largest_left_out = std::max(result.largest_left_out, (u - result.modes * c).cwiseAbs().maxCoeff());
    model::History history{time, {}, MatrixXd(c.rows() + std::ssize(solution.outputs) - 1, steps)};
    history.values.topRows(c.rows()) = c;
    result.outputs.clear();
    for (const model::SnapshotOutput& output : solution.outputs) {
      if (is_residual(output)) continue;
      const Eigen::Map<const Eigen::RowVectorXd> values(output.values.data(), steps);
      history.values.row(c.rows() + std::ssize(result.outputs)) = values;
      if (output.name == "reaction_force")
        for (Index i = 0; i < steps; ++i) history.state.push_back(values[i] / time[i]);  // secant stiffness
      result.outputs.push_back({output.name, output.labels, {}});
    }
    result.histories.push_back(std::move(history));
  }
  return result;
}

/// The nodes and runs that are left where some failed.
void leave_out(const std::vector<std::size_t>& failed, std::vector<std::vector<double>>& nodes,
               std::vector<model::Run>& runs) {
  if (failed.empty()) return;
  std::vector<std::size_t> shape;
  for (const std::vector<double>& axis : nodes) shape.push_back(axis.size());
  const std::vector<std::vector<std::size_t>> kept = model::grid_without(shape, failed);
  std::vector<model::Run> left;
  for (Index i = 0; i < std::ssize(runs); ++i) {
    std::size_t rest = i;
    bool is_left = true;
    for (std::size_t a = shape.size(); a-- > 0; rest /= shape[a])
      is_left = is_left && std::ranges::binary_search(kept[a], rest % shape[a]);
    if (is_left) left.push_back(runs[i]);
  }
  for (Index a = 0; a < std::ssize(nodes); ++a) {
    if (kept[a].front() != 0 || kept[a].back() != shape[a] - 1)
      throw NumericalError(
          "a full-order run at an end of the box failed, and nothing is extrapolated: make the box of "
          "[offline.parameters] smaller (finished runs are kept)");
    std::vector<double> rest;
    for (const std::size_t k : kept[a]) rest.push_back(nodes[a][k]);
    nodes[a] = std::move(rest);
  }
  runs = std::move(left);
}

/// The solution at one point: coordinates in the lift and the space modes as values, and outputs.
model::Snapshots solution_at(const model::RegisteredSolutions& registered, const ReducedRuns& runs,
                             const Similarity& similarity, const std::vector<double>& parameters,
                             const std::vector<double>& times) {
  const auto [amplitude, modulus] = similarity.factors(parameters);
  std::vector<double> scaled = times;
  for (double& t : scaled) t /= amplitude;
  const MatrixXd values = amplitude * registered.at(similarity.invariants(parameters), scaled);
  const Index modes = runs.modes.cols(), n = std::ssize(times);
  model::Snapshots solution;
  solution.time = times;
  solution.values.resize(n * (1 + modes));
  Eigen::Map<MatrixXd> coordinates(solution.values.data(), 1 + modes, n);
  coordinates.row(0) = Eigen::Map<const Eigen::RowVectorXd>(times.data(), n);
  coordinates.bottomRows(modes) = values.topRows(modes);
  solution.outputs = runs.outputs;
  for (Index k = 0; k < std::ssize(solution.outputs); ++k) {
    const double factor = solution.outputs[k].name == "reaction_force" ? modulus : 1;
    const Eigen::RowVectorXd row = factor * values.row(modes + k);
    solution.outputs[k].values.assign(row.begin(), row.end());
  }
  for (const double parameter : parameters) solution.axes.push_back({"", {parameter}, "1", ""});
  return solution;
}

}  // namespace

Similarity::Similarity(const BeamProblem& problem, std::vector<model::Axis> axes, int runs)
    : axes_(std::move(axes)), threshold_(axis_of(axes_, "Y0")), modulus_(-1), brittleness_power_(1) {
  brittleness_ = axis_of(axes_, "Gf");
  if (brittleness_ >= 0)
    brittleness_power_ = -1;
  else
    brittleness_ = axis_of(axes_, "Ad");
  if (threshold_ < 0 || brittleness_ < 0) threshold_ = brittleness_ = -1;
  if (problem.beam.support_stiffness == 0 && axis_of(axes_, "support_stiffness") < 0)
    modulus_ = axis_of(axes_, "E");
  if (threshold_ >= 0) {
    const auto product = [&](bool least) {
      const std::vector<double>&y0 = axes_[threshold_].nodes, &other = axes_[brittleness_].nodes;
      return std::log(least ? y0.front() : y0.back()) +
             brittleness_power_ * std::log(least == (brittleness_power_ > 0) ? other.front() : other.back());
    };
    nodes_.emplace_back();
    for (int i = 0; i < runs; ++i)
      nodes_[0].push_back(product(true) + (product(false) - product(true)) * i / (runs - 1));
  }
  for (Index i = 0; i < std::ssize(axes_); ++i)
    if (!is_scaled(i)) nodes_.push_back(axes_[i].nodes);
}

std::vector<double> Similarity::invariants(std::span<const double> parameters) const {
  std::vector<double> q;
  if (threshold_ >= 0)
    q.push_back(std::log(parameters[threshold_]) + brittleness_power_ * std::log(parameters[brittleness_]));
  for (Index i = 0; i < std::ssize(axes_); ++i)
    if (!is_scaled(i)) q.push_back(parameters[i]);
  return q;
}

std::vector<double> Similarity::exponents() const {
  if (threshold_ < 0) return {};
  std::vector<double> exponents(axes_.size(), 0.0);
  exponents[threshold_] = 1;
  exponents[brittleness_] = brittleness_power_;
  return exponents;
}

std::vector<std::vector<double>> Similarity::points() const {
  std::vector<std::vector<double>> grid = {{}};  // in invariants
  for (const std::vector<double>& axis : nodes_) {
    std::vector<std::vector<double>> finer;
    for (const std::vector<double>& before : grid)
      for (const double node : axis) {
        finer.push_back(before);
        finer.back().push_back(node);
      }
    grid = std::move(finer);
  }
  std::vector<std::vector<double>> points;
  for (const std::vector<double>& q : grid) {
    std::vector<double> point(axes_.size());
    Index next = threshold_ >= 0 ? 1 : 0;
    for (Index i = 0; i < std::ssize(axes_); ++i) {
      const double least = threshold_ >= 0 ? axes_[threshold_].nodes.front() : 0;
      if (i == threshold_)
        point[i] = least;
      else if (i == brittleness_)
        point[i] = std::exp(brittleness_power_ * (q[0] - std::log(least)));
      else
        point[i] = i == modulus_ ? axes_[i].nodes.back() : q[next++];
    }
    points.push_back(std::move(point));
  }
  return points;
}

Similarity::Factors Similarity::factors(std::span<const double> parameters) const {
  const double modulus = modulus_ < 0 ? 1 : parameters[modulus_] / axes_[modulus_].nodes.back();
  const double threshold = threshold_ < 0 ? 1 : parameters[threshold_] / axes_[threshold_].nodes.front();
  return {std::sqrt(threshold / modulus), modulus};
}

SimilarRuns::SimilarRuns(const project::Project& project)
    : similarity(beam_problem(project), parameter_axes(project), project.offline->scaling_runs),
      solver(going_on(beam_problem(project), project.offline->scaling_steps), parameter_axes(project)) {
  const int steps = project.offline->scaling_steps;
  for (int i = 1; i <= steps_of_runs(steps); ++i) time.push_back(1.0 * i / steps);
}

namespace {

/// The project's grid, filled.
model::GridSolutions fill(const project::Project& project, const SimilarRuns& similar,
                          const std::vector<std::vector<double>>& nodes,
                          const std::vector<model::Run>& runs) {
  const project::OfflineOptions& options = *project.offline;
  const std::vector<model::Axis> axes = parameter_axes(project);
  model::Snapshots frame = *BeamSimulator(beam_problem(project), axes).frame();
  frame.axes = axes;
  const Eigen::VectorXd unit_lift =  // at time 1
      Eigen::Map<const MatrixXd>(frame.lift.data(), std::ssize(frame.dofs.components), std::ssize(frame.time))
          .rightCols(1);
  ReducedRuns reduced_runs = reduced(runs, unit_lift, similar.time);
  const model::RegisteredSolutions registered(nodes, std::move(reduced_runs.histories));
  const bool is_resampled = !options.time.output.empty();
  std::vector<double> times = frame.time;
  if (is_resampled) times.assign(similar.time.begin(), similar.time.begin() + options.scaling_steps);
  std::vector<model::Snapshots> solutions(frame.grid_size());
  parallel_for(solutions.size(), 0, [&](std::size_t g) {
    solutions[g] = solution_at(registered, reduced_runs, similar.similarity, frame.parameters_at(g), times);
    if (is_resampled) solutions[g] = model::resampled(solutions[g], options.time);
  });
  frame.time = solutions[0].time;
  if (is_resampled) frame.time_units = solutions[0].time_units;
  frame.outputs = reduced_runs.outputs;
  std::vector<MatrixXd> coordinates;
  MatrixXd lift = MatrixXd::Zero(1 + reduced_runs.modes.cols(), std::ssize(frame.time));
  for (const model::Snapshots& solution : solutions) {
    coordinates.emplace_back(Eigen::Map<const MatrixXd>(solution.values.data(), lift.rows(), lift.cols()));
    for (Index k = 0; k < std::ssize(frame.outputs); ++k)
      frame.outputs[k].values.insert(frame.outputs[k].values.end(), solution.outputs[k].values.begin(),
                                     solution.outputs[k].values.end());
    if (is_resampled) lift += coordinates.back() / solutions.size();
  }
  if (!is_resampled) lift.row(0) = Eigen::Map<const Eigen::RowVectorXd>(times.data(), lift.cols());
  MatrixXd modes(unit_lift.size(), lift.rows());
  modes << unit_lift, reduced_runs.modes;
  model::GridSolutions filled = model::solutions_in_modes(std::move(frame), modes, coordinates, lift);
  filled.largest_left_out = reduced_runs.largest_left_out;
  return filled;
}

}  // namespace

SolvedGrid solve_similar_grid(const project::Project& project, const std::string& parts_folder,
                              const files::CommandOutput& output) {
  const model::RunGrid grid = run_grid_of(project, parts_folder);
  SimilarRuns similar(project);
  const model::JobShare share = share_of_ranks();
  const std::vector<std::vector<double>> points = similar.similarity.points();
  model::PointRuns runs = model::run_points(similar.solver, grid, points, share);
  SolvedGrid solved;
  solved.failed = runs.failed.size();
  solved.solutions.snapshots.axes = grid.axes;  // all that other ranks need
  if (share.rank != 0) return solved;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (std::ranges::binary_search(runs.failed, i)) continue;
    const bool is_new = std::ranges::binary_search(runs.computed, i);
    report_run({points[i], !is_new, model::read_record(runs.runs[i])}, output);
  }
  output.text(fmt::format("{} full-order runs ({} reused from an earlier call)", points.size(),
                          points.size() - runs.computed.size()));
  std::vector<std::vector<double>> nodes = similar.similarity.nodes();
  leave_out(runs.failed, nodes, runs.runs);
  solved.solutions = fill(project, similar, nodes, runs.runs);
  return solved;
}

}  // namespace knothe::offline
