#include "knothe/assimilation/noise_model.hpp"

#include <fmt/format.h>

#include <Eigen/SparseCholesky>
#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Factor = Eigen::SimplicialLDLT<Sparse>;

void factorise(Factor& factor, const Sparse& matrix) {
  factor.compute(matrix);
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 0)) {
    throw DataError(
        "noise/precision is not positive definite: it must be the inverse of a covariance matrix");
  }
}

}  // namespace

NoiseModel NoiseModel::independent(const Eigen::VectorXd& std) {
  NoiseModel noise;
  noise.size_ = std.size();
  noise.inverse_variance_.resize(std.size());
  for (Eigen::Index i = 0; i < std.size(); ++i) {
    if (!(std[i] > 0) || !std::isfinite(std[i])) {
      throw DataError(
          fmt::format("noise/std[{}] is {}: a standard deviation is positive and finite", i, std[i]));
    }
    noise.inverse_variance_[i] = 1 / (std[i] * std[i]);
    if (!std::isfinite(noise.inverse_variance_[i])) {
      throw DataError(fmt::format("noise/std[{}] is {}: too small for its square to be a number", i, std[i]));
    }
    noise.log_determinant_ += 2 * std::log(std[i]);
  }
  return noise;
}

NoiseModel NoiseModel::correlated(const Sparse& precision) {
  if (precision.rows() != precision.cols() || precision.rows() == 0) {
    throw DataError(
        fmt::format("noise/precision is {} × {}: it must be square", precision.rows(), precision.cols()));
  }
  const Sparse difference = precision - Sparse(precision.transpose());
  if (difference.norm() > 1e-9 * precision.norm()) {
    throw DataError("noise/precision is not symmetric: store the full symmetric matrix");
  }
  NoiseModel noise;
  noise.size_ = precision.rows();
  noise.precision_ = precision;
  noise.precision_.makeCompressed();
  Factor factor;
  factorise(factor, noise.precision_);
  noise.log_determinant_ = -factor.vectorD().array().log().sum();
  return noise;
}

Eigen::MatrixXd NoiseModel::apply(const Eigen::Ref<const Eigen::MatrixXd>& x) const {
  if (is_independent()) return inverse_variance_.asDiagonal() * x;
  return precision_ * x;
}

void NoiseModel::apply(const Eigen::Ref<const Eigen::VectorXd>& x, Eigen::Ref<Eigen::VectorXd> out) const {
  if (is_independent()) {
    out = inverse_variance_.cwiseProduct(x);
  } else {
    out.noalias() = precision_ * x;
  }
}

NoiseModel NoiseModel::restricted(const std::vector<Eigen::Index>& kept) const {
  const auto n_kept = static_cast<Eigen::Index>(kept.size());
  if (is_independent()) {
    Eigen::VectorXd std(n_kept);
    for (Eigen::Index i = 0; i < n_kept; ++i) std[i] = 1 / std::sqrt(inverse_variance_[kept[i]]);
    return independent(std);
  }
  // Selections S (kept) and U (left out) as sparse matrices, then the Schur complement.
  std::vector<Eigen::Triplet<double>> s_entries, u_entries;
  std::size_t next = 0;
  Eigen::Index n_out = 0;
  for (Eigen::Index i = 0; i < size_; ++i) {
    if (next < kept.size() && kept[next] == i) {
      s_entries.emplace_back(static_cast<int>(i), static_cast<int>(next++), 1.0);
    } else {
      u_entries.emplace_back(static_cast<int>(i), static_cast<int>(n_out++), 1.0);
    }
  }
  Sparse s(size_, n_kept), u(size_, n_out);
  s.setFromTriplets(s_entries.begin(), s_entries.end());
  u.setFromTriplets(u_entries.begin(), u_entries.end());
  Sparse kept_block = s.transpose() * precision_ * s;
  if (n_out > 0) {
    const Sparse coupling = u.transpose() * precision_ * s;
    Factor factor;
    factorise(factor, Sparse(u.transpose() * precision_ * u));
    const Sparse correction = coupling.transpose() * Sparse(factor.solve(coupling));
    kept_block = kept_block - correction;
    kept_block = Sparse(0.5 * (kept_block + Sparse(kept_block.transpose())));
  }
  return correlated(kept_block);
}

Eigen::VectorXd NoiseModel::standard_deviations() const {
  if (is_independent()) return inverse_variance_.cwiseInverse().cwiseSqrt();
  Factor factor;
  factorise(factor, precision_);
  Eigen::VectorXd std(size_), unit = Eigen::VectorXd::Zero(size_);
  for (Eigen::Index i = 0; i < size_; ++i) {
    unit[i] = 1;
    std[i] = std::sqrt(factor.solve(unit)[i]);
    unit[i] = 0;
  }
  return std;
}

}  // namespace knothe::assimilation
