#include "knothe/offline/full_order/dense_solvers.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <mutex>

extern "C" {
void dgetrf_(const int* m, const int* n, double* a, const int* lda, int* pivots, int* info);
void dgetrs_(const char* trans, const int* n, const int* columns, const double* a, const int* lda,
             const int* pivots, double* b, const int* ldb, int* info);
void dpotrf_(const char* uplo, const int* n, double* a, const int* lda, int* info);
void dpotri_(const char* uplo, const int* n, double* a, const int* lda, int* info);
void dpotrs_(const char* uplo, const int* n, const int* columns, const double* a, const int* lda, double* b,
             const int* ldb, int* info);
void dgemv_(const char* trans, const int* m, const int* n, const double* alpha, const double* a,
            const int* lda, const double* x, const int* incx, const double* beta, double* y, const int* incy);
}

namespace knothe::offline {

namespace {

/// Debian's serial OpenBLAS hands out its work buffers without a lock: two threads in it at a time get wrong
/// numbers, now and then.
[[nodiscard]] std::unique_lock<std::mutex> one_at_a_time() {
  static std::mutex mutex;
  return std::unique_lock(mutex);
}

}  // namespace

bool solve_dense(std::span<double> matrix, std::span<double> right_hand_side) {
  const int n = right_hand_side.size(), one = 1;
  assert(matrix.size() == right_hand_side.size() * right_hand_side.size());
  if (n == 0) return true;
  std::vector<int> pivots(n);
  int info = 0;
  const auto lock = one_at_a_time();
  dgetrf_(&n, &n, matrix.data(), &n, pivots.data(), &info);
  if (info != 0) return false;
  dgetrs_("N", &n, &one, matrix.data(), &n, pivots.data(), right_hand_side.data(), &n, &info);
  return info == 0 && std::all_of(right_hand_side.begin(), right_hand_side.end(),
                                  [](double value) { return std::isfinite(value); });
}

bool invert_positive_definite(std::span<double> matrix, int n) {
  if (n == 0) return true;
  int info = 0;
  const auto lock = one_at_a_time();
  dpotrf_("L", &n, matrix.data(), &n, &info);
  if (info != 0) return false;
  dpotri_("L", &n, matrix.data(), &n, &info);
  for (int j = 0; j < n; ++j)
    for (int i = j + 1; i < n; ++i)
      matrix[static_cast<std::size_t>(i) * n + j] = matrix[static_cast<std::size_t>(j) * n + i];
  return info == 0;
}

void multiply_symmetric(std::span<const double> matrix, std::span<const double> x, std::span<double> out) {
  const int n = x.size(), one = 1;
  if (n == 0) return;
  const double alpha = 1, beta = 0;
  const auto lock = one_at_a_time();
  dgemv_("T", &n, &n, &alpha, matrix.data(), &n, x.data(), &one, &beta, out.data(), &one);
}

bool solve_positive_definite(std::span<double> matrix, int n, std::span<double> right_hand_sides,
                             int columns) {
  if (n == 0) return true;
  int info = 0;
  const auto lock = one_at_a_time();
  dpotrf_("L", &n, matrix.data(), &n, &info);
  if (info != 0) return false;
  dpotrs_("L", &n, &columns, matrix.data(), &n, right_hand_sides.data(), &n, &info);
  return info == 0;
}

}  // namespace knothe::offline
