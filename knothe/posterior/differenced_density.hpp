#pragma once
/// @file A log-density without derivatives, which gets them by differences.
#include <Eigen/Core>

#include "knothe/posterior/checked_density.hpp"

namespace knothe::posterior {

/// The values of `target`, and derivatives up to second order by central differences of them
/// (`CheckedDensity::evaluate_with_differences`) in steps that are fractions of `scales` (d: how far a point
/// may move until the density changes much). The target must outlive it.
class DifferencedDensity final : public LogDensity {
 public:
  DifferencedDensity(LogDensity& target, Eigen::VectorXd scales)
      : target_(target), scales_(std::move(scales)) {}
  [[nodiscard]] Eigen::Index dimension() const override { return target_.dimension(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                LogDensityBatch& out) override {
    target_.evaluate_with_differences(points, derivatives, scales_.transpose().replicate(points.rows(), 1),
                                      out);
  }
  /// Points at which the target was evaluated.
  [[nodiscard]] std::int64_t evaluations() const { return target_.evaluations(); }

 private:
  CheckedDensity target_;
  Eigen::VectorXd scales_;
};

}  // namespace knothe::posterior
