#include "knothe/numerics/linear/incremental_svd.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/numerics/linear/dense_svd.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::numerics {
namespace {

/// rows × columns of exact rank `rank`, singular values from 1 down to 10^−4, plus noise of the size given.
Eigen::MatrixXd growing_matrix(Eigen::Index rows, Eigen::Index columns, Eigen::Index rank, double noise) {
  const Eigen::MatrixXd left = monte_carlo_normal_points(rows, rank, 1);
  const Eigen::MatrixXd right = monte_carlo_normal_points(columns, rank, 2);
  Eigen::VectorXd scale(rank);
  for (Eigen::Index k = 0; k < rank; ++k)
    scale[k] = std::pow(10.0, -4.0 * static_cast<double>(k) / static_cast<double>(rank - 1));
  Eigen::MatrixXd a = left * scale.asDiagonal() * right.transpose();
  if (noise > 0) a += noise * monte_carlo_normal_points(rows, columns, 3);
  return a;
}

IncrementalSvd appended(const Eigen::MatrixXd& a, Eigen::Index rank, Eigen::Index window) {
  IncrementalSvd svd(a.rows(), rank, window);
  for (Eigen::Index j = 0; j < a.cols(); ++j) svd.append(a.col(j));
  return svd;
}

TEST(IncrementalSvd, IsTheFullDecompositionWhileTheRankSuffices) {
  const Eigen::MatrixXd a = growing_matrix(60, 1000, 8, 0);
  const DenseSvd full = dense_svd(a);
  const IncrementalSvd svd = appended(a, 12, 1000);
  ASSERT_GE(svd.rank(), 8);
  const Eigen::VectorXd& exact = full.values;
  for (Eigen::Index k = 0; k < 8; ++k)
    EXPECT_NEAR(svd.singular_values()[k], exact[k], 1e-10 * exact[0]) << "singular value " << k;
  for (Eigen::Index k = 8; k < svd.rank(); ++k) EXPECT_LT(svd.singular_values()[k], 1e-10 * exact[0]);
  // sin of the largest angle between the two spans: the norm of what one does not hold of the other.
  const auto angle = [](const Eigen::MatrixXd& u, const Eigen::MatrixXd& v) {
    return (v - u * (u.transpose() * v)).norm();
  };
  EXPECT_LT(angle(svd.space().leftCols(8), full.left.leftCols(8)), 1e-8);
  EXPECT_LT(angle(svd.time().leftCols(8), full.right.leftCols(8)), 1e-8);
}

TEST(IncrementalSvd, SpaceModesStayOrthonormalOverAThousandColumns) {
  const IncrementalSvd svd = appended(growing_matrix(60, 1000, 8, 1e-3), 12, 10);
  const Eigen::MatrixXd gram = svd.space().transpose() * svd.space();
  EXPECT_LT((gram - Eigen::MatrixXd::Identity(12, 12)).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(IncrementalSvd, TruncatedItIsWithinTheDiscardedEnergy) {
  const Eigen::MatrixXd a = growing_matrix(60, 1000, 8, 0.05);
  const Eigen::VectorXd exact = singular_values(a);
  for (const Eigen::Index rank : {1, 2, 5, 20}) {
    const IncrementalSvd svd = appended(a, rank, 50);
    ASSERT_EQ(svd.rank(), rank);
    const double kept = svd.singular_values().squaredNorm();
    const double discarded = a.squaredNorm() - kept;
    for (Eigen::Index k = 0; k < rank; ++k) {
      const double lost = exact[k] * exact[k] - svd.singular_values()[k] * svd.singular_values()[k];
      EXPECT_GE(lost, -1e-10 * a.squaredNorm()) << "rank " << rank << " triplet " << k;
      EXPECT_LE(lost, discarded + 1e-10 * a.squaredNorm()) << "rank " << rank;
    }
    // The span holds as much of the matrix as the singular values say, and no less than what is kept.
    EXPECT_GE((svd.space().transpose() * a).squaredNorm(), kept - 1e-10 * a.squaredNorm());
  }
}

TEST(IncrementalSvd, TheLastRowsOfVAreThoseOfALongerWindow) {
  const Eigen::MatrixXd a = growing_matrix(20, 200, 5, 1e-3);
  const IncrementalSvd all = appended(a, 6, 200), last = appended(a, 6, 7);
  ASSERT_EQ(last.time().rows(), 7);
  EXPECT_EQ(Eigen::MatrixXd(all.space()), Eigen::MatrixXd(last.space()));
  EXPECT_LT((all.time().bottomRows(7) - last.time()).cwiseAbs().maxCoeff(), 1e-14);
  // And they are what makes the columns: a_j ≈ U diag(s) V_jᵀ.
  const Eigen::MatrixXd back = last.space() * last.singular_values().asDiagonal() * last.time().transpose();
  EXPECT_LT((back - a.rightCols(7)).norm(), 0.05 * a.rightCols(7).norm());
}

TEST(IncrementalSvd, ColumnsThatAreZeroOrRepeatedAreNoTrouble) {
  IncrementalSvd svd(4, 3, 5);
  svd.append(Eigen::Vector4d::Zero());
  EXPECT_EQ(svd.rank(), 0);
  const Eigen::Vector4d a(1, 2, 0, -1);
  for (int i = 0; i < 9; ++i) svd.append(a);
  ASSERT_EQ(svd.rank(), 1);
  EXPECT_NEAR(svd.singular_values()[0], 3 * a.norm(), 1e-13);
  EXPECT_EQ(svd.columns(), 10);
  svd.append(Eigen::Vector4d::Zero());
  EXPECT_EQ(svd.rank(), 1);
  EXPECT_NEAR(std::abs(svd.time()(4, 0)), 0, 1e-15);
}

}  // namespace
}  // namespace knothe::numerics
