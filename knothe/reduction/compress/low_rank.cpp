#include "knothe/reduction/compress/low_rank.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <random>

#include "knothe/base/threads.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"

namespace knothe::reduction {

namespace {

/// Rows or columns that one task multiplies; fixed, so that results do not depend on the number of threads.
constexpr Eigen::Index k_block = 512;

std::size_t block_count(Eigen::Index n) {
  return static_cast<std::size_t>((n + k_block - 1) / k_block);
}

/// A · B.
Eigen::MatrixXd product(const Eigen::Ref<const Eigen::MatrixXd>& a, const Eigen::MatrixXd& b,
                        std::size_t threads) {
  Eigen::MatrixXd result(a.rows(), b.cols());
  parallel_for(block_count(a.rows()), threads, [&](std::size_t i) {
    const Eigen::Index start = static_cast<Eigen::Index>(i) * k_block,
                       n = std::min(k_block, a.rows() - start);
    result.middleRows(start, n).noalias() = a.middleRows(start, n) * b;
  });
  return result;
}

/// Aᵀ · B.
Eigen::MatrixXd transposed_product(const Eigen::Ref<const Eigen::MatrixXd>& a, const Eigen::MatrixXd& b,
                                   std::size_t threads) {
  Eigen::MatrixXd result(a.cols(), b.cols());
  parallel_for(block_count(a.cols()), threads, [&](std::size_t i) {
    const Eigen::Index start = static_cast<Eigen::Index>(i) * k_block,
                       n = std::min(k_block, a.cols() - start);
    result.middleRows(start, n).noalias() = a.middleCols(start, n).transpose() * b;
  });
  return result;
}

/// Turns an orthonormal basis into singular vectors: the SVD of QᵀA by its small Gram matrix.
DominantSpace rotated(const Eigen::Ref<const Eigen::MatrixXd>& a, const Eigen::MatrixXd& q,
                      std::size_t threads) {
  const Eigen::MatrixXd projected = transposed_product(a, q, threads);  // (QᵀA)ᵀ
  const FallingEigenpairs pairs = falling_eigenpairs(projected.transpose() * projected);
  return {q * pairs.vectors, pairs.values, a.squaredNorm()};
}

}  // namespace

Eigen::MatrixXd orthonormal_basis(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  const Eigen::Index n = std::min(a.rows(), a.cols());
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(a);
  return qr.householderQ() * Eigen::MatrixXd::Identity(a.rows(), n);
}

Eigen::MatrixXd normal_matrix(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
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

Eigen::Index DominantSpace::rank_for(double allowed) const {
  // Summed from the small end: differences of the large numbers would drown it in rounding.
  double rest = std::max(0.0, total - energy.sum());
  if (rest <= 1e-15 * total) rest = 0.0;
  Eigen::Index l = energy.size();
  while (l > 0 && rest + energy[l - 1] <= allowed) rest += energy[--l];
  return l;
}

DominantSpace dominant_space(const Eigen::Ref<const Eigen::MatrixXd>& a, double allowed, std::uint64_t seed,
                             std::size_t threads) {
  constexpr Eigen::Index k_direct = 128;  // up to here all directions are kept, there is nothing to search
  const Eigen::Index most = std::min(a.rows(), a.cols());
  for (Eigen::Index columns = k_direct;; columns *= 2) {
    Eigen::MatrixXd q;
    if (columns >= most) {
      q = a.cols() <= a.rows() ? orthonormal_basis(a) : Eigen::MatrixXd::Identity(a.rows(), a.rows());
    } else {
      q = orthonormal_basis(product(a, normal_matrix(a.cols(), columns, seed), threads));
      q = orthonormal_basis(product(a, transposed_product(a, q, threads), threads));
    }
    DominantSpace space = rotated(a, q, threads);
    if (columns >= most || space.total - space.energy.sum() <= 0.25 * allowed) {
      const Eigen::Index l = std::max<Eigen::Index>(1, space.rank_for(allowed));
      space.basis.conservativeResize(Eigen::NoChange, l);
      space.energy.conservativeResize(l);
      return space;
    }
  }
}

}  // namespace knothe::reduction
