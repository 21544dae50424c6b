#include "knothe/imaging/series/camera_drift.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "knothe/base/error.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {
namespace {

/// Nodes of a mesh as observations, and what a picture says of them.
struct Scene {
  std::vector<double> points;
  std::vector<std::int64_t> component;
  Eigen::SparseMatrix<double> precision;
  Scene() {
    const SpecklePattern pattern({.width = 130, .height = 110});
    ImageCorrelation correlation(pattern.render(), structured_mesh({20, 20, 109, 89}, 20));
    for (int a = 0; a < correlation.mesh().node_count(); ++a)
      for (const std::int64_t c : {0, 1}) {
        const auto i = static_cast<std::size_t>(a);
        points.insert(points.end(), {correlation.mesh().x[i], correlation.mesh().y[i], 0});
        component.push_back(c);
      }
    precision = correlation.precision(std::vector<char>(correlation.mesh().elements.size(), 1), 2);
  }
};

TEST(CameraDrift, TheMarginalIsTheDenseFormulaAndKnowsNothingOfRigidMotions) {
  Scene scene;
  const Eigen::Index n = scene.precision.rows();
  const double std = 3;
  for (const Drift drift : {Drift::shift, Drift::rigid}) {
    const Eigen::Index modes = drift_modes(drift);
    const Eigen::MatrixXd joint = with_drift(scene.precision, drift, scene.points, scene.component, std);
    ASSERT_EQ(joint.rows(), n + modes);
    const Eigen::MatrixXd marginal =
        joint.topLeftCorner(n, n) - joint.topRightCorner(n, modes) *
                                        joint.bottomRightCorner(modes, modes).inverse() *
                                        joint.bottomLeftCorner(modes, n);
    // Independent: covariance of d = e + B a with B written out here.
    Eigen::MatrixXd b = Eigen::MatrixXd::Zero(n, 3);
    double x = 0, y = 0, squares = 0;
    for (Eigen::Index i = 0; i < n; ++i)
      x += scene.points[3 * static_cast<std::size_t>(i)] / static_cast<double>(n),
          y += scene.points[3 * static_cast<std::size_t>(i) + 1] / static_cast<double>(n);
    for (Eigen::Index i = 0; i < n; i += 2) {
      const double dx = scene.points[3 * static_cast<std::size_t>(i)] - x,
                   dy = scene.points[3 * static_cast<std::size_t>(i) + 1] - y;
      b(i, 0) = b(i + 1, 1) = 1, b(i, 2) = -dy, b(i + 1, 2) = dx;
      squares += 2 * (dx * dx + dy * dy);
    }
    b.col(2) /= std::sqrt(squares / static_cast<double>(n));
    const Eigen::MatrixXd used = b.leftCols(modes);
    const Eigen::MatrixXd covariance =
        Eigen::MatrixXd(scene.precision).inverse() + std * std * used * used.transpose();
    EXPECT_LT((marginal * covariance - Eigen::MatrixXd::Identity(n, n)).norm(), 1e-6);
    // What a shift of 0.1 px weighs: almost nothing, where it weighed much.
    const Eigen::VectorXd shifted = 0.1 * b.col(0);
    EXPECT_GT(shifted.dot(scene.precision * shifted), 100);
    EXPECT_LT(shifted.dot(marginal * shifted), 0.01);
  }
}

TEST(CameraDrift, UnmeasuredNodesStayUnmeasuredAndMotionsGetPlaces) {
  Scene scene;
  Eigen::SparseMatrix<double> part = scene.precision;
  part.prune([](Eigen::Index i, Eigen::Index j, double) { return i > 3 && j > 3; });
  const auto joint = with_drift(part, Drift::rigid, scene.points, scene.component, 10);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(joint.col(i).nonZeros(), 0);
  const std::size_t before = scene.component.size();
  add_drift_places(Drift::rigid, scene.points, scene.component);
  EXPECT_EQ(scene.component.size(), before + 3);
  EXPECT_EQ(scene.points.size(), 3 * (before + 3));
  EXPECT_EQ(Eigen::MatrixXd(with_drift(scene.precision, Drift::none, scene.points, scene.component, 1)),
            Eigen::MatrixXd(scene.precision));
  EXPECT_THROW((void)with_drift(scene.precision, Drift::shift, scene.points, scene.component, 0), UsageError);
}

}  // namespace
}  // namespace knothe::imaging
