#pragma once
/// @file The Kullback–Leibler objective on a quadrature rule (Rubio et al. 2019, Eq. 8), with exact gradient
/// and Hessian.
#include <Eigen/Core>
#include <vector>

#include "knothe/numerics/minimiser.hpp"
#include "knothe/numerics/quadrature.hpp"
#include "knothe/sampling/checked_density.hpp"
#include "knothe/transport/composed_map.hpp"
#include "knothe/transport/point_tables.hpp"

namespace knothe::transport {

/// Tables of one dimension, order and rule, used again by every solve.
struct TrainingTables {
  numerics::PointRule rule;
  MapLayout layout;
  PointTables points;
  Eigen::VectorXd log_reference;  ///< log ρ at the points
  /// Per component, n × n_e: the products Φ_e at the points.
  std::vector<Eigen::MatrixXd> monotone_basis;
  /// Per component, n × n_e(n_e + 1)/2: 2 Φ'_α Φ'_β I_{α_k β_k}, the second derivatives of M^k in a_e, which
  /// do not depend on a_e. Empty where it would be too large; then the Hessian is not available.
  std::vector<Eigen::MatrixXd> pair_basis;

  TrainingTables(numerics::PointRule training_rule, int order, const TailedHermite& basis);
  [[nodiscard]] int order() const { return points.order(); }
  [[nodiscard]] bool has_hessian() const { return !pair_basis.empty(); }
};

/// F(a) = Σ_i w_i [ log ρ(x_i) − log π̄(T(x_i)) − log |det ∇T(x_i)| ] with T = pre_map ∘ M_a; Eq. 8 plus the
/// constant E log ρ, so that the minimum is −log evidence + KL. Feasible set: h > 0 at every node in every
/// component; it is convex, and its border is the barrier over which an unguarded Newton step jumps into a
/// spurious minimum.
class KullbackLeiblerObjective final : public numerics::Objective {
 public:
  /// For one solve: all three must outlive the use.
  void begin(const TrainingTables& tables, const AffineMap& pre_map, sampling::CheckedDensity& target,
             double mode_log_density);

  [[nodiscard]] Eigen::Index dimension() const override { return tables_->layout.size(); }
  bool evaluate(const Eigen::VectorXd& a, int derivatives, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd& hessian) override;
  [[nodiscard]] double step_limit(const Eigen::VectorXd& a, const Eigen::VectorXd& step) override;

  /// ½ Var_ρ[log ρ − log π̄∘T − log|det ∇T|] on the training rule at coefficients a (Eq. 9).
  double variance_diagnostic(const Eigen::VectorXd& a);

 private:
  bool map_points(const Eigen::VectorXd& a);
  void pull_back(int derivatives);
  void fill_gradient(Eigen::VectorXd& gradient);
  void fill_hessian(Eigen::MatrixXd& hessian);

  const TrainingTables* tables_ = nullptr;
  const AffineMap* pre_map_ = nullptr;
  sampling::CheckedDensity* target_ = nullptr;
  double floor_ = 0;  ///< stands for log π̄ = −∞
  double pre_map_log_determinant_ = 0;

  std::vector<ComponentValues> component_, step_component_;
  Eigen::MatrixXd z_;
  sampling::LogDensityBatch batch_;
  Eigen::VectorXd log_determinant_, last_, scratch_;
  Eigen::MatrixXd slope_;                     ///< n × d: −w ∂ log π̄ / ∂M_k
  Eigen::MatrixXd curvature_;                 ///< n × d(d+1)/2: −w ∂² log π̄ / ∂M_k ∂M_l
  std::vector<Eigen::MatrixXd> sensitivity_;  ///< per component n × count: ∂M^k/∂a
  Eigen::MatrixXd scaled_, block_;
};

}  // namespace knothe::transport
