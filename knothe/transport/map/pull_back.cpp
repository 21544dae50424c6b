#include "knothe/transport/map/pull_back.hpp"

#include <cmath>

namespace knothe::transport {

namespace {

/// ∂_a Σ_k log ∂_k M_k of a triangular map, n × r; zero where a slope is zero.
Eigen::MatrixXd log_determinant_gradient(const MapBatch& batch) {
  const Eigen::Index n = batch.value.rows(), r = batch.value.cols(), packed = r * (r + 1) / 2;
  Eigen::MatrixXd gradient = Eigen::MatrixXd::Zero(n, r);
  for (Eigen::Index k = 0; k < r; ++k)
    for (Eigen::Index a = 0; a <= k; ++a) {
      const auto slope = batch.jacobian.col(k * r + k).array();
      gradient.col(a).array() += (slope > 0).select(
          batch.hessian.col(k * packed + sampling::packed_index(k, a)).array() / slope, 0.0);
    }
  return gradient;
}

/// Row-wise g ↦ Jᵀ g, J the lower triangular Jacobian of `batch`.
Eigen::MatrixXd transposed_product(const MapBatch& batch, const Eigen::MatrixXd& g) {
  const Eigen::Index r = batch.value.cols();
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(g.rows(), r);
  for (Eigen::Index i = 0; i < r; ++i)
    for (Eigen::Index a = 0; a <= i; ++a)
      result.col(a).array() += batch.jacobian.col(i * r + a).array() * g.col(i).array();
  return result;
}

}  // namespace

void MapTrace::evaluate(const ComposedMap& map, const Eigen::Ref<const Eigen::MatrixXd>& points,
                        bool with_gradient) {
  value_ = points;
  log_determinant_.setZero(points.rows());
  const auto& parts = map.parts();
  low_.resize(parts.size());
  for (std::size_t k = parts.size(); k-- > 0;) {
    MapBatch& low = low_[k];
    if (const auto* affine = std::get_if<AffineMap>(&parts[k])) {
      value_ = (value_ * affine->matrix().transpose()).eval();
      value_.rowwise() += affine->shift.transpose();
      log_determinant_.array() += affine->log_determinant();
    } else if (const auto* triangular = std::get_if<TriangularMap>(&parts[k])) {
      triangular->evaluate(value_, with_gradient ? 2 : 0, low);
      value_ = low.value;
      log_determinant_ += low.log_determinant;
    } else {
      const auto& subspace = std::get<SubspaceMap>(parts[k]);
      const Eigen::MatrixXd inner = value_ * subspace.basis();
      subspace.map().evaluate(inner, with_gradient ? 2 : 0, low);
      value_.noalias() += (low.value - inner) * subspace.basis().transpose();
      log_determinant_ += low.log_determinant;
    }
  }
}

void MapTrace::pull_back_gradient(const ComposedMap& map, double c, Eigen::MatrixXd& gradient) const {
  const auto& parts = map.parts();
  for (std::size_t k = 0; k < parts.size(); ++k) {
    if (const auto* affine = std::get_if<AffineMap>(&parts[k])) {
      gradient = (gradient * affine->matrix()).eval();
    } else if (std::holds_alternative<TriangularMap>(parts[k])) {
      gradient = transposed_product(low_[k], gradient) + c * log_determinant_gradient(low_[k]);
    } else {
      const Eigen::MatrixXd& basis = std::get<SubspaceMap>(parts[k]).basis();
      const Eigen::MatrixXd inner = gradient * basis;
      const Eigen::MatrixXd change =
          transposed_product(low_[k], inner) + c * log_determinant_gradient(low_[k]) - inner;
      gradient.noalias() += change * basis.transpose();
    }
  }
}

void PullBackDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                               sampling::LogDensityBatch& out) {
  trace_.evaluate(map_, points, derivatives >= 1);
  target_->evaluate(trace_.value(), derivatives, out);
  out.value += trace_.log_determinant();
  if (derivatives >= 1) trace_.pull_back_gradient(map_, 1, out.gradient);
}

}  // namespace knothe::transport
