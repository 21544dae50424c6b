#pragma once
/// @file Gaussian noise of one datum: independent, or correlated through a precision matrix (global DIC).
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <memory>
#include <vector>

#include "knothe/model/reduced/parameter_functions.hpp"

namespace knothe::likelihood {

/// N(0, R) on n observed dofs, as what the likelihood wants: R⁻¹ applied to vectors, and log det R.
/// Immutable; copies share what is large.
class GaussianNoise {
 public:
  /// Independent noise of the given standard deviations (m for displacements), all positive and finite.
  [[nodiscard]] static GaussianNoise independent(const Eigen::VectorXd& std);
  /// Correlated noise of precision R⁻¹, full symmetric n × n (e.g. M_DIC / 2γ²). A dof whose row is zero is
  /// not measured at all (a node without a valid element). Throws DataError unless it is symmetric and, but
  /// for such rows, positive definite.
  [[nodiscard]] static GaussianNoise correlated(const Eigen::SparseMatrix<double>& precision);
  /// Correlated noise of covariance R, dense. Throws UsageError unless it is square, symmetric and positive
  /// definite.
  [[nodiscard]] static GaussianNoise of_covariance(const Eigen::MatrixXd& covariance);

  /// The same noise with further dofs behind the others, independent of them and of each other.
  [[nodiscard]] GaussianNoise with_independent(const Eigen::VectorXd& std) const;

  [[nodiscard]] Eigen::Index size() const { return size_; }
  [[nodiscard]] bool is_independent() const { return precision_ == nullptr; }
  [[nodiscard]] bool is_measured(Eigen::Index dof) const;          ///< its row of R⁻¹ is not zero
  [[nodiscard]] bool is_complete() const { return is_complete_; }  ///< all dofs are measured

  [[nodiscard]] double log_determinant() const { return log_determinant_; }  ///< log det R, measured dofs
  /// R⁻¹ X, n × anything.
  [[nodiscard]] Eigen::MatrixXd apply(const Eigen::Ref<const Eigen::MatrixXd>& x) const;
  /// The same into `out`, without allocating (but for noise restricted to a part of correlated dofs).
  void apply(const Eigen::Ref<const Eigen::VectorXd>& x, Eigen::Ref<Eigen::VectorXd> out) const;
  /// The same for several columns at once, a row of them for each dof: one pass over R⁻¹.
  void apply(const model::RowMatrix& x, model::RowMatrix& out) const;
  /// Marginal noise of the dofs `kept` (increasing indices of measured dofs): for correlated noise the
  /// precision of a subset is the Schur complement M_ss − M_su M_uu⁻¹ M_us, not the rows of M. It is applied,
  /// never formed: it is dense.
  [[nodiscard]] GaussianNoise restricted(const std::vector<Eigen::Index>& kept) const;
  /// Marginal standard deviation of each dof; 0 for one that is not measured.
  [[nodiscard]] Eigen::VectorXd standard_deviations() const;
  /// R⁻¹ of correlated noise that is not restricted; a diagonal matrix of independent noise.
  [[nodiscard]] Eigen::SparseMatrix<double> precision() const;
  /// 1/σ² of independent noise.
  [[nodiscard]] const Eigen::VectorXd& inverse_variance() const { return inverse_variance_; }

 private:
  struct Marginal;
  void count_measured();

  Eigen::Index size_ = 0;
  bool is_complete_ = true;
  Eigen::VectorXd inverse_variance_;                              ///< independent noise
  std::shared_ptr<const Eigen::SparseMatrix<double>> precision_;  ///< correlated noise, before restriction
  std::shared_ptr<const Marginal> marginal_;                      ///< what a restriction needs, else null
  double log_determinant_ = 0;
};

/// (R + F Fᵀ)⁻¹ X by Woodbury's identity: of `noise` with an error besides that its dofs have together,
/// N(0, F Fᵀ), `factor` n × q.
[[nodiscard]] Eigen::MatrixXd apply_with_error(const GaussianNoise& noise, const Eigen::MatrixXd& factor,
                                               const Eigen::Ref<const Eigen::MatrixXd>& x);

}  // namespace knothe::likelihood
