#pragma once
/// @file One load step of LATIN-PGD for a batch of parameter points: local stage, and the global stage's
/// small problems in the space of the modes (docs/explanation/latin.md).
#include <Eigen/Core>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/offline/latin/latin_basis.hpp"
#include "knothe/offline/latin/latin_local_stage.hpp"

namespace knothe::offline {

/// Search direction of the local stage's line σ - σ̂ = H (ε - ε̂), by which the global stage is made linear.
enum class SearchDirection {
  elastic,  ///< C: constant, one factorisation; stalls on softening
  secant,   ///< (1 - d̂) C, refreshed every iteration
  tangent  ///< the consistent tangent of the law: (1 - d̂) C - A_d (1 - d̂)² (C ε̂) ⊗ ∂Y/∂ε where d̂ grows
};

/// Parameter points that are computed together, L of them, padded to a multiple of k_lanes.
struct LaneBatch {
  std::vector<int> points;                 ///< their numbers in the grid
  Eigen::VectorXd threshold, brittleness;  ///< padded
  Eigen::MatrixXd history;                 ///< padded × n_g: damage before the step

  [[nodiscard]] Index size() const { return std::ssize(points); }
  [[nodiscard]] Index padded() const { return padded_lanes(points.size()); }
  /// The lanes `kept` (positions in this batch) alone.
  [[nodiscard]] LaneBatch only(const std::vector<Index>& kept) const;
};

/// Local stage and projected equations at given coordinates.
class LatinLocalResult {
 public:
  LatinLocalResult(const LatinBody& body, const LatinBasis& basis) : body_(body), basis_(basis) {}

  /// Strains and damage at `coordinates`, (r + 1) × L; with slope and derivative for the tangent.
  void evaluate(const LaneBatch& batch, const Eigen::MatrixXd& coordinates, bool tangent);
  /// What damage takes from the projected stiffness: packed × L.
  void project();
  /// Projected residual of lane: c - Σ_g d_g w_g ε : C : ε, r.
  [[nodiscard]] Eigen::VectorXd residual(Index lane, const Eigen::MatrixXd& coordinates) const;
  /// Projected stiffness in a search direction, r × r.
  [[nodiscard]] Eigen::MatrixXd stiffness(Index lane, SearchDirection direction) const;
  /// d C ε of all lanes, L × 6 n_g.
  [[nodiscard]] Eigen::MatrixXd lost_stress(Index lanes) const;
  /// ∂(d C ε)/∂ε at the points of one lane.
  [[nodiscard]] std::vector<VoigtMatrix> lost_material(Index lane, SearchDirection direction) const;
  [[nodiscard]] const Eigen::MatrixXd& damage() const { return damage_; }  ///< padded × n_g

 private:
  [[nodiscard]] Voigt strain(Index lane, Index point) const;

  const LatinBody& body_;
  const LatinBasis& basis_;
  Eigen::MatrixXd strain_, derivative_;         ///< padded × 6 n_g
  Eigen::MatrixXd damage_, slope_;              ///< padded × n_g
  Eigen::MatrixXd projected_;                   ///< packed × L
  Eigen::MatrixXd gathered_, gathered_damage_;  ///< of the damaged points alone
};

/// How the small problems are solved.
struct LatinStepOptions {
  SearchDirection direction = SearchDirection::tangent;
  double tolerance = 1e-7;  ///< projected residual / norm of the elastic force of the modes
  int iterations = 12;      ///< linear stages at most
  bool best = true;         ///< keep the iterate with the smallest residual; false: the last one
  int warm_up = 40;         ///< secant iterations at most from the state before, for lanes that fail
  int cuts = 3;             ///< the last resort: halvings of the step before irreversible secant iterations
  int secant_iterations = 200;
};

/// The step of one batch.
class LatinStep {
 public:
  LatinStep(const LatinBody& body, const LatinBasis& basis, const LatinStepOptions& options)
      : basis_(basis), options_(options), local_(body, basis) {}

  /// Solves the projected equations from the guess in `coordinates` (row 0: τ of each lane). Lanes that do
  /// not get there keep their best iterate. Returns for each lane whether it converged; `damage` (padded ×
  /// n_g) is that of the results.
  std::vector<char> solve(const LaneBatch& batch, Eigen::MatrixXd& coordinates, Eigen::MatrixXd& damage);
  /// For lanes that did not: secant iterations from the states before, `before` (r + 1) × L, which approach
  /// the first equilibrium from below, every ten followed by `solve`. Same results.
  std::vector<char> solve_from(const LaneBatch& batch, const Eigen::MatrixXd& before,
                               Eigen::MatrixXd& coordinates, Eigen::MatrixXd& damage);
  /// For a lane that did not even then: from the state before, `before` (r + 1), in parts of the step, each
  /// by `solve` or else by irreversible secant iterations, as LoadStepping does. `history` is the batch of
  /// that lane alone and ends as the damage at the end.
  bool advance(LaneBatch& lane, const Eigen::VectorXd& before, Eigen::MatrixXd& coordinates);
  [[nodiscard]] LatinLocalResult& local() { return local_; }
  [[nodiscard]] long points_evaluated() const { return points_evaluated_; }

 private:
  bool secant(LaneBatch& lane, Eigen::MatrixXd& coordinates, Eigen::MatrixXd& damage);

  const LatinBasis& basis_;
  LatinStepOptions options_;
  LatinLocalResult local_;
  long points_evaluated_ = 0;
};

}  // namespace knothe::offline
