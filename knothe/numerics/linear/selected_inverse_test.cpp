#include "knothe/numerics/linear/selected_inverse.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

#include "knothe/base/error.hpp"

namespace knothe::numerics {
namespace {

/// A diagonally dominant matrix on a grid graph with some long-range couplings.
Eigen::SparseMatrix<double> grid_matrix(int n) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<Eigen::Triplet<double>> entries;
  const auto couple = [&](int a, int b) {
    const double v = uniform(random);
    entries.emplace_back(a, b, v), entries.emplace_back(b, a, v);
  };
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      entries.emplace_back(j * n + i, j * n + i, 6 + uniform(random));
      if (i > 0) couple(j * n + i, j * n + i - 1);
      if (j > 0) couple(j * n + i, (j - 1) * n + i);
      if ((i + j) % 7 == 6) couple(j * n + i, (i * n + j) / 2);
    }
  Eigen::SparseMatrix<double> a(n * n, n * n);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

TEST(SelectedInverse, EqualsTheDenseInverseOnThePattern) {
  const auto a = grid_matrix(13);
  const Eigen::MatrixXd dense = Eigen::MatrixXd(a).inverse();
  const SelectedInverse selected(a);
  EXPECT_LT((selected.diagonal() - dense.diagonal()).cwiseAbs().maxCoeff(), 1e-14);
  for (const Eigen::Index j : {0, 41, 168})
    EXPECT_LT((selected.column(j) - dense.col(j)).cwiseAbs().maxCoeff(), 1e-14);
  for (int column = 0; column < a.outerSize(); ++column)
    for (Eigen::SparseMatrix<double>::InnerIterator it(a, column); it; ++it)
      EXPECT_NEAR(selected.entry(it.row(), it.col()), dense(it.row(), it.col()), 1e-14);
}

TEST(SelectedInverse, OfAFullMatrixIsItsInverse) {  // columns of one pattern, more than are taken at once
  const Eigen::MatrixXd half = Eigen::MatrixXd(grid_matrix(8)).cwiseAbs();
  const Eigen::MatrixXd full = half * half.transpose() + Eigen::MatrixXd::Ones(64, 64);
  const Eigen::MatrixXd dense = full.inverse();
  const SelectedInverse selected(full.sparseView());
  for (Eigen::Index i = 0; i < 64; ++i)
    for (Eigen::Index j = 0; j < 64; ++j)
      EXPECT_NEAR(selected.entry(i, j), dense(i, j), 1e-12 * dense.cwiseAbs().maxCoeff());
}

TEST(SelectedInverse, SaysWhatIsWrong) {
  Eigen::SparseMatrix<double> indefinite(2, 2);
  indefinite.insert(0, 0) = 1, indefinite.insert(1, 1) = -1;
  try {
    const SelectedInverse selected(indefinite);
    FAIL();
  } catch (const NumericalError& error) {
    EXPECT_STREQ(error.what(), "selected inverse: the matrix is not positive definite");
  }
  Eigen::SparseMatrix<double> diagonal(3, 3);
  diagonal.setIdentity();
  EXPECT_THROW((void)SelectedInverse(diagonal).entry(0, 2), UsageError);
}

}  // namespace
}  // namespace knothe::numerics
