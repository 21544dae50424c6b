#pragma once
/// @file What every method of sampling gives: points, weights, evidence where it has one, and how good it is.
#include <Eigen/Core>
#include <cstdint>

namespace knothe::posterior {

struct WeightedSample {
  Eigen::MatrixXd points;         ///< z, n × d
  Eigen::VectorXd weights;        ///< n, sum 1
  double effective_size = 0;      ///< as a number of independent draws, ≤ n
  double log_evidence = 0;        ///< log ∫ π̄, if `has_evidence`
  double log_evidence_error = 0;  ///< standard error of it
  bool has_evidence = false;
  std::int64_t density_evaluations = 0;

  /// Of importance sampling, from `weights`: what they are worth, and the error of this evidence.
  void state_evidence(double log_evidence_of_weights);
};

/// Moments of a weighted sample; the covariance divides by the sum of the weights. Errors: UsageError for no
/// points, sizes that disagree, weights that are negative or all zero.
[[nodiscard]] Eigen::VectorXd mean_of(const WeightedSample& sample);
[[nodiscard]] Eigen::MatrixXd covariance_of(const WeightedSample& sample);

/// Standard errors of self-normalised importance sampling, by the delta method: of a mean in standard
/// deviations, of a standard deviation relative to it.
struct MomentErrors {
  double mean = 0, deviation = 0;
};

/// What importance sampling gives.
struct ImportanceResult {
  WeightedSample sample;
  /// Four standard errors, the largest of all variables: of a mean in standard deviations, of a standard
  /// deviation relative to it.
  double mean_error = 0, deviation_error = 0;
  bool converged = false;  ///< both are below 0.1 and 0.05
  static constexpr double k_mean_tolerance = 0.1, k_deviation_tolerance = 0.05;
  /// `tail_shape_of`: of a variance that is infinite, or barely finite, the errors above say nothing.
  double tail_shape = 0;
  /// Walks from the outermost draws found mass that hardly any draw stands for.
  bool mass_beyond = false;

  /// Errors and convergence, from the weights and `variables` (n × k), whose moments count. `tail`:
  /// `tail_shape_of` them; beyond ¼ a square has no variance, and its error is estimated too small: that of a
  /// standard deviation is raised by twice the excess.
  void state_errors(const Eigen::MatrixXd& variables, double tail = 0);
  void state_errors(const MomentErrors& errors, double tail);
  /// Rounds go on until the errors are this share of the tolerances: they are estimates themselves.
  [[nodiscard]] bool is_done(double share = k_share_of_tolerance) const;
  static constexpr double k_share_of_tolerance = 0.8;
  [[nodiscard]] bool is_within(double share) const {
    return mean_error <= share * k_mean_tolerance && deviation_error <= share * k_deviation_tolerance;
  }
};

/// Shape k of the heaviest tail of the variables (n × k): beyond the last 2e-3 of the mass on either side the
/// probability of a distance t from the mean falls as t^(−1/k), by Hill's estimate. A variance is finite for
/// k below ½. 0 where fewer than 20 points are that far out.
[[nodiscard]] double tail_shape_of(const Eigen::MatrixXd& variables, const Eigen::VectorXd& weights);

/// The largest of all columns of `variables` (n × k). Weights: n, sum 1.
[[nodiscard]] MomentErrors standard_errors(const Eigen::MatrixXd& variables, const Eigen::VectorXd& weights);

/// Leaves at most `count` of the points (n × d), all different: the heavy ones keep their weights, the light
/// ones stand for each other with one weight (Fearnhead, Clifford 2003), which changes no expectation on
/// average. Weights: n, sum 1.
void thin(Eigen::MatrixXd& points, Eigen::VectorXd& weights, Eigen::Index count, std::uint64_t seed);

/// Puts points (n × d, d ≤ 32) in the order of a space-filling curve (Morton's), so that every N-th of
/// them, or systematic draws, are spread evenly.
void sort_along_curve(Eigen::MatrixXd& points, Eigen::VectorXd& weights);

}  // namespace knothe::posterior
