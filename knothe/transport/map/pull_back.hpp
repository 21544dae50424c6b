#pragma once
/// @file A target seen through a map: what is left for a further map to do.
#include <Eigen/Core>

#include "knothe/sampling/log_density.hpp"
#include "knothe/transport/map/composed_map.hpp"

namespace knothe::transport {

/// Value of a composed map with what is needed to pull gradients back through it. Never forms a d × d
/// Jacobian per point for affine and subspace parts: a pull-back costs the same for 1 and for 50 dimensions
/// but for products with U.
class MapTrace {
 public:
  /// Evaluates at n points (n × d). With `with_gradient`, `pull_back_gradient` may be called afterwards.
  void evaluate(const ComposedMap& map, const Eigen::Ref<const Eigen::MatrixXd>& points, bool with_gradient);
  [[nodiscard]] const Eigen::MatrixXd& value() const { return value_; }                      ///< T(x), n × d
  [[nodiscard]] const Eigen::VectorXd& log_determinant() const { return log_determinant_; }  ///< n
  /// From ∇f at T(x) (n × d) to ∇_x [f(T(x)) + c log|det ∇T(x)|], in place. The map must still be there.
  void pull_back_gradient(const ComposedMap& map, double c, Eigen::MatrixXd& gradient) const;

 private:
  Eigen::MatrixXd value_;
  Eigen::VectorXd log_determinant_;
  std::vector<MapBatch> low_;  ///< per part: derivatives of the triangular map in it
};

/// log π̄(T(x)) + log|det ∇T(x)|, which is log ρ + log evidence where T is exact. Values and first derivatives
/// (where the target has them).
class PullBackDensity final : public sampling::LogDensity {
 public:
  /// The target must outlive this.
  PullBackDensity(ComposedMap map, sampling::LogDensity& target) : map_(std::move(map)), target_(&target) {}
  [[nodiscard]] Eigen::Index dimension() const override { return map_.dimension(); }
  [[nodiscard]] int available_derivatives() const override {
    return std::min(1, target_->available_derivatives());
  }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                sampling::LogDensityBatch& out) override;

 private:
  ComposedMap map_;
  sampling::LogDensity* target_;
  MapTrace trace_;
};

}  // namespace knothe::transport
