#include "knothe/offline/full_order/sparse_solvers.hpp"

#include <cholmod.h>
#include <umfpack.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>

#include "knothe/base/error.hpp"

namespace knothe::offline {

std::size_t SparseMatrix::position(int row, int wanted) const {
  const auto begin = column.begin() + row_start[row], end = column.begin() + row_start[row + 1];
  const auto found = std::lower_bound(begin, end, wanted);
  assert(found != end && *found == wanted);
  return found - column.begin();
}

void SparseMatrix::multiply(std::span<const double> x, std::span<double> out) const {
  for (int row = 0; row < rows(); ++row) {
    double sum = 0;
    for (int k = row_start[row]; k < row_start[row + 1]; ++k) sum += value[k] * x[column[k]];
    out[row] = sum;
  }
}

SparseMatrix coupling_pattern(int rows, std::span<const int> lists, int width) {
  std::vector<std::vector<int>> columns(rows);
  for (std::size_t begin = 0; begin < lists.size(); begin += width)
    for (int i = 0; i < width; ++i) {
      if (lists[begin + i] < 0) continue;
      for (int j = 0; j < width; ++j)
        if (lists[begin + j] >= 0) columns[lists[begin + i]].push_back(lists[begin + j]);
    }
  SparseMatrix matrix;
  matrix.row_start.push_back(0);
  for (auto& row : columns) {
    std::sort(row.begin(), row.end());
    row.erase(std::unique(row.begin(), row.end()), row.end());
    matrix.column.insert(matrix.column.end(), row.begin(), row.end());
    matrix.row_start.push_back(matrix.column.size());
  }
  matrix.value.assign(matrix.column.size(), 0.0);
  return matrix;
}

struct SymmetricFactor::Implementation {
  cholmod_common common{};
  cholmod_factor* factor = nullptr;
  std::size_t size = 0;

  Implementation() {
    cholmod_start(&common);
    common.print = 0;
    common.supernodal = CHOLMOD_SUPERNODAL;
  }
  ~Implementation() {
    cholmod_free_factor(&factor, &common);
    cholmod_finish(&common);
  }
};

SymmetricFactor::SymmetricFactor(const SparseMatrix& matrix)
    : implementation_(std::make_unique<Implementation>()) {
  auto& [common, factor, size] = *implementation_;
  size = matrix.rows();
  // Rows of the lower triangle are columns of the upper one: CHOLMOD is told "upper" and ignores what is
  // below.
  std::vector<int> row_start = matrix.row_start, column = matrix.column;
  std::vector<double> value = matrix.value;
  cholmod_sparse sparse{};
  sparse.nrow = sparse.ncol = size;
  sparse.nzmax = value.size();
  sparse.p = row_start.data();
  sparse.i = column.data();
  sparse.x = value.data();
  sparse.stype = 1;
  sparse.itype = CHOLMOD_INT;
  sparse.xtype = CHOLMOD_REAL;
  sparse.dtype = CHOLMOD_DOUBLE;
  sparse.sorted = 1;
  sparse.packed = 1;
  factor = cholmod_analyze(&sparse, &common);
  if (factor != nullptr) cholmod_factorize(&sparse, factor, &common);
  if (common.status == CHOLMOD_OUT_OF_MEMORY)
    throw NumericalError(
        "not enough memory to factorise the stiffness matrix; use larger elements or fewer layers");
  // A rigid motion that nothing holds leaves a pivot of rounding errors, of either sign; the least relative
  // pivot of a body that is held is some 0.05.
  constexpr double k_min_pivot = 1e-12;
  if (factor == nullptr || common.status != CHOLMOD_OK || cholmod_rcond(factor, &common) < k_min_pivot)
    throw NumericalError(
        "the elastic stiffness matrix is not positive definite: some part of the body can move freely; check "
        "that the supports hold it, that the mesh is in one piece, and that no support_stiffness is beyond "
        "1e15 N/m (0 holds rigidly)");
}

SymmetricFactor::~SymmetricFactor() = default;
SymmetricFactor::SymmetricFactor(SymmetricFactor&&) noexcept = default;
SymmetricFactor& SymmetricFactor::operator=(SymmetricFactor&&) noexcept = default;

void SymmetricFactor::solve(std::span<double> values, int columns) const {
  auto& [common, factor, size] = *implementation_;
  assert(values.size() == size * columns);
  cholmod_dense right{};
  right.nrow = size;
  right.ncol = columns;
  right.nzmax = values.size();
  right.d = size;
  right.x = values.data();
  right.xtype = CHOLMOD_REAL;
  right.dtype = CHOLMOD_DOUBLE;
  cholmod_dense* solution = cholmod_solve(CHOLMOD_A, factor, &right, &common);
  if (solution == nullptr) throw NumericalError("not enough memory to solve with the stiffness matrix");
  std::memcpy(values.data(), solution->x, values.size_bytes());
  cholmod_free_dense(&solution, &common);
}

struct UnsymmetricSolver::Implementation {
  void* symbolic = nullptr;
  double control[UMFPACK_CONTROL];

  ~Implementation() {
    if (symbolic != nullptr) umfpack_di_free_symbolic(&symbolic);
  }
};

UnsymmetricSolver::UnsymmetricSolver(const SparseMatrix& matrix)
    : implementation_(std::make_unique<Implementation>()) {
  umfpack_di_defaults(implementation_->control);
  // Rows given as columns: UMFPACK factorises the transpose, and solves with it transposed.
  const int status =
      umfpack_di_symbolic(matrix.rows(), matrix.rows(), matrix.row_start.data(), matrix.column.data(),
                          matrix.value.data(), &implementation_->symbolic, implementation_->control, nullptr);
  if (status != UMFPACK_OK)
    throw NumericalError("UMFPACK cannot analyse the tangent matrix (out of memory?)");
}

UnsymmetricSolver::~UnsymmetricSolver() = default;
UnsymmetricSolver::UnsymmetricSolver(UnsymmetricSolver&&) noexcept = default;
UnsymmetricSolver& UnsymmetricSolver::operator=(UnsymmetricSolver&&) noexcept = default;

bool UnsymmetricSolver::solve(const SparseMatrix& matrix, std::span<const double> b, std::span<double> x) {
  void* numeric = nullptr;
  int status = umfpack_di_numeric(matrix.row_start.data(), matrix.column.data(), matrix.value.data(),
                                  implementation_->symbolic, &numeric, implementation_->control, nullptr);
  if (status == UMFPACK_OK)
    status = umfpack_di_solve(UMFPACK_At, matrix.row_start.data(), matrix.column.data(), matrix.value.data(),
                              x.data(), b.data(), numeric, implementation_->control, nullptr);
  if (numeric != nullptr) umfpack_di_free_numeric(&numeric);
  return status == UMFPACK_OK &&
         std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); });
}

}  // namespace knothe::offline
