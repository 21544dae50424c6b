#pragma once
/// @file Inner products of functions of the parameters, given at the nodes of the grid. Private to this room.
#include <Eigen/Core>
#include <span>
#include <vector>

#include "knothe/model/compress/compression.hpp"

namespace knothe::model {

/// ⟨f, g⟩ = fᵀ W g for the values f, g at the grid points (C order), W = ⊗_i W_i, one factor per axis:
///
///   nodes:  W_i = the trapezoid weights,
///   spline: W_i = ∫ c cᵀ dx / h,
///
/// with the cardinal splines c of the axis and its length h: what is measured is the spline, between the
/// nodes too.
class ParameterProduct {
 public:
  ParameterProduct(std::span<const Axis> axes, const CompressionOptions& options);

  /// L_i with W_i = L_i L_iᵀ, lower triangular.
  [[nodiscard]] const std::vector<Eigen::MatrixXd>& factors() const { return factors_; }
  /// L x for columns x, where W = L Lᵀ, L = ⊗_i L_i.
  [[nodiscard]] Eigen::MatrixXd times(Eigen::MatrixXd columns) const;
  /// Lᵀ x for columns x.
  [[nodiscard]] Eigen::MatrixXd transposed_times(Eigen::MatrixXd columns) const;
  /// Columns f with Lᵀ f = `coordinates`: what is orthonormal there is orthonormal in W.
  [[nodiscard]] Eigen::MatrixXd at_nodes(Eigen::MatrixXd coordinates) const;

 private:
  std::vector<Eigen::MatrixXd> factors_, transposed_, inverse_transposed_;
};

}  // namespace knothe::model
