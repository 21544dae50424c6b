#pragma once
/// @file Gaussian noise of the observations, by standard deviations or a full covariance.
#include <Eigen/Core>

namespace knothe::inference {

/// N(0, R) on m observations.
class GaussianNoise {
 public:
  /// Errors (both): UsageError for a deviation that is not positive, a matrix that is not square, symmetric
  /// or positive definite.
  [[nodiscard]] static GaussianNoise independent(const Eigen::VectorXd& std);
  [[nodiscard]] static GaussianNoise correlated(const Eigen::MatrixXd& covariance);

  [[nodiscard]] Eigen::Index size() const { return size_; }
  [[nodiscard]] double log_determinant() const { return log_determinant_; }  ///< log det R
  /// L⁻¹ X with R = L Lᵀ, in place; X is m × anything.
  void whiten(Eigen::Ref<Eigen::MatrixXd> x) const;
  /// L⁻ᵀ X in place: R⁻¹ X is this after `whiten`.
  void whiten_transposed(Eigen::Ref<Eigen::MatrixXd> x) const;
  [[nodiscard]] Eigen::VectorXd standard_deviations() const;

 private:
  Eigen::Index size_ = 0;
  Eigen::VectorXd inverse_std_;  ///< independent
  Eigen::MatrixXd lower_;        ///< L, correlated
  double log_determinant_ = 0;
};

}  // namespace knothe::inference
