#include "knothe/offline/distributed/distributed_model.hpp"

#include <fmt/format.h>
#include <sys/resource.h>

#include <ctime>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/offline/distributed/distributed_body.hpp"

namespace knothe::offline {
namespace {

/// MiB, the most that this process has had.
double memory() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss / 1024.0;
}

void prescribe(DistributedBody& body) {
  const HexahedronMesh& mesh = body.part.mesh;
  const std::size_t dofs = 3 * mesh.node_count();
  body.prescribed.assign(dofs, 0);
  body.unit_prescribed.assign(dofs, 0.0);
  const auto hold = [&](const NodeSet& nodes, int component) {
    for (const auto node : nodes) body.prescribed[3 * node + component] = 1;
  };
  hold(mesh.support_left, 1);
  hold(mesh.support_right, 1);
  hold(mesh.left_support == LeftSupport::left_face ? mesh.left_face : mesh.support_left, 0);
  hold(mesh.symmetry, 2);
  hold(mesh.load, 1);
  for (const auto node : mesh.load) body.unit_prescribed[3 * node + 1] = -1.0;
}

/// K u with the elastic stiffness.
std::vector<double> elastic_force(const DistributedBody& body, std::span<const double> displacement) {
  std::vector<double> force(displacement.size(), 0.0);
  for (std::int64_t cell = 0; cell < body.part.mesh.cell_count(); ++cell) {
    const CellVector u = body.gather(displacement, cell);
    CellVector sum{};
    for (int point = 0; point < k_points_per_cell; ++point) {
      const double* gradient = body.elements.gradient(cell, point);
      add_internal_force(gradient,
                         elastic_stress(strain_at(gradient, u), body.elastic.lambda(), body.elastic.mu()),
                         body.elements.weight(cell, point), sum);
    }
    body.scatter(sum, cell, force);
  }
  return force;
}

}  // namespace

struct DistributedModel::Implementation {
  HexahedronMesh coarse;
  SolverOptions options;
  DistributedBody body;
  DistributedElastic elastic;

  /// Values of owned nodes → at the nodes of the given mesh, on every rank.
  [[nodiscard]] std::vector<double> at_coarse_nodes(std::span<const double> values) const {
    std::vector<double> result(coarse.points.size(), 0.0);
    for (const auto& [number, node] : body.part.coarse_nodes)
      for (int c = 0; c < 3; ++c) result[3 * number + c] = values[3 * node + c];
    body.ranks.sum(result.data(), result.size());
    return result;
  }

  [[nodiscard]] std::vector<double> mean_of_coarse_cells(std::span<const double> values) const {
    const std::size_t cells = coarse.cell_count();
    std::vector<double> result(cells, 0.0);
    const double share = static_cast<double>(cells) / body.part.total_cells;
    for (std::int64_t cell = 0; cell < body.part.owned_cells; ++cell)
      result[body.part.coarse_cell[cell]] += share * values[cell];
    body.ranks.sum(result.data(), cells);
    return result;
  }

  void solve_elastic(const LinearOptions& linear) {
    const std::size_t owned = body.owned_dofs();
    std::vector<double> right = elastic_force(body, body.unit_prescribed);
    right.resize(owned);
    for (std::size_t dof = 0; dof < owned; ++dof) right[dof] = body.prescribed[dof] != 0 ? 0.0 : -right[dof];
    std::vector<double>& lift = body.unit_lift;
    lift.assign(body.unit_prescribed.size(), 0.0);
    const LinearSolve solve = body.system->solve(right, lift, linear.tolerance, linear.max_iterations);
    if (!solve.converged)
      throw NumericalError(
          fmt::format("distributed model: after {} iterations of conjugate gradients the elastic solution "
                      "leaves {:.2g} of its right-hand side, {:.2g} was asked for: elements that are long "
                      "and thin hurt multigrid; take more layers, or allow more iterations",
                      solve.iterations, solve.residual, linear.tolerance));
    for (std::size_t dof = 0; dof < owned; ++dof) lift[dof] += body.unit_prescribed[dof];
    body.system->update_ghosts(lift);
    body.unit_reaction = body.reaction(elastic_force(body, lift));
    elastic.iterations = solve.iterations;
    elastic.residual = solve.residual;
    elastic.unit_reaction = 2 * body.unit_reaction;
    elastic.unit_lift = at_coarse_nodes(lift);
  }
};

DistributedModel::DistributedModel(const HexahedronMesh& mesh, const ElasticConstants& constants,
                                   const SolverOptions& options, int refinements, const LinearOptions& linear)
    : implementation_(std::make_unique<Implementation>()) {
  constants.validate();
  options.validate();
  validate(mesh, "distributed model");
  if (mesh.support_stiffness != 0)
    throw ProjectError("distributed model: supports with springs are not in it: leave out support_stiffness");
  auto& [coarse, solver_options, body, elastic] = *implementation_;
  coarse = mesh;
  solver_options = options;
  const MonotonicTime start = monotonic_now();
  body.elastic = constants;
  body.ranks = Ranks::start();
  body.part = distribute_mesh(mesh, refinements);
  elastic.cells = body.part.total_cells;
  elastic.dofs = 3 * body.part.total_nodes;
  elastic.ranks = body.ranks.size;
  if (body.ranks.max(body.part.owned_cells == 0 ? 1 : 0) > 0)
    throw ProjectError(
        fmt::format("distributed model: {} ranks for {} cells leave ranks without any: take fewer",
                    body.ranks.size, elastic.cells));
  body.elements = evaluate_finite_elements(body.part.mesh.points, body.part.mesh.cells);
  prescribe(body);
  body.system = make_distributed_system(body.part, body.prescribed);
  body.system->set_symmetric(
      [&](std::int64_t cell, CellMatrix& matrix) { body.secant_matrix(cell, {}, matrix); });
  elastic.set_up_seconds = body.ranks.max(1e-6 * microseconds_since(start));
  const MonotonicTime solving = monotonic_now();
  implementation_->solve_elastic(linear);
  elastic.solve_seconds = body.ranks.max(1e-6 * microseconds_since(solving));
  elastic.largest_memory = body.ranks.max(memory());
  elastic.memory_of_all = body.ranks.sum(memory());
}

DistributedModel::~DistributedModel() = default;

const DistributedElastic& DistributedModel::elastic() const {
  return implementation_->elastic;
}

FullOrderResult DistributedModel::run(const DamageParameters& parameters,
                                      const std::function<void(int, const StepRecord&)>& on_step) {
  parameters.validate();
  auto& [coarse, options, body, elastic] = *implementation_;
  if (options.regularisation.kind == DamageRegularisation::gradient)
    throw ProjectError(
        "distributed model: gradient damage is not in it; take [offline] damage = { regularisation = "
        "\"crack-band\" } or none");
  const std::vector<double> ratios = band_ratios(body.part.mesh, body.elements, options.regularisation);
  check_band(body.part.mesh, options.regularisation, ratios, parameters);
  const std::clock_t start = std::clock();
  DistributedStepping loading(body, options, parameters, ratios);
  FullOrderResult result;
  for (int step = 0; step < options.steps; ++step) {
    check_cancellation(
        fmt::format("step {} of {} of a full-order run; nothing of this run is kept", step, options.steps));
    result.steps.push_back(loading.advance(options.displacement * (step + 1) / options.steps));
    const std::vector<double> displacement = implementation_->at_coarse_nodes(loading.displacement());
    result.displacement.insert(result.displacement.end(), displacement.begin(), displacement.end());
    if (on_step) on_step(step, result.steps.back());
  }
  result.cell_damage = implementation_->mean_of_coarse_cells(loading.cell_damage());
  result.crack_length =
      crack_length(coarse, evaluate_finite_elements(coarse.points, coarse.cells), result.cell_damage);
  result.cpu_seconds = body.ranks.sum(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  return result;
}

}  // namespace knothe::offline
