#pragma once
/// @file A user's log-density, called with care: buffers poisoned before, checked after, points counted.
#include <cstdint>

#include "knothe/sampling/log_density.hpp"

namespace knothe::sampling {

/// Wraps a target for the length of one solve.
class CheckedDensity {
 public:
  explicit CheckedDensity(LogDensity& target) : target_(&target) {}

  [[nodiscard]] Eigen::Index dimension() const { return target_->dimension(); }
  [[nodiscard]] int available_derivatives() const { return target_->available_derivatives(); }
  [[nodiscard]] std::int64_t evaluations() const { return evaluations_; }

  /// Resizes `out` and fills it with what the target itself can give. Errors: NumericalError, with the point,
  /// for a value of NaN or +∞, a gradient or Hessian that is not finite, an entry not written.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives, LogDensityBatch& out);

  /// The same up to second derivatives, those that the target lacks by central differences of those that it
  /// has. Where the density is zero nearby they are zero.
  void evaluate_with_differences(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                                 LogDensityBatch& out);

 private:
  void check(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
             const LogDensityBatch& out) const;

  LogDensity* target_;
  std::int64_t evaluations_ = 0;
  LogDensityBatch shifted_;
  Eigen::MatrixXd shifted_points_;
};

}  // namespace knothe::sampling
