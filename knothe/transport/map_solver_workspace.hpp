#pragma once
/// @file What a MapSolver keeps between solves. Private to the room.
#include <map>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "knothe/numerics/bfgs.hpp"
#include "knothe/numerics/nelder_mead.hpp"
#include "knothe/numerics/trust_region.hpp"
#include "knothe/numerics/weighted_statistics.hpp"
#include "knothe/sampling/mode_search.hpp"
#include "knothe/transport/kl_objective.hpp"
#include "knothe/transport/map_solver.hpp"

namespace knothe::transport {

/// Independent points with their tables for maps of one order. Tables are never enlarged in place: a result
/// must not depend, not even in its last bit, on what was solved before.
struct VerificationTables {
  MapLayout layout;
  PointTables points;
  Eigen::VectorXd log_reference;
};

/// Spread of the defensive half of the points of an importance correction.
inline constexpr double k_broad = 1.5;

struct MapSolver::Workspace {
  MapSolverOptions options;
  sampling::ModeSearch mode_search;
  std::vector<sampling::Mode> modes;
  std::map<std::pair<Eigen::Index, int>, TriangularMap> identities;                  ///< (d, order)
  std::map<std::pair<Eigen::Index, int>, std::unique_ptr<TrainingTables>> training;  ///< (d, order)
  std::map<std::tuple<Eigen::Index, Eigen::Index, int>, std::unique_ptr<VerificationTables>> verification,
      broad;  ///< (n, d, order)
  KullbackLeiblerObjective objective;
  numerics::NewtonTrustRegion newton;
  numerics::Bfgs bfgs;
  numerics::NelderMead nelder_mead;
  numerics::WeightedQuantiles quantiles;
  Eigen::VectorXd coefficients, map_coefficients, scratch;
  std::vector<ComponentValues> component;
  sampling::LogDensityBatch batch;
  WeightedPoints more_points;

  /// A candidate map: one per order tried.
  struct Candidate {
    int order = 0;
    double training_diagnostic = 0;
    double verified_diagnostic = -1;  ///< −1: not verified
    double training_objective = 0, verified_objective = 0;
    Eigen::VectorXd coefficients;  ///< in the map's order
    WeightedPoints verification;
  };
  std::vector<Candidate> candidates;  ///< reused; the first `tried` are of this solve
  std::size_t tried = 0;

  const TriangularMap& identity(Eigen::Index d, int order);
  const TrainingTables& training_tables(Eigen::Index d, int order);
  /// `is_broad`: half of the points are spread by k_broad, and log_reference is that of the mixture ½ N(0, I)
  /// + ½ N(0, k_broad² I).
  const VerificationTables& verification_tables(Eigen::Index n, Eigen::Index d, int order,
                                                bool is_broad = false);

  /// log-weights at n independent points under pre_map ∘ (map of `order` with `coefficients`).
  void weigh(sampling::CheckedDensity& target, const AffineMap& pre_map, int order,
             const Eigen::VectorXd& map_coefficients_in, Eigen::Index n, WeightedPoints& out,
             bool is_broad = false);
  numerics::MinimiserSummary minimise(sampling::CheckedDensity& target);
  void train(sampling::CheckedDensity& target, MapResult& result, int order);
  void verify(sampling::CheckedDensity& target, const AffineMap& pre_map, Candidate& candidate);
  std::size_t choose(sampling::CheckedDensity& target, const MapResult& result);
  void look_at_other_modes(MapResult& result);
};

/// ½ variance and mean of log ρ − log π̄∘T − log|det ∇T| from log-weights; a weight of zero counts as e^−1000
/// of the largest.
void diagnose(const Eigen::VectorXd& log_weight, double& diagnostic, double& objective);

}  // namespace knothe::transport
