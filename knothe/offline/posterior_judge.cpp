#include "knothe/offline/posterior_judge.hpp"

#include <numeric>

#include "knothe/project/priors.hpp"
#include "knothe/project/simulation.hpp"

namespace knothe::offline {
namespace {

/// What [simulate] measures; nothing where there is no such table, or where it draws pictures.
project::MeasuredQuantities simulated_dofs(const project::Project& project, const model::Dofs& dofs,
                                           const std::vector<model::Quantity>& quantities) {
  if (!project.simulate) return {};
  if (!quantities.empty()) return project::measured_quantities(project, quantities);
  const auto chosen = likelihood::choose_dofs(dofs, project.simulate->dofs, project.simulate->seed);
  return {chosen, std::vector<double>(chosen.size(), project.simulate->noise_std)};
}

}  // namespace

std::optional<SyntheticProblem> synthetic_problem(const project::Project& project,
                                                  const std::vector<model::Axis>& axes,
                                                  const model::Dofs& dofs,
                                                  const std::vector<model::Quantity>& quantities) {
  if (!project.simulate || project.parameters.size() != axes.size()) return std::nullopt;
  SyntheticProblem problem;
  const std::vector<posterior::Prior> priors = project::priors_of(project);
  for (const model::Axis& axis : axes) {
    for (std::size_t k = 0; k < priors.size(); ++k)
      if (project.parameters[k].name == axis.name) problem.priors.push_back(priors[k]);
    problem.names.push_back(axis.name);
  }
  if (problem.priors.size() != axes.size()) return std::nullopt;
  const project::MeasuredQuantities measured = simulated_dofs(project, dofs, quantities);
  if (measured.dofs.empty()) return std::nullopt;
  problem.dofs = measured.dofs;
  if (quantities.empty())
    for (const std::size_t dof : problem.dofs) problem.places.add(dofs.point(dof), dofs.components[dof]);
  problem.noise_std = Eigen::Map<const Eigen::VectorXd>(measured.std.data(), std::ssize(measured.std));
  problem.seed = project.simulate->seed;
  return problem;
}

std::vector<std::size_t> checked_dofs(const project::Project& project, const model::Dofs& dofs,
                                      const std::vector<model::Quantity>& quantities) {
  if (auto chosen = simulated_dofs(project, dofs, quantities); !chosen.dofs.empty()) return chosen.dofs;
  std::vector<std::size_t> all(dofs.empty() ? quantities.size() : dofs.components.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return all;
}

PosteriorJudge::PosteriorJudge(std::shared_ptr<const model::ObservedModel> judge,
                               const SyntheticProblem& problem, const Eigen::MatrixXd& exact)
    : model(std::move(judge)),
      priors(problem.priors),
      data(likelihood::add_noise(model->time, exact, problem.noise_std, problem.seed)) {}

assimilation::ShiftSummary PosteriorJudge::shift(std::shared_ptr<const model::ObservedModel> observed,
                                                 const likelihood::NoiseModel& noise) const {
  return assimilation::summarise(
      assimilation::posterior_shift(std::move(observed), model, data.values, noise, priors));
}

}  // namespace knothe::offline
