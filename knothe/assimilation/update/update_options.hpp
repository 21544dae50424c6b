#pragma once
/// @file How data are assimilated: what a sequential update is told beside model, noise and priors.
#include <array>
#include <optional>
#include <vector>

#include "knothe/assimilation/monitor/evidence_monitor.hpp"
#include "knothe/likelihood/discrepancy/model_bias.hpp"
#include "knothe/likelihood/noise/noise_level.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/method.hpp"

namespace knothe::assimilation {

struct UpdateOptions {
  posterior::Method kind = posterior::Method::automatic;  ///< how the posterior is computed
  /// Draws of `mcmc`, half the evaluations of `smc` where that is more than 20,000, fifty times the members
  /// of `enkf`.
  Eigen::Index samples = 10000;
  /// All data in one quadratic form and one map (constant cost, no accumulated error), or a composition of
  /// one low-order map per datum (Rubio et al. 2019, Eq. 10-11).
  enum class Form { collapsed, composed } form = Form::collapsed;
  /// The level of the noise is not known: integrated out with this prior (collapsed form only).
  std::optional<likelihood::NoiseLevel> noise_level;
  posterior::MapSolverOptions map;  ///< tolerance, orders, minimiser, number of points, seed
  /// In place of that of `map`: a tempered look for second modes costs more than all the rest of an update.
  posterior::ModeSearchLevel search_modes = posterior::ModeSearchLevel::multi_start;
  /// Correction of the model's bias (Rubio et al. 2019, §4): never, always, or when the monitor says so.
  likelihood::BiasCorrectionMode bias_correction = likelihood::BiasCorrectionMode::off;
  likelihood::BiasOptions bias;
  MonitorOptions monitor;
  /// A structure that changes (docs/explanation/assimilation.md). Before each datum the likelihood of those
  /// before it is raised to the power `forgetting`, in (0, 1]; before the steps `change_points` to the power
  /// `change_retention`, in [0, 1]: with 0 the posterior begins again from the prior.
  double forgetting = 1;
  std::vector<std::size_t> change_points;
  double change_retention = 0;
  /// Takes an alarm of the monitor for such a change, from when the drift began.
  bool restart_on_alarm = false;
  /// Keeps what a correction needs also where nothing is corrected, so that `redo` can be asked for.
  bool learn_bias = false;
};

constexpr auto names_of(UpdateOptions::Form /*form*/) {
  using Form = UpdateOptions::Form;
  return std::to_array<Named<Form>>({{Form::collapsed, "collapsed"}, {Form::composed, "composed"}});
}

}  // namespace knothe::assimilation
