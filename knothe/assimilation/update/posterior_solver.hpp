#pragma once
/// @file Finds the posterior of data whose forms are summed up, by every method there is: quadrature, one map
/// of all data or composed maps, corrected by importance weights or quadrature, weighted draws, Markov
/// chains, Kalman filters; and judges it.
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/update/gaussian_filter.hpp"
#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/likelihood/step/collapsed_posterior.hpp"
#include "knothe/likelihood/step/composed_density.hpp"
#include "knothe/likelihood/step/step_store.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/draws/adaptive_importance.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/quadrature/tensor_quadrature.hpp"

namespace knothe::assimilation {

/// Owns the target and what a solve needs again; a posterior depends on what was set alone (composed maps: on
/// the steps since `restart`).
class PosteriorSolver {
 public:
  /// `central`: w₀. Errors: ProjectError for a grid of more than 3 parameters, UsageError for options that do
  /// not go together.
  PosteriorSolver(const model::ObservedModel& model,
                  std::shared_ptr<const posterior::PriorTransform> transform, const Eigen::VectorXd& central,
                  const UpdateOptions& options);

  /// The target is the posterior of all data in the sums from now on; with several sizes of a discrepancy,
  /// equally likely beforehand, a mixture over them. `shares`: what is known of how probable each is (may be
  /// empty).
  void set(const likelihood::FormSums& sums, const Eigen::VectorXd& shares);
  /// The posterior of that target, into `posterior`, whose memory is used again. `last`: the form of the last
  /// datum, which composed maps go on from.
  void solve(const likelihood::StepForm& last, posterior::Posterior& posterior, UpdateTimes& times);
  /// The same without what only a result needs (most probable point, level of the noise); never by composed
  /// maps.
  void solve_collapsed(posterior::Posterior& posterior, UpdateTimes& times);
  /// The posterior of the target after the likelihood of all data so far was raised to the power `power`:
  /// composed maps and filters go on from this one.
  void solve_widened(double power, posterior::Posterior& posterior, UpdateTimes& times);
  /// Points, moments, quantiles, evidence and trust by quadrature of another target in the same z, of at most
  /// `k_max_quadrature_parameters`; `by_quadrature` says whether it has converged.
  void integrate(posterior::LogDensity& target, posterior::Posterior& posterior);
  /// The same by weighted draws (`smc`) or chains (`mcmc`), in any dimension.
  void draw(posterior::LogDensity& target, posterior::Method kind, posterior::Posterior& posterior);
  /// Of a mixture: how probable each of its parts is under that posterior.
  [[nodiscard]] Eigen::VectorXd component_shares(const posterior::Posterior& posterior);

  /// Whether a posterior goes on from that of the datum before: composed maps and Kalman filters.
  [[nodiscard]] bool is_sequential() const { return composition_.has_value() || filter_.has_value(); }
  /// These begin again.
  void restart();
  /// The target, in z.
  [[nodiscard]] likelihood::CollapsedLogDensity& target() { return target_; }

 private:
  [[nodiscard]] bool by_quadrature(posterior::Posterior& posterior, UpdateTimes& times);
  [[nodiscard]] posterior::QuadraturePosterior quadrature_of_parts(
      const posterior::QuadratureOptions& options);
  void by_particles(posterior::Posterior& posterior, UpdateTimes& times);
  static void set_few_points(const posterior::QuadraturePosterior& quadrature,
                             posterior::Posterior& posterior);
  void by_grid(posterior::Posterior& posterior, UpdateTimes& times);
  void by_collapsed_map(posterior::Posterior& posterior, UpdateTimes& times);
  void by_composed_maps(const likelihood::StepForm& last, posterior::Posterior& posterior,
                        UpdateTimes& times);
  void by_filter(const likelihood::StepForm& last, posterior::Posterior& posterior, UpdateTimes& times);
  void make_filter();
  void set_from_filter(posterior::Posterior& posterior);
  [[nodiscard]] bool composes() const;
  [[nodiscard]] Eigen::MatrixXd parameters(const Eigen::MatrixXd& z) const;
  void compose_anew();
  void set_from(const posterior::MapResult& map, posterior::Posterior& posterior);
  void set_from(const posterior::QuadraturePosterior& quadrature, posterior::Posterior& posterior);
  void thin_draws(posterior::Posterior& posterior) const;
  void set_from(const Eigen::MatrixXd& z, const Eigen::VectorXd& weights, const Eigen::MatrixXd& z_quantiles,
                posterior::Posterior& posterior);
  [[nodiscard]] double expected_noise_level(const posterior::Posterior& posterior);

  posterior::Method kind_;
  Eigen::Index samples_;
  std::shared_ptr<const model::ParameterFunctions> functions_;
  Eigen::VectorXd central_;
  std::shared_ptr<const posterior::PriorTransform> transform_;
  likelihood::CollapsedLogDensity target_;
  posterior::MapSolver solver_;
  posterior::MapResult map_;
  posterior::ImportanceCorrection correction_;
  std::optional<likelihood::MapComposition> composition_;  ///< for Form::composed
  std::optional<GaussianFilter> filter_;                   ///< for the Kalman filters
  double filter_log_evidence_ = 0;
  std::optional<Eigen::VectorXd> shares_;  ///< of a mixture's parts, where quadrature has given them
  posterior::ModeSearch search_;
  Eigen::MatrixXd no_derivatives_, map_points_, turned_;
};

}  // namespace knothe::assimilation
