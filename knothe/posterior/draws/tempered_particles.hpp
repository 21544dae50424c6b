#pragma once
/// @file Particles that go from a reference distribution to a target along ρ^{1−β} π̄^β, β from 0 to 1.
#include <Eigen/Core>
#include <functional>
#include <vector>

#include "knothe/posterior/checked_density.hpp"
#include "knothe/posterior/draws/mixture.hpp"

namespace knothe::posterior {

struct TemperingOptions {
  Eigen::Index particles = 2000;     ///< raised to an even number, at least 16
  double ess_share = 0.5;            ///< the next β keeps this effective share of the particles
  int max_moves = 50;                ///< Metropolis moves per temperature, at most
  double kept = 0;                   ///< a β at which `points_at_kept` is taken; 0: none
  std::int64_t max_evaluations = 0;  ///< moves are left out beyond these; 0: no limit
  std::uint64_t seed = 1;
  std::function<bool(double)> progress = {};  ///< with β; false interrupts
};

/// Sequential Monte Carlo (Del Moral, Doucet, Jasra 2006): reweight, resample, move. Temperatures adapt to
/// the effective sample size. Moves are differential evolution (ter Braak 2006): each half of the particles
/// takes steps that are differences of two particles of the other half, hence they have the scale, the
/// correlations and the modes of the population without anything to tune but their length; two thirds of them
/// change some of the coordinates only.
class TemperedParticles {
 public:
  /// Errors: UsageError for options that make no sense or another dimension.
  TemperedParticles(CheckedDensity& target, const Mixture& reference, TemperingOptions options);

  /// To β = 1. Errors: NumericalError if the target is zero at all first particles; Interrupted.
  void run();
  /// After `run`: the particles go on, `moves` times, as Markov chains of the target.
  void go_on(int moves);

  [[nodiscard]] const Eigen::MatrixXd& points() const { return points_; }          ///< n × d, equal weights
  [[nodiscard]] const Eigen::VectorXd& log_target() const { return log_target_; }  ///< n, log π̄
  [[nodiscard]] const Eigen::MatrixXd& points_at_kept() const {
    return points_at_kept_;
  }  ///< where they were at the kept β
  [[nodiscard]] double log_evidence() const { return log_evidence_; }
  /// Standard error of the log-evidence from the genealogy of the particles (Lee, Whiteley 2018): particles
  /// that descend from one are not independent. Not below what the weights of each temperature say by
  /// themselves.
  [[nodiscard]] double log_evidence_error() const { return log_evidence_error_; }
  [[nodiscard]] const std::vector<double>& temperatures() const { return temperatures_; }
  [[nodiscard]] double acceptance() const { return acceptance_; }  ///< at the last temperature
  /// Number of independent draws worth as much for the means of the coordinates, by the same genealogy.
  [[nodiscard]] double effective_size() const;

 private:
  double next_temperature();
  void reweigh_and_resample(double next);
  void estimate_error(const Eigen::VectorXd& weights);
  void move();
  [[nodiscard]] Eigen::Index choose_coordinates(double probability);
  void propose(Eigen::Index begin, Eigen::Index partners, bool full);
  double move_half(Eigen::Index begin, Eigen::Index partners);
  [[nodiscard]] double mean_squared_jump() const;

  CheckedDensity& target_;
  const Mixture& reference_;
  TemperingOptions options_;
  RandomNumbers random_;
  Eigen::Index n_, d_;
  std::int64_t first_evaluation_ = 0;
  double beta_ = 0, log_evidence_ = 0, log_evidence_error_ = 0, log_scale_ = 0, acceptance_ = 0;
  double step_variances_ = 0;  ///< Σ over temperatures of the relative variance of the mean weight
  std::vector<double> temperatures_;
  Eigen::MatrixXd points_, before_, proposal_, points_at_kept_;
  Eigen::VectorXd log_target_, log_reference_, proposal_reference_, increments_;
  Eigen::MatrixXd whitener_;            ///< L of the particles' covariance after resampling
  std::vector<Eigen::Index> ancestor_;  ///< first particle each one descends from
  std::vector<char> changes_;           ///< which coordinates a proposal changes
  LogDensityBatch batch_;
};

}  // namespace knothe::posterior
