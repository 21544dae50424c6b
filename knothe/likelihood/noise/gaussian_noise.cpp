#include "knothe/likelihood/noise/gaussian_noise.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cassert>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/linear/selected_inverse.hpp"

namespace knothe::likelihood {
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

/// The matrix that takes the rows `kept` out of a vector, transposed: n × number of rows.
Sparse selection(Eigen::Index n, const std::vector<Eigen::Index>& kept) {
  Sparse s(n, std::ssize(kept));
  s.reserve(Eigen::VectorXi::Ones(s.cols()));
  for (std::size_t j = 0; j < kept.size(); ++j) s.insert(kept[j], j) = 1;
  s.makeCompressed();
  return s;
}

}  // namespace

/// M_ss, M_us and the factor of M_uu, for s the dofs kept and u those that are measured and left out.
struct GaussianNoise::Marginal {
  std::vector<Eigen::Index> kept;
  Sparse block, coupling;
  Factor factor;
  double whole_log_determinant = 0;  ///< log det M⁻¹

  template <class X>
  [[nodiscard]] Eigen::MatrixXd apply(const X& x) const {
    Eigen::MatrixXd out = block * x;
    if (coupling.rows() > 0) out -= coupling.transpose() * factor.solve(Eigen::MatrixXd(coupling * x));
    return out;
  }
};

GaussianNoise GaussianNoise::independent(const Eigen::VectorXd& std) {
  GaussianNoise noise;
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

GaussianNoise GaussianNoise::correlated(const Sparse& precision) {
  if (precision.rows() != precision.cols() || precision.rows() == 0) {
    throw DataError(
        fmt::format("noise/precision is {} × {}: it must be square", precision.rows(), precision.cols()));
  }
  const Sparse difference = precision - Sparse(precision.transpose());
  if (difference.norm() > 1e-9 * precision.norm()) {
    throw DataError("noise/precision is not symmetric: store the full symmetric matrix");
  }
  auto matrix = std::make_shared<Sparse>(precision);
  matrix->prune(0.0, 0.0);
  matrix->makeCompressed();
  GaussianNoise noise;
  noise.size_ = precision.rows();
  noise.precision_ = matrix;
  noise.count_measured();
  Sparse regular = *matrix;  // a unit diagonal where nothing is measured: log 1 = 0
  if (!noise.is_complete_) {
    for (Eigen::Index i = 0; i < noise.size_; ++i) {
      if (!noise.is_measured(i)) regular.coeffRef(i, i) = 1;
    }
  }
  Factor factor;
  factorise(factor, regular);
  noise.log_determinant_ = -factor.vectorD().array().log().sum();
  return noise;
}

GaussianNoise GaussianNoise::of_covariance(const Eigen::MatrixXd& covariance) {
  if (covariance.rows() != covariance.cols())
    throw UsageError(
        fmt::format("noise: the covariance is {} × {}, not square", covariance.rows(), covariance.cols()));
  const Eigen::VectorXd scale = covariance.diagonal().cwiseAbs().cwiseSqrt();
  if (!((covariance - covariance.transpose()).cwiseAbs().array() <=
        1e-10 * (scale * scale.transpose()).array())
           .all())
    throw UsageError("noise: the covariance is not symmetric");
  const Eigen::LLT<Eigen::MatrixXd> cholesky(covariance);
  const Eigen::VectorXd diagonal = Eigen::MatrixXd(cholesky.matrixL()).diagonal();
  if (cholesky.info() != Eigen::Success || !(diagonal.array() > 1e-7 * scale.array()).all())
    throw UsageError("noise: the covariance is singular or indefinite; it must be positive definite");
  const Eigen::MatrixXd inverse =
      cholesky.solve(Eigen::MatrixXd::Identity(covariance.rows(), covariance.cols()));
  GaussianNoise noise = correlated((0.5 * (inverse + inverse.transpose())).eval().sparseView());
  noise.log_determinant_ = 2 * diagonal.array().log().sum();
  return noise;
}

void GaussianNoise::count_measured() {
  is_complete_ = true;
  for (Eigen::Index i = 0; i < size_; ++i) is_complete_ = is_complete_ && is_measured(i);
}

bool GaussianNoise::is_measured(Eigen::Index dof) const {
  if (is_independent() || marginal_) return true;
  return precision_->outerIndexPtr()[dof + 1] > precision_->outerIndexPtr()[dof];
}

GaussianNoise GaussianNoise::with_independent(const Eigen::VectorXd& std) const {
  assert(!marginal_);
  const GaussianNoise further = independent(std);
  GaussianNoise result = *this;
  result.size_ += std.size();
  result.log_determinant_ += further.log_determinant_;
  if (is_independent()) {
    result.inverse_variance_.resize(result.size_);
    result.inverse_variance_ << inverse_variance_, further.inverse_variance_;
  } else {
    Sparse whole = *precision_;
    whole.conservativeResize(result.size_, result.size_);
    for (Eigen::Index i = size_; i < result.size_; ++i)
      whole.insert(i, i) = further.inverse_variance_[i - size_];
    whole.makeCompressed();
    result.precision_ = std::make_shared<const Sparse>(std::move(whole));
  }
  return result;
}

Eigen::MatrixXd GaussianNoise::apply(const Eigen::Ref<const Eigen::MatrixXd>& x) const {
  if (is_independent()) return inverse_variance_.asDiagonal() * x;
  if (marginal_) return marginal_->apply(x);
  return *precision_ * x;
}

void GaussianNoise::apply(const Eigen::Ref<const Eigen::VectorXd>& x, Eigen::Ref<Eigen::VectorXd> out) const {
  if (is_independent()) {
    out = inverse_variance_.cwiseProduct(x);
  } else if (marginal_) {
    out = marginal_->apply(x);
  } else {
    out.noalias() = *precision_ * x;
  }
}

void GaussianNoise::apply(const model::RowMatrix& x, model::RowMatrix& out) const {
  out.resize(x.rows(), x.cols());
  if (is_independent()) {
    out = inverse_variance_.asDiagonal() * x;
    return;
  }
  if (marginal_) {
    out = marginal_->apply(Eigen::MatrixXd(x));
    return;
  }
  // R⁻¹ is symmetric: its columns, which are stored, are its rows.
  const auto* const starts = precision_->outerIndexPtr();
  const auto* const inner = precision_->innerIndexPtr();
  const double* const values = precision_->valuePtr();
  for (Eigen::Index i = 0; i < size_; ++i) {
    double* const row = out.row(i).data();
    std::fill_n(row, x.cols(), 0.0);
    for (auto k = starts[i]; k < starts[i + 1]; ++k) {
      const double value = values[k];
      const double* const from = x.row(inner[k]).data();
      for (Eigen::Index j = 0; j < x.cols(); ++j) row[j] += value * from[j];
    }
  }
}

GaussianNoise GaussianNoise::restricted(const std::vector<Eigen::Index>& kept) const {
  const auto n_kept = std::ssize(kept);
  GaussianNoise noise;
  noise.size_ = n_kept;
  if (is_independent()) {
    noise.inverse_variance_ = inverse_variance_(kept);
    noise.log_determinant_ = -noise.inverse_variance_.array().log().sum();
    return noise;
  }
  auto marginal = std::make_shared<Marginal>();
  for (const Eigen::Index i : kept) marginal->kept.push_back(marginal_ ? marginal_->kept[i] : i);
  std::vector<Eigen::Index> left_out;
  std::size_t next = 0;
  for (Eigen::Index i = 0; i < precision_->cols(); ++i) {
    const bool measured = precision_->outerIndexPtr()[i + 1] > precision_->outerIndexPtr()[i];
    if (next < marginal->kept.size() && marginal->kept[next] == i) {
      assert(measured);
      ++next;
    } else if (measured) {
      left_out.push_back(i);
    }
  }
  const Sparse s = selection(precision_->cols(), marginal->kept);
  if (left_out.empty()) {
    noise.precision_ = std::make_shared<const Sparse>(s.transpose() * *precision_ * s);
    noise.log_determinant_ = marginal_ ? marginal_->whole_log_determinant : log_determinant_;
    return noise;
  }
  const Sparse u = selection(precision_->cols(), left_out);
  marginal->block = s.transpose() * *precision_ * s;
  marginal->coupling = u.transpose() * *precision_ * s;
  noise.precision_ = precision_;
  // det of the Schur complement: det M / det M_uu, M on all that is measured.
  marginal->whole_log_determinant = marginal_ ? marginal_->whole_log_determinant : log_determinant_;
  noise.log_determinant_ = marginal->whole_log_determinant;
  if (!left_out.empty()) {
    factorise(marginal->factor, Sparse(u.transpose() * *precision_ * u));
    noise.log_determinant_ += marginal->factor.vectorD().array().log().sum();
  }
  noise.marginal_ = std::move(marginal);
  return noise;
}

Eigen::VectorXd GaussianNoise::standard_deviations() const {
  if (is_independent()) return inverse_variance_.cwiseInverse().cwiseSqrt();
  Sparse regular = *precision_;
  for (Eigen::Index i = 0; i < regular.cols(); ++i) {
    if (precision_->outerIndexPtr()[i + 1] == precision_->outerIndexPtr()[i]) regular.coeffRef(i, i) = 1;
  }
  Eigen::VectorXd std = numerics::SelectedInverse(regular).diagonal().cwiseSqrt();
  if (marginal_) return std(marginal_->kept);  // the marginal of a part is a part of the marginal
  for (Eigen::Index i = 0; i < size_; ++i) {
    if (!is_measured(i)) std[i] = 0;
  }
  return std;
}

Sparse GaussianNoise::precision() const {
  assert(!marginal_);
  if (!is_independent()) return *precision_;
  Sparse diagonal(size_, size_);
  diagonal.reserve(Eigen::VectorXi::Ones(size_));
  for (Eigen::Index i = 0; i < size_; ++i) diagonal.insert(i, i) = inverse_variance_[i];
  diagonal.makeCompressed();
  return diagonal;
}

Eigen::MatrixXd apply_with_error(const GaussianNoise& noise, const Eigen::MatrixXd& factor,
                                 const Eigen::Ref<const Eigen::MatrixXd>& x) {
  const Eigen::MatrixXd weighted = noise.apply(factor);
  Eigen::MatrixXd information = factor.transpose() * weighted;
  information.diagonal().array() += 1;
  return noise.apply(x) - weighted * information.llt().solve(weighted.transpose() * x);
}

}  // namespace knothe::likelihood
