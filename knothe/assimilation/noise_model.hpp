#pragma once
/// @file Measurement noise: independent, or correlated through a precision matrix (global DIC).
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

namespace knothe::assimilation {

/// Gaussian noise N(0, R) on n observed dofs, as what the likelihood wants: R⁻¹ applied to vectors, and log
/// det R.
class NoiseModel {
 public:
  /// Independent noise of the given standard deviations (m for displacements), all positive and finite.
  [[nodiscard]] static NoiseModel independent(const Eigen::VectorXd& std);
  /// Correlated noise of precision R⁻¹, full symmetric n × n (e.g. M_DIC / 2γ²). Throws DataError unless it
  /// is symmetric and positive definite.
  [[nodiscard]] static NoiseModel correlated(const Eigen::SparseMatrix<double>& precision);

  [[nodiscard]] Eigen::Index size() const { return size_; }
  [[nodiscard]] bool is_independent() const { return precision_.size() == 0; }
  [[nodiscard]] double log_determinant() const { return log_determinant_; }  ///< log det R
  /// R⁻¹ X, n × anything.
  [[nodiscard]] Eigen::MatrixXd apply(const Eigen::Ref<const Eigen::MatrixXd>& x) const;
  /// The same into `out`, without allocating (independent noise).
  void apply(const Eigen::Ref<const Eigen::VectorXd>& x, Eigen::Ref<Eigen::VectorXd> out) const;
  /// Marginal noise of the dofs `kept` (increasing indices): for correlated noise the precision of a subset
  /// is M_ss − M_su M_uu⁻¹ M_us, not the rows of M.
  [[nodiscard]] NoiseModel restricted(const std::vector<Eigen::Index>& kept) const;
  /// Marginal standard deviation of each dof.
  [[nodiscard]] Eigen::VectorXd standard_deviations() const;

 private:
  Eigen::Index size_ = 0;
  Eigen::VectorXd inverse_variance_;       ///< independent noise
  Eigen::SparseMatrix<double> precision_;  ///< correlated noise
  double log_determinant_ = 0;
};

}  // namespace knothe::assimilation
