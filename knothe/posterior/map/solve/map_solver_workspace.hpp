#pragma once
/// @file What a MapSolver keeps between solves. Private to the room.
#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/numerics/optimise/bfgs.hpp"
#include "knothe/numerics/optimise/lbfgs.hpp"
#include "knothe/numerics/optimise/nelder_mead.hpp"
#include "knothe/numerics/optimise/newton_cg.hpp"
#include "knothe/numerics/optimise/trust_region.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/map/solve/map_shapes.hpp"
#include "knothe/posterior/mode_search.hpp"

namespace knothe::posterior {

struct MapSolver::Workspace {
  MapSolverOptions options;
  ModeSearch mode_search;
  std::vector<Mode> modes;
  MapShapes shapes;
  KullbackLeiblerObjective objective;
  numerics::NewtonTrustRegion newton;
  numerics::NewtonCg newton_cg;
  numerics::Bfgs bfgs;
  numerics::Lbfgs lbfgs;
  numerics::NelderMead nelder_mead;
  numerics::WeightedQuantiles quantiles;
  Eigen::VectorXd coefficients, scratch;
  std::vector<ComponentValues> component;
  MapBatch map_batch;
  LogDensityBatch batch;
  MappedPoints more_points;

  /// A candidate map: one per order and way tried.
  struct Candidate {
    MapShape* shape = nullptr;
    AffineMap pre_map;
    int order = 0;
    bool is_long = false;  ///< of climb_long
    bool usable = true;    ///< false: of a tempered target, only there to begin the next one at
    double training_diagnostic = 0;
    double verified_diagnostic = -1;  ///< −1: not verified
    double training_objective = 0, verified_objective = 0;
    Eigen::VectorXd coefficients;  ///< in the map's order
    MappedPoints verification;
    [[nodiscard]] double diagnostic() const { return std::max(training_diagnostic, verified_diagnostic); }
  };
  std::vector<Candidate> candidates;  ///< reused; the first `tried` are of this solve
  std::size_t tried = 0;
  double standard_diagnostic = 0;  ///< verified, before any other way was tried
  std::int64_t tempered_evaluations = 0;

  explicit Workspace(MapSolverOptions settings) : options(std::move(settings)), shapes(options) {}

  /// log-weights at n independent points under pre_map ∘ (map of `shape` with `map_coefficients`).
  void weigh(CheckedDensity& target, const AffineMap& pre_map, MapShape& shape,
             const Eigen::VectorXd& map_coefficients, Index n, MappedPoints& out, bool is_broad = false);
  numerics::MinimiserSummary minimise(CheckedDensity& target, const MapShape& shape);
  /// A new candidate, begun at candidate `warm` (of the same parametrisation; −1: at the identity).
  Candidate& train(CheckedDensity& target, MapResult& result, const AffineMap& pre_map, MapShape& shape,
                   int order, std::ptrdiff_t warm);
  void verify(CheckedDensity& target, Candidate& candidate);

  /// Orders from `first` on, the first one from candidate `warm`, until the tolerance is reached and verified
  /// (true) or higher orders no longer help.
  struct Climb {
    bool reached = false, no_longer_falls = false;
  };
  Climb climb(CheckedDensity& target, MapResult& result, AffineMap pre_map,
              const Parametrisation& parametrisation, Orientation orientation, int first,
              std::ptrdiff_t warm);
  /// Orders 2 to `last_long` with four times as much along the first variable, the first one from the
  /// identity.
  Climb climb_long(CheckedDensity& target, MapResult& result, const AffineMap& pre_map);
  Climb climb_tempered(LogDensity& user_target, CheckedDensity& target, MapResult& result,
                       const AffineMap& pre_map);
  Climb fall_back(LogDensity& user_target, CheckedDensity& target, MapResult& result,
                  const AffineMap& pre_map);
  /// climb_long may be tried.
  [[nodiscard]] bool may_be_long(Index d) const;
  /// The best verified candidate.
  std::size_t choose(CheckedDensity& target);
  void report(Candidate& candidate, MapResult& result);
  void look_at_other_modes(CheckedDensity& target, MapResult& result);
};

/// Orders of the other variables that climb_long tries.
inline constexpr int k_first_long = 2;
[[nodiscard]] inline constexpr int last_long(Index d) {
  return d == 2 ? 6 : 4;  // in three variables a Newton step at order 5 takes a second
}
/// Up to this order the tables of a correction's further points are made in advance. Those of higher orders
/// and of long first variables are nine tenths of all tables and most posteriors never need them.
inline constexpr int k_last_prepared_broad = 4;
/// Coefficients of the largest map whose tables are made beforehand: those of order 8 in eight variables
/// would fill any memory.
inline constexpr Index k_last_prepared_size = 500;
/// From here on maps with a long first variable cost ten times more: only for what is far from the tolerance.
inline constexpr int k_first_dear_long = 5;
/// Dimensions in which it is tried.
inline constexpr Index k_max_long = 3;

/// The pre-map turned to the principal axes of its covariance, longest first.
[[nodiscard]] AffineMap principal_axes(const AffineMap& pre_map);

/// Which rectifier, tails and orientation a candidate has, in words.
[[nodiscard]] std::string describe_method(const Parametrisation& parametrisation, const AffineMap& pre_map);

/// ½ variance and mean of log ρ − log π̄∘T − log|det ∇T| from log-weights; a weight of zero counts as e^−1000
/// of the largest.
void diagnose(const Eigen::VectorXd& log_weight, double& diagnostic, double& objective);

}  // namespace knothe::posterior
