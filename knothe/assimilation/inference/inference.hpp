#pragma once
/// @file One-shot inference by four methods with the same output, so that each can check the others.
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "knothe/assimilation/inference/posterior_density.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/method.hpp"
#include "knothe/posterior/posterior.hpp"

namespace knothe::assimilation {

using knothe::to_text;
using posterior::Method;

/// Whether it needs no sequence of data: all but the Kalman filters.
constexpr bool is_one_shot(posterior::Method method) {
  return method < posterior::Method::extended_kalman;
}

/// What `auto` is: weighted draws, which ask for some thousand values; the map where values cost nothing and
/// there are few parameters, for it has more digits.
constexpr posterior::Method one_shot(posterior::Method method, Eigen::Index parameters, bool is_cheap) {
  if (method != posterior::Method::automatic) return method;
  return parameters <= 3 && is_cheap ? posterior::Method::transport
                                     : posterior::Method::sequential_monte_carlo;
}

/// Up to which order a method is given derivatives. Chains would ask for them at every step: only those that
/// the model has of its own.
constexpr int useful_derivatives(posterior::Method method, bool model_has_gradient) {
  if (method != posterior::Method::markov_chain) return 2;
  return model_has_gradient ? 1 : 0;
}

/// Errors: UsageError with the names there are.
[[nodiscard]] posterior::Method method_from(const std::string& text);

struct InferenceOptions {
  posterior::Method method = posterior::Method::automatic;
  posterior::MapSolverOptions map;  ///< tolerance, orders, seed, verification points
  Eigen::Index samples = 10000;     ///< draws left in the result; kept draws of chains
  /// Whether draws that weigh the same are made of weighted points; else there are none in the result.
  bool makes_draws = true;
  /// Calls that the model may be asked for, as `ModelEvaluator::spent` counts them. 0: 20,000, or twice
  /// `samples` if that is more; none for `mcmc`, and for a model that costs nothing.
  std::int64_t evaluations = 0;
  double seconds = 0;  ///< of the evaluator's clock, from the start on; 0: no limit
  std::uint64_t seed = 1;
  std::vector<std::string> names;  ///< of the parameters, for messages
  /// Called with the share of the work done where a method knows it (mcmc, smc); false interrupts.
  std::function<bool(double)> progress;
};

/// Time of one phase, and how much of it was the model's.
struct PhaseTime {
  std::string name;
  double seconds = 0, model_seconds = 0;
};

/// What the map says beside its samples.
struct MapDetails {
  posterior::MapResult map;
  Eigen::MatrixXd pulled_back;   ///< reference points x, n × d, weighted by `weights`: the posterior seen
                                 ///< through the map, N(0, I) if the map is exact
  Eigen::VectorXd weights;       ///< n
  Eigen::MatrixXd draws_of_map;  ///< p = F⁻¹(Φ(T(x))), not corrected, n × d
};

/// The posterior of p, and how it was found.
struct InferenceResult : posterior::Posterior {
  Eigen::VectorXd skewness;         ///< d: E (p − mean)³ / std³
  Eigen::VectorXd kurtosis;         ///< d: E (p − mean)⁴ / std⁴; 3 for a Gaussian
  Eigen::MatrixXd draws;            ///< equally weighted, chain after chain
  Eigen::Index distinct_draws = 0;  ///< fewer than draws only for mcmc, whose chains stay where they are
  int chains = 1;

  /// Stated, of all parameters: of a mean in standard deviations, of a standard deviation as a share; where a
  /// method states none, what trusted ones are allowed.
  double mean_error = 0.1, deviation_error = 0.05;
  bool budget_spent = false;          ///< `evaluations` or `seconds` ended it: with more it goes on
  std::vector<std::string> warnings;  ///< sentences: what was wrong with the model and how it was got round
  /// Trusted or not, and why; then any doubt about the result itself.
  std::string verdict;
  std::string computation;          ///< the first part of `verdict`
  std::vector<std::string> doubts;  ///< the rest of it: clauses, without the "But"
  /// Probability of a misfit as large as that of the observations at the most probable parameters; nothing
  /// without observations.
  std::optional<double> fit_probability;
  Eigen::VectorXd predicted;  ///< m, of the observations at the most probable parameters; empty without any
  Eigen::VectorXd edge_mass;  ///< d: posterior mass in the outer 2 % of a bounded prior, the larger side

  std::vector<MapDetails> map;       ///< one for transport
  Eigen::VectorXd r_hat;             ///< d, of mcmc
  Eigen::VectorXd effective_sizes;   ///< d, of mcmc
  Eigen::VectorXd std_errors;        ///< d, of mcmc: relative standard errors of the standard deviations
  std::vector<double> temperatures;  ///< of smc
  double acceptance = 0;             ///< of mcmc

  model::ModelCalls calls;
  std::vector<PhaseTime> phases;
  [[nodiscard]] double seconds() const;
};

/// Within the budget. Where it ends a method, or this fails (a map that does not come to an end), weighted
/// draws answer with what is left, and the verdict says so. An extra that fails (most probable point, higher
/// moments) is left out with a warning. Errors: those of the model (DataError), of the target
/// (NumericalError: nothing but zeros found, or a density without a finite integral), of the options
/// (UsageError: more than three parameters for a grid).
[[nodiscard]] InferenceResult infer(PosteriorDensity& posterior, ModelEvaluator& evaluator,
                                    const InferenceOptions& options);

}  // namespace knothe::assimilation
