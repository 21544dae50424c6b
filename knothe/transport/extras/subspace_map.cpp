#include "knothe/transport/extras/subspace_map.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/sampling/log_density.hpp"

namespace knothe::transport {

SubspaceMap::SubspaceMap(Eigen::MatrixXd basis, TriangularMap map)
    : basis_(std::move(basis)), map_(std::move(map)) {
  if (basis_.cols() < 1 || basis_.cols() > basis_.rows() || map_.dimension() != basis_.cols())
    throw UsageError(
        fmt::format("subspace map: a basis of {} × {} and a map in {} variables; the map must have as "
                    "many variables as the basis has columns, at most as many as it has rows",
                    basis_.rows(), basis_.cols(), map_.dimension()));
  const Eigen::MatrixXd gram = basis_.transpose() * basis_;
  if (!((gram - Eigen::MatrixXd::Identity(basis_.cols(), basis_.cols())).cwiseAbs().maxCoeff() < 1e-8))
    throw UsageError("subspace map: the columns of the basis are not orthonormal; orthonormalise them first");
}

void SubspaceMap::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                           MapBatch& out) const {
  const Eigen::Index n = points.rows(), d = dimension(), r = rank();
  const Eigen::MatrixXd inner = points * basis_;  // n × r
  MapBatch low;
  map_.evaluate(inner, derivatives, low);
  out.resize(n, d, derivatives);
  out.value = points;
  out.value.noalias() += (low.value - inner) * basis_.transpose();
  out.log_determinant = low.log_determinant;
  if (derivatives >= 1) {  // ∂_j M_i = δ_ij + Σ_ab U_ia (∂_b τ_a − δ_ab) U_jb
    for (Eigen::Index a = 0; a < r; ++a) low.jacobian.col(a * r + a).array() -= 1;
    Eigen::MatrixXd half(n, r);
    for (Eigen::Index i = 0; i < d; ++i) {
      half.setZero();
      for (Eigen::Index a = 0; a < r; ++a)
        for (Eigen::Index b = 0; b < r; ++b) half.col(b) += basis_(i, a) * low.jacobian.col(a * r + b);
      out.jacobian.middleCols(i * d, d).noalias() = half * basis_.transpose();
      out.jacobian.col(i * d + i).array() += 1;
    }
  }
  if (derivatives < 2) return;
  const Eigen::Index packed = d * (d + 1) / 2, low_packed = r * (r + 1) / 2;
  Eigen::MatrixXd half(n, low_packed);
  for (Eigen::Index i = 0; i < d; ++i) {  // ∂_jk M_i = Σ_abc U_ia ∂_bc τ_a U_jb U_kc
    half.setZero();
    for (Eigen::Index a = 0; a < r; ++a)
      half += basis_(i, a) * low.hessian.middleCols(a * low_packed, low_packed);
    for (Eigen::Index j = 0; j < d; ++j)
      for (Eigen::Index k = 0; k <= j; ++k) {
        auto entry = out.hessian.col(i * packed + sampling::packed_index(j, k));
        entry.setZero();
        for (Eigen::Index b = 0; b < r; ++b)
          for (Eigen::Index c = 0; c < r; ++c)
            entry += basis_(j, b) * basis_(k, c) * half.col(sampling::packed_index(b, c));
      }
  }
}

Eigen::MatrixXd SubspaceMap::inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  const Eigen::MatrixXd inner = z * basis_;
  Eigen::MatrixXd x = z;
  x.noalias() += (map_.inverse(inner) - inner) * basis_.transpose();
  return x;
}

std::string SubspaceMap::describe() const {
  return fmt::format("on a subspace of {} of {} dimensions: triangular of order {}, {} coefficients\n",
                     rank(), dimension(), map_.order(), map_.coefficients().size()) +
         map_.describe();
}

}  // namespace knothe::transport
