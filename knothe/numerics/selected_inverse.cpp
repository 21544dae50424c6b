#include "knothe/numerics/selected_inverse.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::numerics {

SelectedInverse::SelectedInverse(const Eigen::SparseMatrix<double>& matrix) {
  const Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> factor(matrix);
  if (factor.info() != Eigen::Success)
    throw NumericalError("selected inverse: the matrix is not positive definite");
  Eigen::SparseMatrix<double> lower = factor.matrixL();
  lower.makeCompressed();
  const auto n = static_cast<int>(lower.cols());
  inverse_ = lower;  // the same pattern
  double* z = inverse_.valuePtr();
  const int *begin = lower.outerIndexPtr(), *row = lower.innerIndexPtr();
  const double* l = lower.valuePtr();
  std::vector<double> sum;
  std::vector<int> place(static_cast<std::size_t>(n), -1);  // of a row in the column at hand
  for (int j = n; j-- > 0;) {
    const int first = begin[j], end = begin[j + 1];  // the diagonal comes first
    const double pivot = l[first];
    const auto count = static_cast<std::size_t>(end - first - 1);
    sum.assign(count, 0.0);
    for (int p = first + 1; p < end; ++p) place[static_cast<std::size_t>(row[p])] = p - first - 1;
    // Σ_k Z_ik L_kj for i, k both in column j: every such Z_ik with i ≥ k is in column k, as the factor's
    // pattern is closed.
    for (int p = first + 1; p < end; ++p) {
      const int k = row[p];
      const auto at = static_cast<std::size_t>(p - first - 1);
      sum[at] += z[begin[k]] * l[p];
      for (int q = begin[k] + 1; q < begin[k + 1]; ++q) {
        const int i = place[static_cast<std::size_t>(row[q])];
        if (i < 0) continue;
        sum[static_cast<std::size_t>(i)] += z[q] * l[p];
        sum[at] += z[q] * l[first + 1 + i];
      }
    }
    double diagonal = 1 / (pivot * pivot);
    for (int p = first + 1; p < end; ++p) {
      const double value = -sum[static_cast<std::size_t>(p - first - 1)] / pivot;
      z[p] = value;
      diagonal -= l[p] * value / pivot;
      place[static_cast<std::size_t>(row[p])] = -1;
    }
    z[first] = diagonal;
  }
  position_ = factor.permutationP().size() > 0 ? Eigen::VectorXi(factor.permutationP().indices())
                                               : Eigen::VectorXi(Eigen::VectorXi::LinSpaced(n, 0, n - 1));
  diagonal_.resize(n);
  for (int i = 0; i < n; ++i) diagonal_[i] = z[begin[position_[i]]];
  lower_ = std::move(lower);
}

Eigen::VectorXd SelectedInverse::column(Eigen::Index j) const {
  const Eigen::Index n = lower_.cols();
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
  const int *begin = lower_.outerIndexPtr(), *row = lower_.innerIndexPtr();
  const double* l = lower_.valuePtr();
  // L y = e, nothing before its place; then Lᵀ x = y.
  x[position_[j]] = 1;
  for (Eigen::Index c = position_[j]; c < n; ++c) {
    if (x[c] == 0) continue;
    const double y = x[c] /= l[begin[c]];
    for (int p = begin[c] + 1; p < begin[c + 1]; ++p) x[row[p]] -= l[p] * y;
  }
  for (Eigen::Index c = n; c-- > 0;) {
    double sum = x[c];
    for (int p = begin[c] + 1; p < begin[c + 1]; ++p) sum -= l[p] * x[row[p]];
    x[c] = sum / l[begin[c]];
  }
  Eigen::VectorXd result(n);
  for (Eigen::Index i = 0; i < n; ++i) result[i] = x[position_[i]];
  return result;
}

double SelectedInverse::entry(Eigen::Index i, Eigen::Index j) const {
  const int a = std::max(position_[i], position_[j]), b = std::min(position_[i], position_[j]);
  const int *begin = inverse_.outerIndexPtr(), *row = inverse_.innerIndexPtr();
  const int* found = std::lower_bound(row + begin[b], row + begin[b + 1], a);
  if (found == row + begin[b + 1] || *found != a)
    throw UsageError(
        fmt::format("selected inverse: entry ({}, {}) is not on the pattern of the factor", i, j));
  return inverse_.valuePtr()[found - row];
}

}  // namespace knothe::numerics
