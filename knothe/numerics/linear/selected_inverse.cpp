#include "knothe/numerics/linear/selected_inverse.hpp"

#include <fmt/format.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::numerics {
namespace {

using Sparse = Eigen::SparseMatrix<double>;

constexpr int k_widest = 48;  ///< columns taken at once

struct Workspace {
  explicit Workspace(int n) : place(n, -1) {}
  std::vector<int> place;  ///< of a row among those below the columns at hand
  Eigen::MatrixXd corner, below, inverse, of_rows, found;
};

/// Whether column c has the pattern of column c + 1, and its own diagonal.
bool continues(const Sparse& lower, int c) {
  const int *begin = lower.outerIndexPtr(), *row = lower.innerIndexPtr();
  return begin[c + 2] - begin[c + 1] + 1 == begin[c + 1] - begin[c] && row[begin[c] + 1] == c + 1;
}

/// Z = (L Lᵀ)⁻¹ in the columns `start` … `end` − 1, which have one pattern, on the pattern of L; all later
/// columns are known. With L₁₁ of these columns, L₂₁ of the rows below, Y = L₂₁ L₁₁⁻¹ (Takahashi's
/// recurrence, by blocks): Z₂₁ = −Z₂₂ Y, Z₁₁ = L₁₁⁻ᵀ L₁₁⁻¹ − Yᵀ Z₂₁.
void invert_block(const Sparse& lower, int start, int end, double* z, Workspace& work) {
  const int *begin = lower.outerIndexPtr(), *row = lower.innerIndexPtr();
  const double* l = lower.valuePtr();
  const int w = end - start;
  const int* const rows = row + begin[end - 1] + 1;  // the last column's, below its diagonal
  const int m = begin[end] - begin[end - 1] - 1;
  work.corner.setZero(w, w);
  work.below.resize(m, w);
  for (int c = 0; c < w; ++c) {
    const double* column = l + begin[start + c];
    for (int i = c; i < w; ++i) work.corner(i, c) = *column++;
    std::copy_n(column, m, work.below.col(c).data());
  }
  work.inverse.setIdentity(w, w);
  work.corner.triangularView<Eigen::Lower>().solveInPlace(work.inverse);
  work.found.noalias() = work.inverse.transpose() * work.inverse;
  if (m > 0) {
    // Z₂₂: every entry (i, k), i ≥ k, is in column k, as the factor's pattern is closed.
    for (int a = 0; a < m; ++a) work.place[rows[a]] = a;
    work.of_rows.resize(m, m);
    for (int a = 0; a < m; ++a) {
      const int k = rows[a];
      double* const column = work.of_rows.col(a).data();
      for (int q = begin[k]; q < begin[k + 1]; ++q) {
        const int b = work.place[row[q]];
        if (b >= 0) column[b] = z[q];
      }
    }
    for (int a = 0; a < m; ++a) work.place[rows[a]] = -1;
    const Eigen::MatrixXd moved = work.below * work.inverse;
    work.below.noalias() = -(work.of_rows.selfadjointView<Eigen::Lower>() * moved);
    work.found.noalias() -= moved.transpose() * work.below;
  }
  for (int c = 0; c < w; ++c) {
    double* column = z + begin[start + c];
    for (int i = c; i < w; ++i) *column++ = work.found(i, c);
    std::copy_n(work.below.col(c).data(), m, column);
  }
}

}  // namespace

SelectedInverse::SelectedInverse(const Eigen::SparseMatrix<double>& matrix) {
  const Eigen::SimplicialLLT<Sparse> factor(matrix);
  if (factor.info() != Eigen::Success)
    throw NumericalError("selected inverse: the matrix is not positive definite");
  Sparse lower = factor.matrixL();
  lower.makeCompressed();
  const int n = lower.cols();
  inverse_ = lower;  // the same pattern
  double* z = inverse_.valuePtr();
  const int* begin = lower.outerIndexPtr();
  Workspace work(n);
  for (int end = n; end > 0;) {
    int start = end - 1;
    while (start > 0 && end - start < k_widest && continues(lower, start - 1)) --start;
    invert_block(lower, start, end, z, work);
    end = start;
  }
  position_ = factor.permutationP().size() > 0 ? Eigen::VectorXi(factor.permutationP().indices())
                                               : Eigen::VectorXi(Eigen::VectorXi::LinSpaced(n, 0, n - 1));
  diagonal_.resize(n);
  for (int i = 0; i < n; ++i) diagonal_[i] = z[begin[position_[i]]];
  lower_ = std::move(lower);
}

Eigen::VectorXd SelectedInverse::column(Index j) const {
  const Index n = lower_.cols();
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
  const int *begin = lower_.outerIndexPtr(), *row = lower_.innerIndexPtr();
  const double* l = lower_.valuePtr();
  // L y = e, nothing before its place; then Lᵀ x = y.
  x[position_[j]] = 1;
  for (Index c = position_[j]; c < n; ++c) {
    if (x[c] == 0) continue;
    const double y = x[c] /= l[begin[c]];
    for (int p = begin[c] + 1; p < begin[c + 1]; ++p) x[row[p]] -= l[p] * y;
  }
  for (Index c = n; c-- > 0;) {
    double sum = x[c];
    for (int p = begin[c] + 1; p < begin[c + 1]; ++p) sum -= l[p] * x[row[p]];
    x[c] = sum / l[begin[c]];
  }
  Eigen::VectorXd result(n);
  for (Index i = 0; i < n; ++i) result[i] = x[position_[i]];
  return result;
}

double SelectedInverse::entry(Index i, Index j) const {
  const int a = std::max(position_[i], position_[j]), b = std::min(position_[i], position_[j]);
  const int *begin = inverse_.outerIndexPtr(), *row = inverse_.innerIndexPtr();
  const int* found = std::lower_bound(row + begin[b], row + begin[b + 1], a);
  if (found == row + begin[b + 1] || *found != a)
    throw UsageError(
        fmt::format("selected inverse: entry ({}, {}) is not on the pattern of the factor", i, j));
  return inverse_.valuePtr()[found - row];
}

}  // namespace knothe::numerics
