#pragma once
/// @file A low-dimensional map inside many dimensions: the layer of a lazy map (Bigoni, Zahm, Spantini,
/// Marzouk 2019, arXiv:1906.00031; Brennan, Bigoni, Zahm, Spantini, Marzouk 2020, Eq. 4).
#include <Eigen/Core>
#include <string>

#include "knothe/transport/map/triangular_map.hpp"

namespace knothe::transport {

/// x ↦ x + U(τ(Uᵀx) − Uᵀx): a triangular map τ in the r coordinates Uᵀx, the identity in the d − r directions
/// orthogonal to the columns of U. Not triangular unless U is a set of unit vectors in order.
class SubspaceMap {
 public:
  SubspaceMap() = default;
  /// `basis`: U, d × r, orthonormal columns; `map`: τ, in r ≤ d variables. Errors: UsageError for sizes that
  /// do not agree or columns that are not orthonormal to 1e-8.
  SubspaceMap(Eigen::MatrixXd basis, TriangularMap map);

  [[nodiscard]] Eigen::Index dimension() const { return basis_.rows(); }
  [[nodiscard]] Eigen::Index rank() const { return basis_.cols(); }
  [[nodiscard]] const Eigen::MatrixXd& basis() const { return basis_; }
  [[nodiscard]] const TriangularMap& map() const { return map_; }

  /// As TriangularMap::evaluate. Derivatives take room for d² and d²(d + 1)/2 numbers a point; where the
  /// dimension is high, pull_back_gradient (pull_back.hpp) does without.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives, MapBatch& out) const;
  [[nodiscard]] Eigen::MatrixXd inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// One line for the subspace, then the map in it.
  [[nodiscard]] std::string describe() const;

 private:
  Eigen::MatrixXd basis_;
  TriangularMap map_;
};

}  // namespace knothe::transport
