#pragma once
/// @file Local stage of a fully separated iterate over a range of time, contracted at once, and the fixed
/// point in rank one that makes a new term (docs/explanation/latin.md, "Full separation").
#include <Eigen/Core>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "knothe/offline/latin/latin_stage.hpp"
#include "knothe/offline/latin/latin_terms.hpp"

namespace knothe::offline {

/// What a local stage leaves. Nothing in it is a field over space, time and parameters.
struct SeparatedStageResult {
  LatinProjection projection;  ///< the global stage's equations
  double energy_error = 0;  ///< √(Σ w ρᵀ G ρ / Σ w cᵀ c), ρ the out-of-balance forces; at most 1
  std::vector<LatinCandidate> worst;   ///< of each grid point, where G ρ is largest; the worst point first
  Eigen::MatrixXd residual, reaction;  ///< as in LatinSolution, P × steps
};

/// The largest correction of several points, and a bound for those that were not looked at, too: by the
/// softest body of these, m.
struct WorstCorrection {
  LatinCorrection correction;
  double bound = 0;
};

/// A space function and its functions of time and parameters.
struct NewTerm {
  Eigen::VectorXd displacement, force;
  RankOne functions;
  int passes = 0;  ///< of the fixed point
};

/// Steps [0, steps) of an iterate; all of it stays as it is while batches run.
struct LatinSeparatedStage {
  const LatinBody& body;
  const LatinBasis& basis;
  const LatinGrid& grid;
  std::span<const DamageParameters> parameters;
  const LatinTerms& terms;
  double displacement = 0;  ///< of the last step of all, m
  int all_steps = 0;        ///< of the loading
  std::size_t threads = 0;

  [[nodiscard]] int steps() const { return terms.time.rows(); }
  [[nodiscard]] double imposed(int step) const { return displacement * (step + 1) / all_steps; }
  /// (τ, c) at all points, (R + 1) × P, for each step.
  [[nodiscard]] std::vector<Eigen::MatrixXd> states() const;
  [[nodiscard]] SeparatedStageResult run() const;
  /// Of the points that are farthest from equilibrium, as LatinPgd judges them.
  [[nodiscard]] WorstCorrection correct_worst(const std::vector<LatinCandidate>& worst) const;
  /// The fixed point: the space function `start` gives functions of time and parameters, those give the space
  /// function (4) of docs/explanation/latin.md, and so on until their product stagnates, `passes` times at
  /// most. Nothing if there is nothing to correct in that direction.
  [[nodiscard]] std::optional<NewTerm> rank_one(const LatinCorrection& start, int passes) const;

 private:
  using Visit = std::function<void(std::size_t batch, int step, const LaneBatch& lanes,
                                   const Eigen::MatrixXd& coordinates, LatinLocalResult& local)>;
  [[nodiscard]] std::size_t batches() const;
  [[nodiscard]] LaneBatch make_batch(std::size_t batch) const;
  /// Each batch of points through the steps, history carried along.
  void march(const Visit& visit) const;
  [[nodiscard]] RankOne functions_for(const Eigen::VectorXd& mode) const;
  [[nodiscard]] bool solve_space(const Eigen::MatrixXd& values, NewTerm& term) const;
};

}  // namespace knothe::offline
