#include "knothe/reduction/compress/separated_tensor.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/QR>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/reduction/compress/cp_als.hpp"
#include "knothe/reduction/compress/low_rank.hpp"

namespace knothe::reduction {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

void require_same_shape(const SeparatedTensor& a, const SeparatedTensor& b, const char* what) {
  if (a.shape() != b.shape())
    throw UsageError(
        fmt::format("separated tensors: {} of shapes [{}] and [{}]; both must have the same shape", what,
                    fmt::join(a.shape(), ", "), fmt::join(b.shape(), ", ")));
}

/// Hadamard product of factor Gram matrices ⟨a_i^k, b_i^l⟩ over all indices but `left_out`.
MatrixXd gram_product(const std::vector<MatrixXd>& a, const std::vector<MatrixXd>& b, std::size_t left_out) {
  MatrixXd gram = MatrixXd::Ones(a.front().cols(), b.front().cols());
  for (std::size_t i = 0; i < a.size(); ++i)
    if (i != left_out) gram.array() *= (a[i].transpose() * b[i]).array();
  return gram;
}
constexpr std::size_t k_none = static_cast<std::size_t>(-1);

/// Entries in C order of Σ_k ⊗_i factors[i].col(k).
Eigen::VectorXd entries(const std::vector<MatrixXd>& factors) {
  MatrixXd rows = MatrixXd::Ones(1, factors.front().cols());  // entries of the first indices × terms
  for (const MatrixXd& factor : factors) {
    MatrixXd next(rows.rows() * factor.rows(), rows.cols());
    for (Index i = 0; i < rows.rows(); ++i)
      next.middleRows(i * factor.rows(), factor.rows()) = factor * rows.row(i).asDiagonal();
    rows = std::move(next);
  }
  return rows.rowwise().sum();
}

/// Restriction of one index to its dominant space: factor ≈ basis · reduced, reduced = basisᵀ factor.
struct Restriction {
  MatrixXd basis, reduced;
  double left_out = 0;  ///< squared norm of the tensor's part outside
};

/// `others` is the Gram matrix of the other indices, so F · others · Fᵀ is that of this index's unfolding.
Restriction restrict(const MatrixXd& factor, const MatrixXd& others, double allowed) {
  const Eigen::HouseholderQR<MatrixXd> qr(factor);
  const Index n = std::min(factor.rows(), factor.cols());
  const MatrixXd orthonormal = qr.householderQ() * MatrixXd::Identity(factor.rows(), n);
  const MatrixXd triangle = orthonormal.transpose() * factor;
  const FallingEigenpairs pairs = falling_eigenpairs(triangle * others * triangle.transpose());
  Index kept = n;
  double left_out = 0;
  while (kept > 1 && left_out + pairs.values[kept - 1] <= allowed) left_out += pairs.values[--kept];
  const MatrixXd basis = orthonormal * pairs.vectors.leftCols(kept);
  return {basis, basis.transpose() * factor, left_out};
}

/// More entries than this are not formed: the terms stay as they are.
constexpr double k_largest_core = 4e6;

}  // namespace

SeparatedTensor::SeparatedTensor(std::vector<MatrixXd> factors) : factors_(std::move(factors)) {
  if (factors_.empty()) throw UsageError("a separated tensor needs at least one factor");
  for (std::size_t i = 0; i < factors_.size(); ++i) {
    if (factors_[i].cols() != factors_.front().cols() || factors_[i].rows() == 0)
      throw UsageError(
          fmt::format("separated tensor: factor {} is {} × {}; it must have rows, and {} columns", i,
                      factors_[i].rows(), factors_[i].cols(), factors_.front().cols()));
    if (!factors_[i].allFinite())
      throw UsageError(fmt::format("separated tensor: factor {} has entries that are not finite", i));
  }
}

SeparatedTensor SeparatedTensor::zero(const std::vector<Index>& shape) {
  std::vector<MatrixXd> factors;
  for (const Index n : shape) factors.emplace_back(n, 0);
  return SeparatedTensor(std::move(factors));
}

std::vector<Index> SeparatedTensor::shape() const {
  std::vector<Index> result;
  for (const MatrixXd& factor : factors_) result.push_back(factor.rows());
  return result;
}

double SeparatedTensor::at(const std::vector<Index>& index) const {
  if (index.size() != order())
    throw UsageError(
        fmt::format("separated tensor: {} indices were given, its order is {}", index.size(), order()));
  Eigen::RowVectorXd product = Eigen::RowVectorXd::Ones(terms());
  for (std::size_t i = 0; i < order(); ++i) {
    if (index[i] < 0 || index[i] >= factors_[i].rows())
      throw UsageError(fmt::format("separated tensor: index {} is {}; it must be from 0 to {}", i, index[i],
                                   factors_[i].rows() - 1));
    product.array() *= factors_[i].row(index[i]).array();
  }
  return product.sum();
}

Eigen::VectorXd SeparatedTensor::dense() const {
  return entries(factors_);
}

SeparatedTensor& SeparatedTensor::operator+=(const SeparatedTensor& other) {
  require_same_shape(*this, other, "sum");
  for (std::size_t i = 0; i < order(); ++i) {
    MatrixXd joined(factors_[i].rows(), factors_[i].cols() + other.factors_[i].cols());
    joined << factors_[i], other.factors_[i];
    factors_[i] = std::move(joined);
  }
  return *this;
}

SeparatedTensor& SeparatedTensor::operator-=(const SeparatedTensor& other) {
  return *this += -1.0 * other;
}

SeparatedTensor& SeparatedTensor::operator*=(double factor) {
  if (!std::isfinite(factor)) throw UsageError(fmt::format("separated tensor: the factor is {}", factor));
  factors_.front() *= factor;
  return *this;
}

SeparatedTensor operator+(SeparatedTensor a, const SeparatedTensor& b) {
  return a += b;
}
SeparatedTensor operator-(SeparatedTensor a, const SeparatedTensor& b) {
  return a -= b;
}
SeparatedTensor operator*(double factor, SeparatedTensor a) {
  return a *= factor;
}

double inner_product(const SeparatedTensor& a, const SeparatedTensor& b) {
  require_same_shape(a, b, "inner product");
  return gram_product(a.factors(), b.factors(), k_none).sum();
}

double norm(const SeparatedTensor& a) {
  return std::sqrt(std::max(0.0, inner_product(a, a)));
}

SeparatedTensor hadamard_product(const SeparatedTensor& a, const SeparatedTensor& b) {
  require_same_shape(a, b, "product");
  std::vector<MatrixXd> factors;
  for (std::size_t i = 0; i < a.order(); ++i) {
    const MatrixXd &f = a.factors()[i], &g = b.factors()[i];
    MatrixXd product(f.rows(), f.cols() * g.cols());
    for (Index k = 0; k < f.cols(); ++k)
      product.middleCols(k * g.cols(), g.cols()) = f.col(k).asDiagonal() * g;
    factors.push_back(std::move(product));
  }
  return SeparatedTensor(std::move(factors));
}

SeparatedTensor apply(const SeparatedOperator& op, const SeparatedTensor& a) {
  if (op.terms.empty()) throw UsageError("a separated operator needs at least one term");
  const Index m = a.terms();
  std::vector<MatrixXd> factors(a.order());
  for (std::size_t i = 0; i < a.order(); ++i) {
    for (std::size_t k = 0; k < op.terms.size(); ++k) {
      if (op.terms[k].size() != a.order())
        throw UsageError(fmt::format("separated operator: term {} has {} matrices, the tensor's order is {}",
                                     k, op.terms[k].size(), a.order()));
      const MatrixXd& matrix = op.terms[k][i];
      if (matrix.cols() != a.factors()[i].rows() || matrix.rows() != op.terms[0][i].rows())
        throw UsageError(
            fmt::format("separated operator: matrix {} of term {} is {} × {}; it must be {} × {}", i, k,
                        matrix.rows(), matrix.cols(), op.terms[0][i].rows(), a.factors()[i].rows()));
      if (k == 0) factors[i].resize(matrix.rows(), m * static_cast<Index>(op.terms.size()));
      factors[i].middleCols(static_cast<Index>(k) * m, m) = matrix * a.factors()[i];
    }
  }
  return SeparatedTensor(std::move(factors));
}

SeparatedTensor SeparatedTensor::rounded(double tolerance, std::uint64_t seed) const {
  if (!(tolerance >= 0 && tolerance < 1))
    throw UsageError(
        fmt::format("separated tensor: the tolerance is {}; it must be from 0 to below 1", tolerance));
  const double square = inner_product(*this, *this);
  if (!(square > 0)) return zero(shape());
  if (order() == 1) return SeparatedTensor({factors_[0].rowwise().sum()});

  // Half of the allowed squared error is for the restriction, shared by the indices. Eigenvalues of Gram
  // matrices are good to rounding of ‖·‖²: below that everything is kept.
  const double allowed = tolerance * tolerance * square;
  const double share = 0.5 * allowed / static_cast<double>(order());
  std::vector<MatrixXd> bases, cores = factors_;
  double left_out = 0, core_size = 1;
  for (std::size_t i = 0; i < order(); ++i) {
    Restriction part =
        restrict(cores[i], gram_product(cores, cores, i), share > 1e-13 * square ? share : 0.0);
    bases.push_back(std::move(part.basis));
    cores[i] = std::move(part.reduced);
    left_out += part.left_out;
    core_size *= static_cast<double>(bases.back().cols());
  }
  if (core_size > k_largest_core) return *this;

  CoreTensor core;
  const Index first = cores[0].rows();
  const Eigen::VectorXd values = entries(cores);
  core.unfolded = values.reshaped(values.size() / first, first).transpose();
  for (std::size_t i = 1; i < order(); ++i) core.others.push_back(cores[i].rows());
  CpFactors cp;
  for (Index m = 1; m < terms(); ++m) {
    cp = als(core, with_one_more_mode(core, cp, seed + static_cast<std::uint64_t>(m)), 200);
    const double rest = (core.unfolded - unfolded(cp)).squaredNorm();
    if (left_out + rest > allowed) continue;
    std::vector<MatrixXd> factors;
    for (std::size_t i = 0; i < order(); ++i) factors.push_back(bases[i] * cp.factors[i]);
    return SeparatedTensor(std::move(factors));
  }
  return *this;
}

}  // namespace knothe::reduction
