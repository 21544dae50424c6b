#pragma once
/// @file The two separations of u − u_lift, as models with any number of modes. Private to this room.
#include <Eigen/Core>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/compression.hpp"
#include "knothe/model/compress/cp_als.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/reduced/deviation.hpp"
#include "knothe/model/reduced/parameter_product.hpp"

namespace knothe::model {

/// Everything of a model that does not depend on the separation: axes, lift, mesh, outputs.
[[nodiscard]] ModelContents frame_of(const Snapshots& snapshots, const Deviation& deviation);

/// The deviation as a matrix of parameters × (t, x), in coordinates in which the inner products over both are
/// Euclidean: Lᵀ v √w, P × n_t n_dof, with W = L Lᵀ.
class ParameterUnfolding final : public LargeMatrix {
 public:
  ParameterUnfolding(const Deviation& deviation, const ParameterProduct& product, std::size_t threads)
      : deviation_(deviation), product_(product), threads_(threads) {}
  [[nodiscard]] Index rows() const override { return deviation_.grid(); }
  [[nodiscard]] Index cols() const override { return deviation_.times() * deviation_.dofs(); }
  [[nodiscard]] Eigen::MatrixXd times(const Eigen::MatrixXd& b) const override;
  [[nodiscard]] Eigen::MatrixXd transposed_times(const Eigen::MatrixXd& b) const override;
  [[nodiscard]] Eigen::MatrixXd gram() const override;
  [[nodiscard]] double squared_norm() const override;

 private:
  const Deviation& deviation_;
  const ParameterProduct& product_;
  std::size_t threads_;
};

/// (x, t) against p: the singular value decomposition of the deviation, truncated, then a space basis.
class TreeSeparation {
 public:
  /// Ready for as many modes as `grid`, the dominant space of the ParameterUnfolding, has columns. Squared
  /// errors below `floor` × that of the lift alone count as rounding.
  TreeSeparation(const Deviation& deviation, const ParameterProduct& product, DominantSpace grid,
                 const CompressionOptions& options, double floor = k_rounding);
  /// What Gram matrices resolve: squares lose half the digits.
  static constexpr double k_rounding = 1e-14;
  /// The number it is ready for.
  [[nodiscard]] Index modes() const { return grid_.basis.cols(); }
  /// The modes numbered below r; the space basis is as long as the truncation of p deserves.
  void fill(ModelContents& model, std::size_t r) const;

 private:
  const Deviation& deviation_;
  const ParameterProduct& product_;
  DominantSpace grid_;
  DominantSpace space_;
  double floor_;          ///< squared error below which nothing is resolved
  Eigen::MatrixXd core_;  ///< Uᵀ Φ: L × (n_t R), columns t · R + k
};

/// The core of the deviation after compression of space and time (HOSVD), and CP decompositions of it.
class CanonicalSeparation {
 public:
  CanonicalSeparation(const Deviation& deviation, const ParameterProduct& product, const Snapshots& snapshots,
                      const CompressionOptions& options);
  /// Best decomposition found with m modes: grown from the last one asked for, and from random starts.
  [[nodiscard]] const CpFactors& decompose(std::size_t m);
  /// The modes of the last decomposition; all but the time modes normalised (paper, sec. 6.2).
  void fill(ModelContents& model) const;

 private:
  const Deviation& deviation_;
  const ParameterProduct& product_;
  const CompressionOptions& options_;
  Eigen::MatrixXd space_;  ///< n_dof × l
  Eigen::MatrixXd time_;   ///< n_t × s, orthonormal in weighted coordinates
  std::vector<Eigen::VectorXd> axis_weights_;
  CoreTensor core_;  ///< [l, s, n₁, …, n_d]
  CpFactors grown_;  ///< the mode-by-mode start
  CpFactors best_;
};

}  // namespace knothe::model
