#pragma once
/// @file The Kullback–Leibler objective on a quadrature rule (Rubio et al. 2019, Eq. 8), with exact gradient
/// and Hessian.
#include <Eigen/Core>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/numerics/integrate/quadrature.hpp"
#include "knothe/numerics/optimise/minimiser.hpp"
#include "knothe/posterior/checked_density.hpp"
#include "knothe/posterior/map/composed_map.hpp"
#include "knothe/posterior/map/point_tables.hpp"

namespace knothe::posterior {

/// Tables of one map shape on one rule, used again by every solve.
struct TrainingTables {
  numerics::PointRule rule;
  MapLayout layout;
  PointTables points;
  Eigen::VectorXd log_reference;  ///< log ρ at the points
  /// Square only, per component: n × n_e(n_e + 1)/2, 2 Φ'_α Φ'_β I_{α_k β_k}, the second derivatives of M^k
  /// in a_e, which do not depend on a_e. Empty where it would be too large; then they are made at each
  /// Hessian.
  std::vector<Eigen::MatrixXd> pair_basis;

  /// `map`: any map of the wanted shape; its coefficients play no part.
  TrainingTables(numerics::PointRule training_rule, const TriangularMap& map);
  [[nodiscard]] Index size() const { return rule.points.rows(); }
};

/// F(a) = Σ_i w_i [ log ρ(x_i) − log π̄(z_i) − log |det ∇T(x_i)| ],  z_i = shift + A M_a(x_i); Eq. 8 plus
/// the constant E log ρ, so that the minimum is −log evidence + KL. With the square the feasible set is h > 0
/// at every node in every component; it is convex, and its border is the barrier over which an unguarded
/// Newton step jumps into a spurious minimum. Other rectifiers have no barrier.
///
///     TrainingTables tables(rule, TriangularMap(total_order_map(2, 3)));
///     CheckedDensity target(density);
///     KullbackLeiblerObjective objective(tables, pre_map, target);
///     numerics::NewtonTrustRegion().minimise(objective, {}, a);          // a in the order of tables.layout
class KullbackLeiblerObjective final : public numerics::Objective {
 public:
  KullbackLeiblerObjective() = default;
  /// `tables` and `target` must outlive the objective. Errors: UsageError where dimensions
  /// do not fit.
  KullbackLeiblerObjective(const TrainingTables& tables, const AffineMap& pre_map, CheckedDensity& target,
                           double highest_log_density = 0) {
    begin(tables, pre_map, target, highest_log_density);
  }
  /// The same for an object that keeps its memory. Where the density is zero, `highest_log_density` − 1000
  /// stands for log π̄.
  void begin(const TrainingTables& tables, const AffineMap& pre_map, CheckedDensity& target,
             double highest_log_density);

  [[nodiscard]] Index dimension() const override { return tables_->layout.size(); }
  bool evaluate(const Eigen::VectorXd& a, int derivatives, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd& hessian) override;
  [[nodiscard]] bool has_hessian_vector() const override { return target_->available_derivatives() >= 2; }
  /// At the cost of a gradient without the density's, which is evaluated with second derivatives once per a.
  void hessian_vector(const Eigen::VectorXd& a, const Eigen::VectorXd& v, Eigen::VectorXd& product) override;
  [[nodiscard]] double step_limit(const Eigen::VectorXd& a, const Eigen::VectorXd& step) override;

  /// ½ Var_ρ[log ρ − log π̄∘T − log|det ∇T|] on the training rule at coefficients a (Eq. 9).
  double variance_diagnostic(const Eigen::VectorXd& a);

 private:
  bool map_points(const Eigen::VectorXd& a, int derivatives);
  void pull_back(int derivatives);
  void fill_gradient(Eigen::VectorXd& gradient);
  void fill_hessian(Eigen::MatrixXd& hessian);
  void add_map_curvature(Index k, Eigen::MatrixXd& hessian);
  /// ∂²V/∂b_j∂b_l of component k at the points.
  [[nodiscard]] auto curvature_of_map(Index k, Index j, Index l) const;

  const TrainingTables* tables_ = nullptr;
  CheckedDensity* target_ = nullptr;
  Eigen::MatrixXd matrix_;  ///< A, of the pre-map
  Eigen::VectorXd offset_;
  double pre_log_determinant_ = 0;
  double floor_ = 0;  ///< stands for log π̄ = −∞

  std::vector<ComponentValues> component_, step_component_;
  Eigen::MatrixXd z_;
  LogDensityBatch batch_;
  Eigen::VectorXd log_determinant_, last_, scratch_;
  Eigen::VectorXd curvature_at_;              ///< the a for which hessian_vector has everything
  Eigen::MatrixXd slope_;                     ///< n × d: −w ∂ log π̄ / ∂M_k
  Eigen::MatrixXd curvature_;                 ///< n × d(d+1)/2: −w ∂² log π̄ / ∂M_k ∂M_l
  std::vector<Eigen::MatrixXd> sensitivity_;  ///< per component n × count: ∂M^k/∂a
  std::vector<Eigen::MatrixXd> log_basis_;    ///< per component n × n_e: ∂h/∂a_e
  Eigen::MatrixXd scaled_, block_, adjoint_, shift_, moved_;
};

/// β log π̄ + (1 − β) log N(z; 0, I): from the prior of standardised parameters (β = 0) to the target (1).
class TemperedDensity final : public LogDensity {
 public:
  /// `inner` must outlive it.
  explicit TemperedDensity(LogDensity& inner, double beta = 1) : inner_(&inner), beta_(beta) {}
  void set_beta(double beta) { beta_ = beta; }
  [[nodiscard]] Index dimension() const override { return inner_->dimension(); }
  [[nodiscard]] int available_derivatives() const override { return inner_->available_derivatives(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                LogDensityBatch& out) override;

 private:
  LogDensity* inner_;
  double beta_;
};

}  // namespace knothe::posterior
