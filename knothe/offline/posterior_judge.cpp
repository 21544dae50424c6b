#include "knothe/offline/posterior_judge.hpp"

#include <numeric>

#include "knothe/project/simulation.hpp"

namespace knothe::offline {
namespace {

/// The dofs at which [simulate] measures; none where there is no such table, or where it draws pictures.
std::vector<std::size_t> simulated_dofs(const project::Project& project, const reduction::Dofs& dofs) {
  if (!project.simulate) return {};
  return assimilation::choose_dofs(dofs, project.simulate->dofs, project.simulate->seed);
}

}  // namespace

std::optional<SyntheticProblem> synthetic_problem(const project::Project& project,
                                                  const std::vector<reduction::Axis>& axes,
                                                  const reduction::Dofs& dofs) {
  if (!project.simulate || project.parameters.size() != axes.size()) return std::nullopt;
  SyntheticProblem problem;
  for (const reduction::Axis& axis : axes) {
    for (const project::NamedPrior& parameter : project.parameters)
      if (parameter.name == axis.name) problem.priors.push_back(parameter.prior);
    problem.names.push_back(axis.name);
  }
  if (problem.priors.size() != axes.size()) return std::nullopt;
  problem.dofs = simulated_dofs(project, dofs);
  if (problem.dofs.empty()) return std::nullopt;
  for (const std::size_t dof : problem.dofs) {
    problem.points.insert(problem.points.end(), &dofs.points[3 * dof], &dofs.points[3 * dof] + 3);
    problem.components.push_back(dofs.components[dof]);
  }
  problem.noise_std = project.simulate->noise_std;
  problem.seed = project.simulate->seed;
  return problem;
}

std::vector<std::size_t> judged_dofs(const project::Project& project, const reduction::Dofs& dofs) {
  if (std::vector<std::size_t> chosen = simulated_dofs(project, dofs); !chosen.empty()) return chosen;
  std::vector<std::size_t> all(dofs.components.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return all;
}

PosteriorJudge::PosteriorJudge(std::shared_ptr<const reduction::ObservedModel> judge,
                               const SyntheticProblem& problem, const reduction::Dofs& dofs,
                               const Eigen::MatrixXd& exact)
    : model(std::move(judge)),
      priors(problem.priors),
      data(assimilation::add_noise(dofs, problem.dofs, model->time, exact, problem.noise_std, problem.seed)) {
}

assimilation::ShiftSummary PosteriorJudge::shift(std::shared_ptr<const reduction::ObservedModel> observed,
                                                 const assimilation::NoiseModel& noise) const {
  return assimilation::summarise(
      assimilation::posterior_shift(std::move(observed), model, data.values, noise, priors));
}

}  // namespace knothe::offline
