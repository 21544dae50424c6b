#pragma once
/// @file A user's log-density, called with care: buffers poisoned before, checked after, points counted.
#include <cstdint>

#include "knothe/posterior/log_density.hpp"

namespace knothe::posterior {

/// Wraps a target for the length of one solve.
class CheckedDensity {
 public:
  explicit CheckedDensity(LogDensity& target) : target_(&target) {}

  [[nodiscard]] Eigen::Index dimension() const { return target_->dimension(); }
  [[nodiscard]] int available_derivatives() const { return target_->available_derivatives(); }
  [[nodiscard]] std::int64_t evaluations() const { return evaluations_; }

  /// Resizes `out` and fills it with what the target itself can give. Errors: NumericalError, with the point,
  /// for a value of NaN or +∞, a gradient or Hessian that is not finite, an entry not written; UsageError for
  /// buffers that come back with another size; Interrupted where the user asked to stop. What the target
  /// throws comes through as it is. A value below `k_min_log_density` is a density of zero: its derivatives,
  /// which overflow there, are not asked for.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives, LogDensityBatch& out);

  /// The same up to second derivatives, those that the target lacks by central differences of those that it
  /// has, the steps being `scales` (n × d: how far a point may move until the density changes much) times
  /// 1e-5 (gradients known) or 2e-4. Where the density is zero nearby they are zero.
  void evaluate_with_differences(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                                 const Eigen::Ref<const Eigen::MatrixXd>& scales, LogDensityBatch& out);
  static constexpr double k_min_log_density = -1e100;
  /// Relative steps of these differences.
  static constexpr double k_gradient_step = 1e-5, k_value_step = 2e-4;

  /// As long as one lives, points at which the target gives NaN, +∞ or derivatives that are not finite count
  /// as points without density: for searches far away from where parameters make sense.
  class Leniency {
   public:
    explicit Leniency(CheckedDensity& density) : density_(density), before_(density.lenient_) {
      density_.lenient_ = true;
    }
    ~Leniency() { density_.lenient_ = before_; }
    Leniency(const Leniency&) = delete;
    Leniency& operator=(const Leniency&) = delete;

   private:
    CheckedDensity& density_;
    bool before_;
  };

 private:
  void excuse(int derivatives, LogDensityBatch& out) const;
  void check(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
             const LogDensityBatch& out) const;

  LogDensity* target_;
  std::int64_t evaluations_ = 0;
  bool lenient_ = false;
  LogDensityBatch shifted_;
  Eigen::MatrixXd shifted_points_, steps_;
};

}  // namespace knothe::posterior
