#include "knothe/offline/latin/latin_start.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"

namespace knothe::offline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The start must be a state of the same elastic body under the same load, or its modes mean nothing here.
void check_start(const model::ModelContents& model, const std::string& where, const BeamProblem& problem,
                 const Structure& structure) {
  const auto refuse = [&](const std::string& why) {
    throw DataError(fmt::format(
        "{}: LATIN-PGD cannot start from this model: {}. Make it with the mesh, steps and material of this "
        "project, on a coarser grid of parameters, or leave offline.latin.start away",
        where, why));
  };
  const model::Dofs here = dofs(structure.mesh());
  if (model.dofs.components != here.components)
    refuse(fmt::format("it is of another mesh ({} dofs where there are {})", model.dof_count(),
                       here.components.size()));
  for (Index i = 0; i < std::ssize(here.points); ++i)
    if (!(std::abs(model.dofs.points[i] - here.points[i]) < 1e-9))
      refuse(fmt::format("it is of another mesh (dof {} is elsewhere)", i / 3));
  const std::vector<double> time = model_time(problem.solver);
  if (model.time.size() != time.size())
    refuse(fmt::format("it has {} steps where there are {}", model.time.size(), time.size()));
  const auto lift = model::lift_of(model);
  const Eigen::Map<const VectorXd> unit(structure.unit_lift().data(), structure.dof_count());
  const VectorXd last = problem.solver.displacement * unit;
  const double difference = (lift.col(lift.cols() - 1) - last).norm() / last.norm();
  if (!(difference < 1e-6))
    refuse(fmt::format(
        "its elastic solution differs by {:.1g} (relative): other supports, another material or displacement",
        difference));
  for (const model::Axis& axis : model.axes)
    if (axis.name != "Y0" && axis.name != "Ad")
      refuse(fmt::format("it has a parameter {}, and LATIN-PGD has Y0 and Ad", axis.name));
}

/// The point of the model's box that is nearest to the damage parameters.
VectorXd nearest_point(const std::vector<model::Axis>& axes, const DamageParameters& parameters) {
  VectorXd point(std::ssize(axes));
  for (Index i = 0; i < std::ssize(axes); ++i) {
    const double value = axes[i].name == "Y0" ? parameters.threshold : parameters.brittleness;
    point[i] = std::clamp(value / axes[i].reference, axes[i].nodes.front(), axes[i].nodes.back());
  }
  return point;
}

}  // namespace

LatinStart start_from(const model::SeparatedModel& model, const BeamProblem& problem,
                      const Structure& structure, const std::vector<model::Axis>& axes) {
  const model::ModelContents& contents = model.contents();
  check_start(contents, model.where(), problem, structure);

  model::Snapshots grid;
  grid.axes = axes;
  const Index points = grid.grid_size();
  MatrixXd places(points, std::ssize(contents.axes));
  for (Index p = 0; p < points; ++p)
    places.row(p) = nearest_point(contents.axes, damage_parameters(problem, axes, grid.parameters_at(p)));
  model::FunctionBatch functions;
  functions.resize(points, model.functions()->dimension(), model.functions()->count(), 0);
  model.functions()->evaluate(places, 0, functions);

  // Orthonormal modes: the canonical form's are not.
  LatinStart start;
  start.space = model::orthonormal_basis(model::space_of(contents));
  const MatrixXd change = start.space.transpose() * model::space_of(contents);
  for (Index step = 0; step < std::ssize(contents.time); ++step)
    start.coordinates.emplace_back(change * model::core_of(contents, step) * functions.value.transpose());
  return start;
}

std::uint64_t fingerprint(const LatinStart& start) {
  std::uint64_t result = 0;
  const auto mix = [&](const MatrixXd& matrix) {
    const std::string_view bytes(reinterpret_cast<const char*>(matrix.data()),
                                 sizeof(double) * matrix.size());
    result = 31 * result + fnv1a(bytes);
  };
  mix(start.space);
  for (const MatrixXd& values : start.coordinates) mix(values);
  return result;
}

}  // namespace knothe::offline
