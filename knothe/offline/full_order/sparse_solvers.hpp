#pragma once
/// @file Sparse matrices and their direct solvers: CHOLMOD (symmetric), UMFPACK (unsymmetric).
#include <memory>
#include <span>
#include <vector>

namespace knothe::offline {

/// Compressed rows; columns ascending within a row.
struct SparseMatrix {
  std::vector<int> row_start;  ///< n + 1
  std::vector<int> column;
  std::vector<double> value;

  [[nodiscard]] int rows() const { return row_start.size() - 1; }
  /// Place of entry (row, column) in `value`; it must be in the pattern.
  [[nodiscard]] std::size_t position(int row, int column) const;
  /// out = A x.
  void multiply(std::span<const double> x, std::span<double> out) const;
};

/// Pattern of a matrix that couples the indices of each list (`lists` holds them one after the other, `width`
/// each; negative ones are left out). Values are 0.
[[nodiscard]] SparseMatrix coupling_pattern(int rows, std::span<const int> lists, int width);

/// Cholesky factor of a symmetric positive definite matrix.
class SymmetricFactor {
 public:
  /// Uses the lower triangle of `matrix`. Throws NumericalError if it is not positive definite: the body can
  /// move as a rigid one (supports missing).
  explicit SymmetricFactor(const SparseMatrix& matrix);
  ~SymmetricFactor();
  SymmetricFactor(SymmetricFactor&&) noexcept;
  SymmetricFactor& operator=(SymmetricFactor&&) noexcept;

  /// Solves for `columns` right-hand sides at once, in place; column-major n × columns.
  void solve(std::span<double> values, int columns = 1) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// LU of an unsymmetric matrix whose pattern stays the same: the symbolic analysis is made once.
class UnsymmetricSolver {
 public:
  explicit UnsymmetricSolver(const SparseMatrix& matrix);
  ~UnsymmetricSolver();
  UnsymmetricSolver(UnsymmetricSolver&&) noexcept;
  UnsymmetricSolver& operator=(UnsymmetricSolver&&) noexcept;

  /// Factorises `matrix` (of the same pattern) and solves A x = b. False if it is singular.
  [[nodiscard]] bool solve(const SparseMatrix& matrix, std::span<const double> b, std::span<double> x);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace knothe::offline
