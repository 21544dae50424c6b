#pragma once
/// @file Measurement noise: independent, or correlated through a precision matrix (global DIC); the same at
/// every step, or not; independent from step to step, or with a part that all steps share.
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <map>
#include <memory>
#include <vector>

#include "knothe/reduction/model/parameter_functions.hpp"

namespace knothe::assimilation {

/// Gaussian noise N(0, R) on n observed dofs, as what the likelihood wants: R⁻¹ applied to vectors, and log
/// det R. Immutable; copies share what is large.
class NoiseModel {
 public:
  /// Independent noise of the given standard deviations (m for displacements), all positive and finite.
  [[nodiscard]] static NoiseModel independent(const Eigen::VectorXd& std);
  /// Correlated noise of precision R⁻¹, full symmetric n × n (e.g. M_DIC / 2γ²). A dof whose row is zero is
  /// not measured at all (a node without a valid element). Throws DataError unless it is symmetric and, but
  /// for such rows, positive definite.
  [[nodiscard]] static NoiseModel correlated(const Eigen::SparseMatrix<double>& precision);
  /// Correlated noise of covariance R, dense. Throws UsageError unless it is square, symmetric and positive
  /// definite.
  [[nodiscard]] static NoiseModel of_covariance(const Eigen::MatrixXd& covariance);

  /// The same noise with another one at step `step` (a picture with elements removed), of as many dofs.
  [[nodiscard]] NoiseModel with_step(std::size_t step, NoiseModel noise) const;
  /// The same noise at each step, but with a part common to all steps: the noise of `pictures` ≥ 1 averaged
  /// reference pictures, e_t = own_t + shared, Cov(shared) = Cov(own_t) / pictures. R stays the covariance
  /// of one step, own and shared part together.
  [[nodiscard]] NoiseModel with_shared_reference(int pictures) const;

  /// The same noise with a constant error of each sensor besides, N(0, std²), std > 0 (m): an offset that is
  /// not known. It is not part of R.
  [[nodiscard]] NoiseModel with_offsets(double std) const;

  /// The same noise with further observations behind the others, independent of them and of each other:
  /// load cells and gauges, `std` in their units. They have no part in offsets, the reference picture or the
  /// scale.
  [[nodiscard]] NoiseModel with_scalars(const Eigen::VectorXd& std) const;
  /// The same noise with an error of step `step` besides that all its dofs have together, N(0, F Fᵀ),
  /// `factor` n × q: what the clock is off by. It is not part of R.
  [[nodiscard]] NoiseModel with_step_error(std::size_t step, Eigen::MatrixXd factor) const;

  /// The same noise with a factor 1 + ε on the values of all steps besides, ε ~ N(0, relative_std²): metres
  /// per pixel that are not known exactly. It is not part of R. It is linearised about the prediction at
  /// the centre of the parameters, so that ε (y − y₀) must be small against the noise. Further observations
  /// (`with_scalars`) have no part in it.
  [[nodiscard]] NoiseModel with_scale_error(double relative_std) const;

  [[nodiscard]] Eigen::Index size() const { return size_; }
  [[nodiscard]] bool is_independent() const { return precision_ == nullptr; }
  [[nodiscard]] bool is_measured(Eigen::Index dof) const;                   ///< its row of R⁻¹ is not zero
  [[nodiscard]] bool is_complete() const { return is_complete_; }           ///< all dofs are measured
  [[nodiscard]] int shared_reference() const { return shared_reference_; }  ///< 0: nothing is shared
  [[nodiscard]] double offset_std() const { return offset_std_; }           ///< 0: no offsets
  [[nodiscard]] double scale_std() const { return scale_std_; }             ///< 0: the scale is exact
  [[nodiscard]] Eigen::Index scalar_count() const { return scalar_count_; }  ///< of `with_scalars`, the last
  /// Steps share an error: what one says depends on those before it.
  [[nodiscard]] bool links_steps() const {
    return shared_reference_ > 0 || offset_std_ > 0 || scale_std_ > 0;
  }
  [[nodiscard]] bool has_step_errors() const { return !step_errors_.empty(); }
  /// F of step `step`; null where there is none.
  [[nodiscard]] const Eigen::MatrixXd* step_error(std::size_t step) const;
  [[nodiscard]] bool has_step(std::size_t step) const { return steps_.contains(step); }
  /// Noise of step `step`: this one where no other was given.
  [[nodiscard]] const NoiseModel& at_step(std::size_t step) const;

  [[nodiscard]] double log_determinant() const { return log_determinant_; }  ///< log det R, measured dofs
  /// R⁻¹ X, n × anything.
  [[nodiscard]] Eigen::MatrixXd apply(const Eigen::Ref<const Eigen::MatrixXd>& x) const;
  /// The same into `out`, without allocating (but for noise restricted to a part of correlated dofs).
  void apply(const Eigen::Ref<const Eigen::VectorXd>& x, Eigen::Ref<Eigen::VectorXd> out) const;
  /// The same for several columns at once, a row of them for each dof: one pass over R⁻¹.
  void apply(const reduction::RowMatrix& x, reduction::RowMatrix& out) const;
  /// Marginal noise of the dofs `kept` (increasing indices of measured dofs): for correlated noise the
  /// precision of a subset is the Schur complement M_ss − M_su M_uu⁻¹ M_us, not the rows of M. It is applied,
  /// never formed: it is dense.
  [[nodiscard]] NoiseModel restricted(const std::vector<Eigen::Index>& kept) const;
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
  int shared_reference_ = 0;
  double offset_std_ = 0, scale_std_ = 0;
  Eigen::Index scalar_count_ = 0;
  std::map<std::size_t, std::shared_ptr<const Eigen::MatrixXd>> step_errors_;
  std::map<std::size_t, std::shared_ptr<const NoiseModel>> steps_;
};

}  // namespace knothe::assimilation
