#include "knothe/offline/latin/latin_model.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/offline/law/regularisation.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;

namespace {

/// Of LATIN alone: counts up whenever the same options give other results, so that states kept by an older
/// program are not gone on from.
constexpr int k_latin_version = 2;

std::string numbers_of(const LatinOptions& o) {
  return fmt::format(" | LATIN v{} {:a} {:a} {} {} {} {} {} {:a} {:a}", k_latin_version, o.accuracy,
                     o.tolerance, o.window, o.max_modes, o.modes_per_round, o.rounds, o.rescue_round,
                     o.recompression, o.activation);
}

/// Outputs as in as_snapshots; `mouth` (1 × R) observes the crack mouth's opening in the modes.
void add_outputs(const LatinSolution& solution, std::span<const MatrixXd> coordinates, const MatrixXd& mouth,
                 std::vector<model::SnapshotOutput>& outputs) {
  for (Index point = 0; point < std::ssize(coordinates); ++point) {
    const Index p = point;
    const MatrixXd openings = mouth * coordinates[point];
    for (Index step = 0; step < openings.cols(); ++step) {
      outputs[0].values.push_back(solution.reaction(p, step));
      outputs[1].values.push_back(openings(0, step));
      outputs[2].values.push_back(coordinates[point](0, step));
      outputs[3].values.push_back(solution.residual(p, step));
    }
  }
}

/// The body, the grid, and the damage parameters of its points.
struct GridProblem {
  std::shared_ptr<const Structure> structure;
  model::Snapshots frame;
  std::vector<DamageParameters> parameters;
};

GridProblem grid_problem(const BeamProblem& problem, const std::vector<model::Axis>& axes) {
  problem.solver.validate();
  const std::string source = problem.gmsh_file.empty() ? "beam" : problem.gmsh_file;
  GridProblem grid;
  grid.structure = std::make_shared<const Structure>(make_mesh(problem), problem.elastic, source);
  grid.frame = as_snapshots(problem, *grid.structure, {});
  grid.frame.axes = axes;
  for (std::size_t i = 0; i < grid.frame.grid_size(); ++i)
    grid.parameters.push_back(damage_parameters(problem, axes, grid.frame.parameters_at(i)));
  // Before there is a folder: a box in which the law has no solution.
  const HexahedronMesh& mesh = grid.structure->mesh();
  const std::vector<double> ratios =
      band_ratios(mesh, grid.structure->elements(), problem.solver.regularisation);
  for (const DamageParameters& point : grid.parameters)
    check_band(mesh, problem.solver.regularisation, ratios, point);
  return grid;
}

/// The grid, with `options` told where to start from and where an interrupted run leaves its state.
GridProblem prepare(const BeamProblem& problem, const std::vector<model::Axis>& axes,
                    const std::string& parts_folder, const std::string& start_file, LatinOptions& options) {
  GridProblem grid = grid_problem(problem, axes);
  if (!start_file.empty())
    options.start = start_from(model::SeparatedModel::load(start_file), problem, *grid.structure, axes);
  if (parts_folder.empty()) return grid;
  options.key = run_key(problem);
  for (const model::Axis& axis : axes) {
    options.key += fmt::format(" | {} {:a}", axis.name, axis.reference);
    for (const double node : axis.nodes) options.key += fmt::format(" {:a}", node);
  }
  options.key += numbers_of(options);
  if (!options.start.empty()) options.key += fmt::format(" | from {:x}", fingerprint(options.start));
  std::error_code failed;
  std::filesystem::create_directories(parts_folder, failed);
  if (failed)
    throw IoError(
        fmt::format("cannot make the folder {} for an interrupted run: {}", parts_folder, failed.message()));
  options.state_file =
      (std::filesystem::path(parts_folder) / fmt::format("latin-{:016x}.h5", fnv1a(options.key))).string();
  return grid;
}

LatinModel model_of(LatinSolution found, GridProblem grid) {
  LatinModel model;
  model.solution = std::move(found);
  // Modes: the unit lift, then those of LATIN; coordinates (R + 1) × n_t of each grid point.
  const LatinSolution& solution = model.solution;
  const Structure& structure = *grid.structure;
  const Index dofs = structure.dof_count(), steps = std::ssize(solution.coordinates);
  MatrixXd modes(dofs, solution.space.cols() + 1);
  modes.col(0) = Eigen::Map<const Eigen::VectorXd>(structure.unit_lift().data(), dofs);
  modes.rightCols(solution.space.cols()) = solution.space;
  std::vector<MatrixXd> coordinates(grid.parameters.size(), MatrixXd(modes.cols(), steps));
  for (Index point = 0; point < std::ssize(coordinates); ++point)
    for (Index step = 0; step < steps; ++step)
      coordinates[point].col(step) = solution.coordinates[step].col(point);
  MatrixXd lift = MatrixXd::Zero(modes.cols(), steps);
  lift.row(0) = coordinates.front().row(0);

  const auto& mesh = structure.mesh();
  MatrixXd mouth = MatrixXd::Zero(1, modes.cols());
  if (mesh.mouth_left >= 0 && mesh.mouth_right >= 0)
    mouth = modes.row(3 * mesh.mouth_right) - modes.row(3 * mesh.mouth_left);
  add_outputs(solution, coordinates, mouth, grid.frame.outputs);
  model.grid = model::solutions_in_modes(std::move(grid.frame), modes, coordinates, lift);
  model::validate(model.grid.snapshots, "LATIN-PGD");
  return model;
}

}  // namespace

LatinModel solve_latin_grid(const BeamProblem& problem, const std::vector<model::Axis>& axes,
                            LatinOptions options, const std::string& parts_folder,
                            const std::string& start_file) {
  GridProblem grid = prepare(problem, axes, parts_folder, start_file, options);
  LatinSolution solution = solve_latin_pgd(grid.structure, problem.solver, grid.parameters, options);
  if (std::error_code ignored; !parts_folder.empty()) std::filesystem::remove(parts_folder, ignored);
  return model_of(std::move(solution), std::move(grid));
}

std::vector<std::pair<std::size_t, int>> inaccurate_points(const LatinSolution& solution) {
  std::vector<std::pair<std::size_t, int>> result;
  for (Index point = 0; point < solution.accepted.rows(); ++point) {
    const int windows = (solution.accepted.row(point).array() == 0).count();
    if (windows > 0) result.emplace_back(point, windows);
  }
  return result;
}

}  // namespace knothe::offline
