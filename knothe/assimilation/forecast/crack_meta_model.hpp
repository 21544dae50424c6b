#pragma once
/// @file u(x, l): elastic displacement of a beam with a crack of length l (Rubio et al. 2019, Eq. 32).
#include <Eigen/Core>
#include <span>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::assimilation {

/// u_SVD(x, l) = Σ_k σ_k u_k(x) v_k(l) at the observed dofs, for a unit imposed displacement; v_k are
/// not-a-knot cubic splines through the right singular vectors. The number of modes is the smallest for which
/// the neglected part is at most `relative_tolerance` of the whole (Frobenius norm).
class CrackMetaModel {
 public:
  /// `lengths`: strictly increasing, at least 4 [m]; `solutions`: one row per length, one column per observed
  /// dof [m per m]. Errors: DataError for lengths that do not increase, shapes that disagree, values that are
  /// not finite.
  CrackMetaModel(std::span<const double> lengths, const Eigen::Ref<const Eigen::MatrixXd>& solutions,
                 double relative_tolerance = 1e-6);

  [[nodiscard]] Index modes() const { return space_.cols(); }  ///< N_SVD
  [[nodiscard]] Index observations() const { return space_.rows(); }
  [[nodiscard]] std::span<const double> lengths() const { return lengths_; }
  /// σ_k u_k at the observed dofs, n_obs × N_SVD.
  [[nodiscard]] const Eigen::MatrixXd& space() const { return space_; }
  /// v = `coefficients` (N_SVD × number of lengths) times the functions of `basis`.
  [[nodiscard]] const numerics::CubicSplineBasis& basis() const { return basis_; }
  [[nodiscard]] const Eigen::MatrixXd& coefficients() const { return coefficients_; }
  /// All singular values, the neglected ones too.
  [[nodiscard]] const Eigen::VectorXd& singular_values() const { return singular_values_; }

  /// v(l), one column per length: N_SVD × number of lengths. Lengths outside the range are moved to its ends.
  [[nodiscard]] Eigen::MatrixXd coordinates(std::span<const double> lengths) const;
  /// v(l) at one length, N_SVD.
  void evaluate(double length, Eigen::Ref<Eigen::VectorXd> value) const;

 private:
  std::vector<double> lengths_;
  Eigen::MatrixXd space_;
  Eigen::VectorXd singular_values_;
  numerics::CubicSplineBasis basis_;
  Eigen::MatrixXd coefficients_;
};

}  // namespace knothe::assimilation
