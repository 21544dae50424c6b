#include "knothe/model/compress/low_rank.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <random>

#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"

namespace knothe::model {

namespace {

/// Rows or columns that one task multiplies; fixed, so that results do not depend on the number of threads.
constexpr Index k_block = 512;

std::size_t block_count(Index n) {
  return (n + k_block - 1) / k_block;
}

class DenseMatrix final : public LargeMatrix {
 public:
  DenseMatrix(const Eigen::Ref<const Eigen::MatrixXd>& matrix, std::size_t threads)
      : matrix_(matrix), threads_(threads) {}
  [[nodiscard]] Index rows() const override { return matrix_.rows(); }
  [[nodiscard]] Index cols() const override { return matrix_.cols(); }
  [[nodiscard]] Eigen::MatrixXd times(const Eigen::MatrixXd& b) const override {
    Eigen::MatrixXd result(matrix_.rows(), b.cols());
    parallel_for(block_count(matrix_.rows()), threads_, [&](std::size_t i) {
      const Index start = i * k_block, n = std::min(k_block, matrix_.rows() - start);
      result.middleRows(start, n).noalias() = matrix_.middleRows(start, n) * b;
    });
    return result;
  }
  [[nodiscard]] Eigen::MatrixXd transposed_times(const Eigen::MatrixXd& b) const override {
    Eigen::MatrixXd result(matrix_.cols(), b.cols());
    parallel_for(block_count(matrix_.cols()), threads_, [&](std::size_t i) {
      const Index start = i * k_block, n = std::min(k_block, matrix_.cols() - start);
      result.middleRows(start, n).noalias() = matrix_.middleCols(start, n).transpose() * b;
    });
    return result;
  }
  [[nodiscard]] Eigen::MatrixXd gram() const override {
    const Eigen::MatrixXd transposed = matrix_.transpose();
    return transposed.transpose() * transposed;
  }
  [[nodiscard]] double squared_norm() const override { return matrix_.squaredNorm(); }

 private:
  const Eigen::Ref<const Eigen::MatrixXd>& matrix_;
  std::size_t threads_;
};

/// The singular vectors in the span of Q (orthonormal), by the small Gram matrix of `projected` = AᵀQ.
DominantSpace rotated(const Eigen::MatrixXd& q, const Eigen::MatrixXd& projected, double total) {
  const FallingEigenpairs pairs = falling_eigenpairs(projected.transpose() * projected);
  // A difference below the rounding of the large numbers is none.
  double rest = std::max(0.0, total - pairs.values.sum());
  if (rest <= 1e-15 * total) rest = 0.0;
  return {q * pairs.vectors, pairs.values, total, rest};
}

/// All directions.
DominantSpace whole_space(const LargeMatrix& a, double total) {
  if (a.cols() <= a.rows()) {
    const Eigen::MatrixXd q = orthonormal_basis(a.times(Eigen::MatrixXd::Identity(a.cols(), a.cols())));
    return rotated(q, a.transposed_times(q), total);
  }
  FallingEigenpairs pairs = falling_eigenpairs(a.gram());
  return {std::move(pairs.vectors), std::move(pairs.values), total, 0.0};
}

/// Smallest number of columns that `search` is content with.
Index columns_for(const DominantSpace& space, const SpaceSearch& search) {
  return std::max<Index>({1, space.rank_for(search.allowed), std::min(search.at_least, space.energy.size())});
}

/// The best of `columns` random directions.
DominantSpace searched_space(const LargeMatrix& a, Index columns, double total, const SpaceSearch& search) {
  constexpr int k_max_iterations = 20;
  Eigen::MatrixXd q = orthonormal_basis(a.times(normal_matrix(a.cols(), columns, search.seed)));
  Eigen::MatrixXd projected = a.transposed_times(q);
  DominantSpace space = rotated(q, projected, total);
  for (int i = 0; i < k_max_iterations; ++i) {
    q = orthonormal_basis(a.times(projected));
    projected = a.transposed_times(q);
    const Index l = columns_for(space, search);
    const double before = space.energy.head(l).sum();
    space = rotated(q, projected, total);
    const double gained = space.energy.head(l).sum() - before;
    if (!search.converge || gained <= 1e-6 * space.rest_from(l) || gained <= 1e-15 * total) break;
  }
  return space;
}

}  // namespace

Eigen::MatrixXd orthonormal_basis(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  const Index n = std::min(a.rows(), a.cols());
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(a);
  return qr.householderQ() * Eigen::MatrixXd::Identity(a.rows(), n);
}

Eigen::MatrixXd normal_matrix(Index rows, Index columns, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd result(rows, columns);
  for (double& entry : result.reshaped()) entry = normal(random);
  return result;
}

FallingEigenpairs falling_eigenpairs(const Eigen::Ref<const Eigen::MatrixXd>& gram) {
  const numerics::SymmetricEigen solver(gram);
  return {solver.eigenvalues().reverse().cwiseMax(0.0), solver.eigenvectors().rowwise().reverse()};
}

Index DominantSpace::rank_for(double allowed) const {
  // Summed from the small end: differences of the large numbers would drown it in rounding.
  double sum = rest;
  Index l = energy.size();
  while (l > 0 && sum + energy[l - 1] <= allowed) sum += energy[--l];
  return l;
}

DominantSpace dominant_space(const LargeMatrix& a, const SpaceSearch& search) {
  constexpr Index k_direct = 128;  // up to here all directions are kept, there is nothing to search
  const Index most = std::min(a.rows(), a.cols());
  const double total = a.squared_norm();
  Index columns = k_direct;
  while (columns < 2 * search.at_least) columns *= 2;
  for (;; columns *= 2) {
    DominantSpace space = columns >= most ? whole_space(a, total) : searched_space(a, columns, total, search);
    if (columns < most && space.rest > 0.25 * search.allowed) continue;
    const Index l = columns_for(space, search);
    space.rest = space.rest_from(l);
    space.basis.conservativeResize(Eigen::NoChange, l);
    space.energy.conservativeResize(l);
    return space;
  }
}

DominantSpace dominant_space(const Eigen::Ref<const Eigen::MatrixXd>& a, double allowed, std::uint64_t seed,
                             std::size_t threads) {
  return dominant_space(DenseMatrix(a, threads), {.allowed = allowed, .seed = seed});
}

}  // namespace knothe::model
