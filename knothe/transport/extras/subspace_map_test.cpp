#include "knothe/transport/extras/subspace_map.hpp"

#include <gtest/gtest.h>

#include <Eigen/QR>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/sampling/testing/test_targets.hpp"
#include "knothe/transport/map/map_file.hpp"
#include "knothe/transport/map/pull_back.hpp"
#include "knothe/transport/testing/map_examples.hpp"

namespace knothe::transport {
namespace {

Eigen::MatrixXd orthonormal(Eigen::Index d, Eigen::Index r, std::uint64_t seed) {
  const Eigen::MatrixXd random = numerics::monte_carlo_normal_points(d, r, seed);
  return Eigen::HouseholderQR<Eigen::MatrixXd>(random).householderQ() * Eigen::MatrixXd::Identity(d, r);
}

ComposedMap four_parts() {
  ComposedMap map(4);
  map.append(examples::skew_affine_map(4));
  map.append(SubspaceMap(orthonormal(4, 2, 1), examples::bent_map(2, 3, 0.15, 2)));
  map.append(examples::bent_map(4, 2, 0.1, 3));
  map.append(SubspaceMap(orthonormal(4, 1, 4), examples::bent_map(1, 4, 0.1, 5)));
  return map;
}

TEST(SubspaceMap, IsTheIdentityAcrossAndTheMapAlong) {
  const Eigen::MatrixXd u = orthonormal(5, 2, 7);
  const TriangularMap tau = examples::bent_map(2, 3, 0.2, 8);
  const SubspaceMap map(u, tau);
  const Eigen::MatrixXd x = numerics::monte_carlo_normal_points(20, 5, 9);
  MapBatch batch;
  map.evaluate(x, 0, batch);
  EXPECT_LT((batch.value * u - tau.evaluate(x * u)).cwiseAbs().maxCoeff(), 1e-13);
  const Eigen::MatrixXd across = Eigen::MatrixXd::Identity(5, 5) - u * u.transpose();
  EXPECT_LT(((batch.value - x) * across).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_LT((batch.log_determinant - tau.log_determinant(x * u)).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_LT((map.inverse(batch.value) - x).cwiseAbs().maxCoeff(), 1e-10);
}

TEST(SubspaceMap, DerivativesOfACompositionAgainstDifferences) {
  const ComposedMap map = four_parts();
  const Eigen::MatrixXd x = numerics::monte_carlo_normal_points(6, 4, 11);
  MapBatch batch, up, down;
  map.evaluate(x, 2, batch);
  const double step = 1e-5;
  for (Eigen::Index a = 0; a < 4; ++a) {
    Eigen::MatrixXd shifted = x;
    shifted.col(a).array() += step;
    map.evaluate(shifted, 1, up);
    shifted.col(a).array() -= 2 * step;
    map.evaluate(shifted, 1, down);
    for (Eigen::Index i = 0; i < 4; ++i) {
      EXPECT_LT(((up.value.col(i) - down.value.col(i)) / (2 * step) - batch.jacobian.col(i * 4 + a))
                    .cwiseAbs()
                    .maxCoeff(),
                1e-6);
      for (Eigen::Index b = 0; b < 4; ++b)
        EXPECT_LT(((up.jacobian.col(i * 4 + b) - down.jacobian.col(i * 4 + b)) / (2 * step) -
                   batch.hessian.col(i * 10 + sampling::packed_index(a, b)))
                      .cwiseAbs()
                      .maxCoeff(),
                  1e-5);
    }
  }
  for (Eigen::Index p = 0; p < x.rows(); ++p) {  // log det, of the Jacobian as it stands
    Eigen::Matrix4d jacobian;
    for (Eigen::Index i = 0; i < 4; ++i)
      for (Eigen::Index j = 0; j < 4; ++j) jacobian(i, j) = batch.jacobian(p, i * 4 + j);
    EXPECT_NEAR(std::log(std::abs(jacobian.determinant())), batch.log_determinant[p], 1e-10);
  }
}

TEST(SubspaceMap, ACompositionIsInvertedAndItsGradientPulledBack) {
  const ComposedMap map = four_parts();
  const Eigen::MatrixXd x = numerics::monte_carlo_normal_points(30, 4, 12);
  EXPECT_LT((map.inverse(map.evaluate(x)) - x).cwiseAbs().maxCoeff(), 1e-9);
  Eigen::MatrixXd precision = Eigen::MatrixXd::Identity(4, 4);
  precision(1, 0) = precision(0, 1) = 0.3;
  sampling::targets::Gaussian target(Eigen::VectorXd::Constant(4, 0.5), precision);
  PullBackDensity pulled(map, target);
  EXPECT_EQ(pulled.available_derivatives(), 1);
  sampling::LogDensityBatch batch, up, down;
  batch.resize(30, 4, 1), up.resize(30, 4, 0), down.resize(30, 4, 0);
  pulled.evaluate(x, 1, batch);
  for (Eigen::Index a = 0; a < 4; ++a) {
    Eigen::MatrixXd shifted = x;
    shifted.col(a).array() += 1e-5;
    pulled.evaluate(shifted, 0, up);
    shifted.col(a).array() -= 2e-5;
    pulled.evaluate(shifted, 0, down);
    EXPECT_LT(((up.value - down.value) / 2e-5 - batch.gradient.col(a)).cwiseAbs().maxCoeff(), 1e-6);
  }
}

TEST(SubspaceMap, IsStoredAndDescribed) {
  const files::TestFolder folder;
  const ComposedMap map = four_parts();
  save_map(folder.file("lazy.h5"), map);
  const ComposedMap stored = load_map(folder.file("lazy.h5")).map;
  const Eigen::MatrixXd x = numerics::monte_carlo_normal_points(10, 4, 13);
  EXPECT_EQ(stored.evaluate(x), map.evaluate(x));
  EXPECT_NE(stored.describe().find("on a subspace of 2 of 4 dimensions"), std::string::npos);
}

TEST(SubspaceMap, SaysWhatIsWrongWithABasis) {
  const auto message = [](Eigen::MatrixXd basis, Eigen::Index r) {
    try {
      SubspaceMap map(std::move(basis), TriangularMap(r, 1));
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(message(orthonormal(4, 2, 1), 3).find("4 × 2 and a map in 3 variables"), std::string::npos);
  EXPECT_NE(message(2 * orthonormal(4, 2, 1), 2).find("not orthonormal"), std::string::npos);
  EXPECT_TRUE(message(orthonormal(4, 2, 1), 2).empty());
}

}  // namespace
}  // namespace knothe::transport
