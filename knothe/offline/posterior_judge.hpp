#pragma once
/// @file How far a reduced model's error moves the posterior of a project's synthetic data.
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "knothe/assimilation/update/posterior_shift.hpp"
#include "knothe/base/index.hpp"
#include "knothe/likelihood/data/synthetic_measurements.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::offline {

/// What a project's [parameters] and [simulate] say of an assimilation, for a model with these axes and dofs.
struct SyntheticProblem {
  std::vector<std::string> names;  ///< of the axes, in their order
  std::vector<posterior::Prior> priors;
  std::vector<std::size_t> dofs;  ///< observed
  model::Dofs places;             ///< of them; empty where the dofs have names instead
  Eigen::VectorXd noise_std;      ///< [n_obs], in the field's unit
  std::uint64_t seed = 1;
};
/// Nothing where the project has no [simulate] that chooses dofs (it may draw pictures), or no prior for one
/// of the axes.
[[nodiscard]] std::optional<SyntheticProblem> synthetic_problem(
    const project::Project& project, const std::vector<model::Axis>& axes, const model::Dofs& dofs,
    const std::vector<model::Quantity>& quantities);
/// The observed dofs of [simulate]; all where it chooses none.
[[nodiscard]] std::vector<std::size_t> checked_dofs(const project::Project& project, const model::Dofs& dofs,
                                                    const std::vector<model::Quantity>& quantities);

/// Noisy data, and the model that is right about them.
struct PosteriorJudge {
  std::shared_ptr<const model::ObservedModel> model;
  std::vector<posterior::Prior> priors;
  likelihood::Measurements data;

  /// `exact`: values n_obs × n_t to which the project's noise is added.
  PosteriorJudge(std::shared_ptr<const model::ObservedModel> judge, const SyntheticProblem& problem,
                 const Eigen::MatrixXd& exact);
  /// How far the posterior of the data lies from the judge's where `observed` is assimilated instead, with
  /// the measurements' noise or another.
  [[nodiscard]] assimilation::ShiftSummary shift(std::shared_ptr<const model::ObservedModel> observed,
                                                 const likelihood::NoiseModel& noise) const;
};

/// Largest |y(p) − u| of the observed model over all steps, m; `u(step, i)` at its i-th observation.
template <typename Solution>
[[nodiscard]] double largest_error(const model::ObservedModel& model, const std::vector<double>& p,
                                   Solution&& u) {
  const Eigen::VectorXd point = Eigen::Map<const Eigen::VectorXd>(p.data(), std::ssize(p));
  double largest = 0;
  for (Index step = 0; step < std::ssize(model.time); ++step) {
    const Eigen::VectorXd y = model.predict(point, step);
    for (Index i = 0; i < y.size(); ++i) largest = std::max(largest, std::abs(y[i] - u(step, i)));
  }
  return largest;
}

}  // namespace knothe::offline
