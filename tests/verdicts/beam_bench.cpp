#include "tests/verdicts/beam_bench.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/likelihood/data/synthetic_measurements.hpp"
#include "knothe/model/compress/compression.hpp"
#include "knothe/model/observe/observation_operator.hpp"
#include "knothe/model/observe/scalar_observations.hpp"
#include "knothe/offline/problem.hpp"

namespace knothe::verdicts {

using Eigen::Index;

namespace {

std::vector<model::Axis> axes_with(int nodes) {
  return {offline::parameter_axis("Y0", 216.0, 0.5, 1.5, nodes),
          offline::parameter_axis("Ad", 2.25e-3, 0.5, 1.5, nodes)};
}

model::ScalarObservation force() {
  model::ScalarObservation sensor;
  sensor.name = sensor.output = "reaction_force";
  return sensor;
}

}  // namespace

offline::BeamProblem modelled_beam() {
  offline::BeamProblem problem;
  problem.beam.element = 0.01;
  problem.solver.steps = static_cast<int>(k_steps);
  problem.reference.threshold = 216.0;
  problem.reference.brittleness = 2.25e-3;
  return problem;
}

BeamBench::BeamBench() : axes_(axes_with(9)) {
  likelihood::DofSelection selection;
  selection.x_range = {-0.12, 0.12};
  const model::Dofs all = offline::dofs(offline::make_mesh(modelled_beam()));
  for (const std::size_t dof : likelihood::choose_dofs(all, selection, 1))
    sensors_.add(all.point(dof), all.components[dof]);
}

offline::FullOrderModel& BeamBench::solver(const Structure& structure) {
  const auto it = solvers_.find(structure.name);
  if (it != solvers_.end()) return it->second;
  return solvers_.emplace(structure.name, offline::make_full_order_model(structure.problem)).first->second;
}

History BeamBench::at_sensors(const offline::FullOrderModel& model,
                              const offline::FullOrderResult& result) const {
  const auto& mesh = model.structure().mesh();
  const model::ObservationOperator at(offline::dofs(mesh), offline::mesh_of(mesh), "the beam", sensors_);
  const auto times = static_cast<Index>(result.steps.size());
  const Eigen::Map<const Eigen::MatrixXd> field(
      result.displacement.data(), static_cast<Index>(result.displacement.size()) / times, times);
  History history(at.rows() + 1, times);
  history.topRows(at.rows()) = at.apply(field);
  for (Index t = 0; t < times; ++t)
    history(at.rows(), t) = result.steps[static_cast<std::size_t>(t)].reaction_force;
  return history;
}

const History& BeamBench::history(const Structure& structure, const Eigen::Vector2d& p) {
  const std::string key = fmt::format("{} {:.17g} {:.17g}", structure.name, p[0], p[1]);
  const auto it = histories_.find(key);
  if (it != histories_.end()) return it->second;
  offline::FullOrderModel& model = solver(structure);
  const std::vector<double> values = {p[0], p[1]};
  return histories_.emplace(key, at_sensors(model, offline::run_at(model, structure.problem, axes_, values)))
      .first->second;
}

const Reduced& BeamBench::reduced(const Structure& structure, int nodes, std::size_t modes,
                                  model::Form form) {
  const std::string key = fmt::format("{} {} {} {}", structure.name, nodes, modes, model::to_text(form));
  if (const auto it = reduced_.find(key); it != reduced_.end()) return it->second;
  const std::string grid = fmt::format("{} {}", structure.name, nodes);
  if (!snapshots_.contains(grid)) {
    const auto folder =
        std::filesystem::temp_directory_path() / fmt::format("knothe_verdicts_{}", ::getpid());
    model::RunGrid runs{axes_with(nodes), (folder / "parts").string(), -1, 2, true};
    snapshots_.emplace(grid, offline::run_snapshots(structure.problem, runs).snapshots);
    std::filesystem::remove_all(folder);
  }
  model::CompressionOptions options;
  options.form = form;
  options.modes = modes;
  const model::SeparatedModel model(model::compress(snapshots_.at(grid), options), "the bench's model");
  Reduced result;
  const auto displacements = model::observe(model, sensors_);
  const std::vector<model::ScalarObservation> forces = {force()};
  result.with_force =
      std::make_shared<const model::ObservedModel>(model::with_scalars(displacements, model, forces));
  result.displacements = std::make_shared<const model::ObservedModel>(displacements);
  const auto n = static_cast<Index>(sensors_.size());
  result.errors.space = Eigen::MatrixXd::Identity(n, n);
  const auto points = offline::points_in_box(axes_, 8, 271);
  result.errors.coefficients.assign(k_steps, Eigen::MatrixXd(n, static_cast<Index>(points.size())));
  result.errors.points.resize(static_cast<Index>(points.size()), 2);
  result.errors.reach.setZero(static_cast<Index>(points.size()), 2);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Eigen::Vector2d p(points[k][0], points[k][1]);
    result.errors.points.row(static_cast<Index>(k)) = p.transpose();
    const History exact = history(structure, p);
    for (std::size_t t = 0; t < k_steps; ++t)
      result.errors.coefficients[t].col(static_cast<Index>(k)) =
          exact.col(static_cast<Index>(t)).head(n) - result.displacements->predict(p, t);
  }
  return reduced_.emplace(key, std::move(result)).first->second;
}

}  // namespace knothe::verdicts
