#include "knothe/posterior/draws/support_ends.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior {
namespace {

/// 0 where a point is inside, else −∞.
class Flat final : public LogDensity {
 public:
  Flat(Eigen::Index d, std::function<bool(const Eigen::RowVectorXd&)> inside)
      : d_(d), inside_(std::move(inside)) {}
  [[nodiscard]] Eigen::Index dimension() const override { return d_; }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int, LogDensityBatch& out) override {
    for (Eigen::Index i = 0; i < points.rows(); ++i)
      out.value[i] = inside_(points.row(i)) ? 0 : -std::numeric_limits<double>::infinity();
  }

 private:
  Eigen::Index d_;
  std::function<bool(const Eigen::RowVectorXd&)> inside_;
};

SupportEnds ends_of(Flat density, std::int64_t& evaluations) {
  CheckedDensity target(density);
  const Eigen::MatrixXd points = RandomNumbers(3).normals(1000, density.dimension());
  LogDensityBatch batch;
  target.evaluate(points, 0, batch);
  const Eigen::VectorXd values = batch.value;
  const std::int64_t before = target.evaluations();
  SupportEnds ends = find_support_ends(target, points, values);
  evaluations = target.evaluations() - before;
  return ends;
}

TEST(SupportEnds, AreFoundAlongCoordinates) {
  std::int64_t evaluations = 0;
  const SupportEnds ends =
      ends_of({3, [](const auto& x) { return x[0] > -0.3 && x[1] < 0.7 && x[1] > -0.25; }}, evaluations);
  EXPECT_NEAR(ends.lower[0], -0.3, 1e-6);
  EXPECT_NEAR(ends.lower[1], -0.25, 1e-6);
  EXPECT_NEAR(ends.upper[1], 0.7, 1e-6);
  EXPECT_TRUE(std::isinf(ends.upper[0]));
  EXPECT_FALSE(ends.at(2));
  EXPECT_TRUE(ends.any());
  EXPECT_LE(evaluations, 3 * 64);
  EXPECT_DOUBLE_EQ(ends.folded(-0.5, 1), 2 * ends.lower[1] + 0.5);
  EXPECT_DOUBLE_EQ(ends.folded(0.1, 1), 0.1);
}

TEST(SupportEnds, OfADiscOrASlantedEdgeAreNone) {
  std::int64_t evaluations = 0;
  EXPECT_FALSE(ends_of({2, [](const auto& x) { return x.squaredNorm() < 1; }}, evaluations).any());
  EXPECT_FALSE(ends_of({2, [](const auto& x) { return x[0] + 0.1 * x[1] > 0; }}, evaluations).any());
  EXPECT_FALSE(ends_of({2, [](const auto&) { return true; }}, evaluations).any());
  EXPECT_EQ(evaluations, 0);
}

}  // namespace
}  // namespace knothe::posterior
