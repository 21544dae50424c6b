#pragma once
/// @file From a log-density to a verified transport map: mode, Laplace pre-map, adaptive order (Rubio et al.
/// 2019, section 2.2).
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/map/composed_map.hpp"
#include "knothe/posterior/map/solve/missed_modes.hpp"
#include "knothe/posterior/trust.hpp"

namespace knothe::posterior {

/// `newton` becomes `newton_cg` for more than some hundred coefficients, where the Hessian costs more than it
/// saves.
enum class MinimiserKind { newton, newton_cg, bfgs, lbfgs, nelder_mead };

/// In which coordinates the map is triangular. A triangular map follows a bent ridge well if its first
/// variable runs along it and badly if it runs across (docs/explanation/transport.md, "Orientation").
enum class Orientation {
  given,      ///< the target's own coordinates, in their order
  principal,  ///< the principal axes of the Laplace covariance, longest first
  automatic   ///< the one that gains more at order 2; `given` where order 1 is enough
};

struct MapSolverOptions {
  double tolerance = 1e-3;                          ///< on the verified variance diagnostic (Eq. 9)
  int max_order = 8;                                ///< 1 … k_max_order
  int min_order = 1;                                ///< first order tried
  MinimiserKind minimiser = MinimiserKind::newton;  ///< lowered to what the density's derivatives allow
  int max_iterations = 60;                          ///< of the minimiser, per order
  /// The minimiser stops when it predicts a smaller decrease of the objective; 0: a thousandth of
  /// `tolerance`, since the objective's excess and the diagnostic are the same to leading order.
  double decrease_tolerance = 0;
  Index verification_points = 1024;  ///< scrambled Sobol points, never used for training
  Index max_points = 16384;          ///< the importance correction may take so many where weights are uneven
  double wanted_ess =
      0.996;  ///< below this effective sample size (fraction), or beyond order 4 without the tolerance, the
              ///< correction takes four times as many points; below 0.98 sixteen times
  std::uint64_t seed = 1;  ///< of the verification points
  /// How far to look for mass that the map does not cover. `multi_start` where time is short.
  ModeSearchLevel search_modes = ModeSearchLevel::tempered;
  double mode_mass = 1e-3;  ///< a mode with this share of the mass counts
  /// Where ascents to the mode begin: `near` for parameters that come standardised, `wide` where nothing is
  /// known of their scale.
  ScanReach scan = ScanReach::near;
  /// The tempered look begins with N(0, spread² I): around 2 for parameters that come standardised. 0: with a
  /// Gaussian 120 times as wide as the modes found.
  double tempering_spread = 0;

  Parametrisation parametrisation;  ///< rectifier, radii of the tails
  MapFamily family;                 ///< the map of each order; empty: total order
  Orientation orientation = Orientation::automatic;
  int nodes_per_axis = 0;  ///< of the training rule, Gauss–Hermite; 0: a rule chosen with the order
  /// Where the orders do not reach the tolerance (d = 2, 3): also maps of order up to 6 with four times as
  /// much, up to 23, in the first variable, for a posterior that is a narrow ridge with structure along it
  /// (docs/explanation/transport.md, "A long first variable").
  bool long_first_variable = true;
  /// Where the tolerance is not reached: also try wider tails, softplus, exponential, the tempered sequence,
  /// and keep the best verified map. Switch it off where time is short.
  bool fallback = true;
};

/// Points with their importance weights: z = T(x) for points x that follow N(0, I), log π̄(z) + log|det ∇T(x)|
/// − log ρ(x).
struct MappedPoints {
  Eigen::MatrixXd reference;   ///< x, n × d
  Eigen::MatrixXd points;      ///< z, n × d
  Eigen::VectorXd log_weight;  ///< n, −∞ where the target is zero
};

/// What a solve gives and tells.
struct MapResult {
  AffineMap pre_map;     ///< Laplace: from standardised coordinates to z; rotated if it has a rotation
  TriangularMap map;     ///< from the reference to standardised coordinates
  Eigen::VectorXd mode;  ///< z of the highest density found
  double mode_log_density = 0;
  int order = 0;
  double training_diagnostic = 0;  ///< Eq. 9 by the training rule
  double verified_diagnostic = 0;  ///< Eq. 9 on the verification points
  double training_objective = 0;  ///< Eq. 8 by the training rule, plus E log ρ: −log evidence as of Eq. 24
  double verified_objective = 0;  ///< the same on the verification points
  int iterations = 0;             ///< of the minimiser, all orders
  std::int64_t density_evaluations = 0;  ///< points at which the target was evaluated
  bool tolerance_reached = false;
  std::string reason;              ///< why the tolerance was not reached; empty if it was
  bool second_mode_found = false;  ///< or other mass that the map leaves out
  Eigen::VectorXd second_mode;     ///< z, if found
  MissedModes missed;              ///< all about it
  std::string method;  ///< which parametrisation and orientation the map has, and what else was tried
  std::vector<double> diagnostic_by_order;  ///< training diagnostic of each order tried, from min_order
  std::vector<double> objective_by_order;   ///< training objective of each
  MappedPoints verification;                ///< the verification points behind the figures above

  [[nodiscard]] ComposedMap composed() const;  ///< pre_map ∘ map
  [[nodiscard]] Eigen::MatrixXd evaluate(const Eigen::Ref<const Eigen::MatrixXd>& reference) const;
  [[nodiscard]] Eigen::MatrixXd inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// log of the normalised approximation at z (n × d).
  [[nodiscard]] Eigen::VectorXd log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// Eq. 24 on the verification points: a lower bound of the log-evidence, low by the KL divergence.
  [[nodiscard]] double map_log_evidence() const { return -verified_objective; }
};

/// The answer: moments, quantiles and evidence by importance weights on the image of quasi-random points
/// under the map.
struct ImportanceCorrection {
  Eigen::MatrixXd points;      ///< z, n × d
  Eigen::VectorXd weights;     ///< n, sum 1
  double ess = 0;              ///< effective sample size (Σw)²/Σw² as a fraction of n
  Eigen::VectorXd mean;        ///< d
  Eigen::MatrixXd covariance;  ///< d × d
  Eigen::MatrixXd quantiles;   ///< d × levels (`numerics::k_quantile_levels`), marginal
  double log_evidence = 0;     ///< consistent estimate of log ∫ π̄
  double log_evidence_error =
      0;  ///< its standard error, as if the points were independent (an upper bound in practice)
  double map_log_evidence = 0;  ///< Eq. 24
  Trust trust;
  std::int64_t density_evaluations = 0;  ///< further ones, beyond those of the solve
};

/// Finds maps. Owns tables and workspace, which are made at the first solve of a dimension and order and used
/// again; a result depends on the target and the options alone, never on earlier solves. One object serves
/// one thread.
class MapSolver {
 public:
  /// Errors: UsageError for options that make no sense.
  explicit MapSolver(MapSolverOptions options = {});
  ~MapSolver();
  MapSolver(MapSolver&&) noexcept;
  MapSolver& operator=(MapSolver&&) noexcept;

  [[nodiscard]] const MapSolverOptions& options() const;

  /// Makes the tables for densities in `dimension` variables that most solves need now, not at the first that
  /// does. The large ones, of corrections of high orders and of a long first variable, wait for that solve.
  void prepare(Index dimension);

  /// Errors: UsageError for a dimension below 1, NumericalError for a density that gives NaN or +∞, or is
  /// zero at every point tried. `result` is overwritten; reusing one object saves its memory.
  void solve(LogDensity& target, MapResult& result);
  [[nodiscard]] MapResult solve(LogDensity& target);

  /// On the result of the solve of the same target.
  void correct(LogDensity& target, const MapResult& result, ImportanceCorrection& correction);
  [[nodiscard]] ImportanceCorrection correct(LogDensity& target, const MapResult& result);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace knothe::posterior
