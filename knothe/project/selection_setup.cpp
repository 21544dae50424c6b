#include "knothe/project/selection_setup.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/likelihood/data/time_matching.hpp"
#include "knothe/project/observed_data.hpp"
#include "knothe/project/priors.hpp"
#include "knothe/project/simulation.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {
namespace {

/// The middle of the model's box, or what [select.at] says.
Eigen::VectorXd reference_point(const Project& project, const model::SeparatedModel& model) {
  const std::vector<std::string> names = model.parameter_names();
  Eigen::VectorXd at(std::ssize(names));
  for (const auto& [name, value] : project.select.at) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw project.error_at(
          "select.at." + name,
          fmt::format("select.at.{} is not a parameter of the model{}", name, did_you_mean(name, names)));
    }
  }
  for (std::size_t k = 0; k < names.size(); ++k) {
    const std::vector<double>& nodes = model.contents().axes[k].nodes;
    const auto given = project.select.at.find(names[k]);
    const double value =
        given == project.select.at.end() ? 0.5 * (nodes.front() + nodes.back()) : given->second;
    if (!(value >= nodes.front() && value <= nodes.back())) {
      throw project.error_at("select.at." + names[k],
                             fmt::format("select.at.{} = {} lies outside the model's box, {} to {}", names[k],
                                         value, nodes.front(), nodes.back()));
    }
    at[k] = value;
  }
  return at;
}

/// Dofs of the model: those of the face and range that [simulate.dofs] observes, or all.
std::vector<std::size_t> model_candidates(const Project& project, const model::Dofs& dofs) {
  if (dofs.empty()) throw DataError("the model has no dof positions: its field is not a displacement");
  std::vector<std::size_t> candidates;
  const std::size_t n = dofs.components.size();
  if (!project.simulate) {
    for (std::size_t i = 0; i < n; ++i) candidates.push_back(i);
    return candidates;
  }
  const likelihood::DofSelection& s = project.simulate->dofs;
  constexpr double k_slack = 1e-9;  // m
  const auto inside = [&](const std::optional<std::array<double, 2>>& range, double value) {
    return !range || (value >= (*range)[0] - k_slack && value <= (*range)[1] + k_slack);
  };
  const std::size_t face = s.face;
  double outermost = -INFINITY;
  for (std::size_t i = 0; i < n; ++i) outermost = std::max(outermost, dofs.points[3 * i + face]);
  for (std::size_t i = 0; i < n; ++i) {
    const double* x = &dofs.points[3 * i];
    const bool wanted = std::find(s.components.begin(), s.components.end(),
                                  static_cast<int>(dofs.components[i])) != s.components.end();
    if (wanted && x[face] > outermost - k_slack && inside(s.x_range, x[0]) && inside(s.y_range, x[1]))
      candidates.push_back(i);
  }
  if (candidates.empty())
    throw project.error_at("simulate.dofs", "the model has no dofs on that face and in that range");
  return candidates;
}

void set_up_from_data(const Project& project, SelectionSetup& setup) {
  const likelihood::Measurements m = read_recorded(project, setup.model.contents());
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i < m.noise.size(); ++i) {
    if (m.noise.measurement().is_measured(i)) kept.push_back(i);
  }
  setup.from_data = true;
  setup.noise = m.noise.measurement().is_complete() ? m.noise : m.noise.restricted(kept);
  for (const Eigen::Index i : kept) {
    setup.candidates.push_back(i);
    setup.sensors.add(m.sensors.point(setup.candidates.back()),
                      m.sensors.components[setup.candidates.back()]);
  }
  setup.whole = model::observe(setup.model, setup.sensors);
  setup.observed =
      model::at_steps(setup.whole, likelihood::match_times(m.time, setup.whole.time, project.data));
}

void set_up_from_model(const Project& project, SelectionSetup& setup) {
  const model::Dofs& dofs = setup.model.contents().dofs;
  setup.candidates = model_candidates(project, dofs);
  const auto n = std::ssize(setup.candidates);
  for (const std::size_t dof : setup.candidates) setup.sensors.add(dofs.point(dof), dofs.components[dof]);
  const double otherwise = project.simulate ? project.simulate->noise_std : 1e-6;
  setup.noise = likelihood::NoiseModel::independent(
      Eigen::VectorXd::Constant(n, project.select.noise_std.value_or(otherwise)));
  setup.whole = setup.observed = model::observe_dofs(setup.model, setup.candidates);
}

}  // namespace

SelectionSetup set_up_selection(const Project& project) {
  project.require(!project.model.empty(), "a model: `model = \"MODEL.h5\"`");
  project.require(!project.parameters.empty(),
                  "a table [parameters] with a prior for each parameter of the model");
  const bool data = !project.select.from_model.value_or(project.data.empty());
  project.require(!data || !project.data.empty(), "data: `data = \"DATA.h5\"`");
  SelectionSetup setup{load_model(project), {}, false, {}, {}, {}, {}, {}};
  assimilation::SelectionProblem& problem = setup.problem;
  problem.criterion = project.select.criterion;
  problem.count = project.select.count;
  problem.min_distance = project.select.min_distance;
  problem.seed = project.method.seed;
  problem.at = reference_point(project, setup.model);
  problem.priors = priors_of(project, setup.model.contents().axes);
  const std::size_t steps = setup.model.step_count();
  problem.step = project.select.step.value_or(steps / 2);
  if (problem.step >= steps) {
    throw project.error_at(
        "select.step", fmt::format("select.step = {}: the model has steps 0 to {}", problem.step, steps - 1));
  }
  data ? set_up_from_data(project, setup) : set_up_from_model(project, setup);
  problem.positions = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>>(
      setup.sensors.points.data(), std::ssize(setup.sensors), 3);
  return setup;
}

}  // namespace knothe::project
