#pragma once
/// @file Finds the posterior of data whose forms are summed up, by every method there is: quadrature, one map
/// of all data or composed maps, corrected by importance weights or quadrature, weighted draws, Markov
/// chains, Kalman filters; and judges it.
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/update/collapsed_posterior.hpp"
#include "knothe/assimilation/update/composed_density.hpp"
#include "knothe/assimilation/update/gaussian_filter.hpp"
#include "knothe/assimilation/update/step_store.hpp"
#include "knothe/assimilation/update/tensor_quadrature.hpp"
#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/reduction/observe/observed_model.hpp"
#include "knothe/sampling/adaptive_importance.hpp"
#include "knothe/transport/solve/map_solver.hpp"

namespace knothe::assimilation {

/// Owns the target and what a solve needs again; a posterior depends on what was set alone (composed maps: on
/// the steps since `restart`).
class PosteriorSolver {
 public:
  /// `central`: w₀. Errors: ProjectError for a grid of more than 3 parameters, UsageError for options that do
  /// not go together.
  PosteriorSolver(const reduction::ObservedModel& model, std::shared_ptr<const PriorTransform> transform,
                  const Eigen::VectorXd& central, const UpdateOptions& options);

  /// The target is the posterior of all data in the sums from now on; with several sizes of a discrepancy,
  /// equally likely beforehand, a mixture over them. `shares`: what is known of how probable each is (may be
  /// empty).
  void set(const FormSums& sums, const Eigen::VectorXd& shares);
  /// The posterior of that target, into `posterior`, whose memory is used again. `last`: the form of the last
  /// datum, which composed maps go on from.
  void solve(const StepForm& last, Posterior& posterior, UpdateTimes& times);
  /// The same without what only a result needs (most probable point, level of the noise); never by composed
  /// maps.
  void solve_collapsed(Posterior& posterior, UpdateTimes& times);
  /// Points, moments, quantiles, evidence and trust by quadrature of another target in the same z, of at most
  /// `k_max_quadrature_parameters`; `by_quadrature` says whether it has converged.
  void integrate(sampling::LogDensity& target, Posterior& posterior);
  /// The same by weighted draws (`smc`) or chains (`mcmc`), in any dimension.
  void draw(sampling::LogDensity& target, Method kind, Posterior& posterior);
  /// Of a mixture: how probable each of its parts is under that posterior.
  [[nodiscard]] Eigen::VectorXd component_shares(const Posterior& posterior);

  /// Whether a posterior goes on from that of the datum before: composed maps and Kalman filters.
  [[nodiscard]] bool is_sequential() const { return composition_.has_value() || filter_.has_value(); }
  /// These begin again.
  void restart();
  /// The target, in z.
  [[nodiscard]] CollapsedLogDensity& target() { return target_; }

 private:
  [[nodiscard]] bool by_quadrature(Posterior& posterior, UpdateTimes& times);
  void by_particles(Posterior& posterior, UpdateTimes& times);
  static void set_few_points(const QuadraturePosterior& quadrature, Posterior& posterior);
  void by_grid(Posterior& posterior, UpdateTimes& times);
  void by_collapsed_map(Posterior& posterior, UpdateTimes& times);
  void by_composed_maps(const StepForm& last, Posterior& posterior, UpdateTimes& times);
  void by_filter(const StepForm& last, Posterior& posterior, UpdateTimes& times);
  void make_filter();
  [[nodiscard]] Eigen::MatrixXd parameters(const Eigen::MatrixXd& z) const;
  void compose_anew();
  void set_from(const transport::MapResult& map, Posterior& posterior);
  void set_from(const QuadraturePosterior& quadrature, Posterior& posterior);
  void thin_draws(Posterior& posterior) const;
  void set_from(const Eigen::MatrixXd& z, const Eigen::VectorXd& weights, const Eigen::MatrixXd& z_quantiles,
                Posterior& posterior);
  [[nodiscard]] double expected_noise_level(const Posterior& posterior);

  Method kind_;
  Eigen::Index samples_;
  std::shared_ptr<const reduction::ParameterFunctions> functions_;
  Eigen::VectorXd central_;
  std::shared_ptr<const PriorTransform> transform_;
  CollapsedLogDensity target_;
  transport::MapSolver solver_;
  transport::MapResult map_;
  transport::ImportanceCorrection correction_;
  std::optional<MapComposition> composition_;  ///< for Form::composed
  std::optional<GaussianFilter> filter_;       ///< for the Kalman filters
  double filter_log_evidence_ = 0;
  std::optional<Eigen::VectorXd> shares_;  ///< of a mixture's parts, where quadrature has given them
  sampling::ModeSearch search_;
  Eigen::MatrixXd no_derivatives_, map_points_, turned_;
};

}  // namespace knothe::assimilation
