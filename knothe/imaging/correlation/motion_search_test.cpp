// Large motions that are found without a start: drawn at random, with brightness and noise, against the
// motion with which the pictures were drawn.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <random>

#include "knothe/base/testing/long_form.hpp"
#include "knothe/imaging/correlation/affine_motion.hpp"
#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/correlation/matched_motion.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {
namespace {

constexpr int k_width = 360, k_height = 300;
const Region k_region{60, 50, 300, 250};
const Eigen::Vector2d k_middle(180, 150);

const SpecklePattern& pattern() {
  static const SpecklePattern made({.width = k_width, .height = k_height, .margin = 500});
  return made;
}

/// F about the middle of the region, which moves by `shift`.
AffineMotion about_middle(const Eigen::Matrix2d& gradient, const Eigen::Vector2d& shift) {
  return {gradient, k_middle + shift - gradient * k_middle};
}
Eigen::Matrix2d turned(double degrees) {
  return Eigen::Rotation2Dd(degrees * std::numbers::pi / 180).toRotationMatrix();
}
DisplacementField field_of(const AffineMotion& motion) {
  const Eigen::Matrix2d g = motion.gradient - Eigen::Matrix2d::Identity();
  return [=](double x, double y) {
    const Eigen::Vector2d u = g * Eigen::Vector2d(x, y) + motion.shift;
    return Displacement{u[0], u[1], {g(0, 0), g(0, 1), g(1, 0), g(1, 1)}};
  };
}

bool is_in_picture(const Eigen::Vector2d& x) {
  return x[0] >= 0 && x[1] >= 0 && x[0] <= k_width - 1 && x[1] <= k_height - 1;
}
/// Share of the region that the deformed picture shows.
double overlap(const AffineMotion& motion) {
  int seen = 0;
  for (int i = 0; i < 20; ++i)
    for (int j = 0; j < 20; ++j)
      seen += is_in_picture(motion.moved({k_region.x0 + k_region.width() * (i + 0.5) / 20,
                                          k_region.y0 + k_region.height() * (j + 0.5) / 20}))
                  ? 1
                  : 0;
  return seen / 400.0;
}

/// Any shift that leaves half of the region in view, after a rotation of up to `degrees` and stretches of up
/// to `stretch` in any two directions at right angles.
AffineMotion drawn_motion(std::mt19937_64& generator, double degrees, double stretch) {
  std::uniform_real_distribution<double> one(-1, 1);
  const Eigen::Matrix2d axes = turned(180 * one(generator));
  const Eigen::Vector2d stretches(1 + stretch * one(generator), 1 + stretch * one(generator));
  const Eigen::Matrix2d gradient =
      turned(degrees * one(generator)) * axes * stretches.asDiagonal() * axes.transpose();
  for (;;) {
    const AffineMotion motion = about_middle(gradient, {k_width * one(generator), k_height * one(generator)});
    if (overlap(motion) >= 0.5) return motion;
  }
}

struct Outcome {
  bool converged;
  double rms = 0;             ///< px, over the measured nodes
  double seen = 0, used = 0;  ///< elements that are in the picture, and those of them that were measured
};
Outcome outcome_of(const ImageCorrelation& correlation, const CorrelationResult& result,
                   const AffineMotion& motion) {
  const ImageMesh& mesh = correlation.mesh();
  const Eigen::VectorXd error = result.displacement - nodal_displacement(motion, mesh);
  Outcome outcome{result.converged && result.residual_rms < 0.75 * correlation.contrast()};
  double count = 0;
  const auto measured = measured_nodes(mesh, result.element_valid);
  for (int a = 0; a < mesh.node_count(); ++a)
    if (measured[static_cast<std::size_t>(a)] != 0)
      outcome.rms += error.segment<2>(2 * a).squaredNorm() / 2, count += 1;
  outcome.rms = std::sqrt(outcome.rms / std::max(1.0, count));
  for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
    bool seen = true;
    for (const int n : mesh.elements[e]) {
      const auto i = static_cast<std::size_t>(n);
      seen = seen && is_in_picture(motion.moved({mesh.x[i], mesh.y[i]}));
    }
    outcome.seen += seen ? 1 : 0, outcome.used += seen && result.element_valid[e] != 0 ? 1 : 0;
  }
  return outcome;
}

void expect_found(unsigned first_seed, int count, double degrees, double stretch) {
  ImageCorrelation correlation(pattern().render({}, {.noise = 2, .seed = 9}), structured_mesh(k_region, 20));
  int lost = 0, wrong = 0, incomplete = 0;
  for (int k = 0; k < count; ++k) {
    std::mt19937_64 generator(first_seed + static_cast<unsigned>(k));
    const AffineMotion motion = drawn_motion(generator, degrees, stretch);
    std::uniform_real_distribution<double> one(-1, 1);
    const auto picture = pattern().render(field_of(motion), {.noise = 3 + 2 * one(generator),
                                                             .gain = 1 + 0.2 * one(generator),
                                                             .offset = 15 * one(generator),
                                                             .seed = static_cast<unsigned>(k)});
    const auto result = correlation.correlate(picture);
    const Outcome o = outcome_of(correlation, result, motion);
    lost += o.converged ? 0 : 1;
    wrong += o.converged && o.rms > 0.2 ? 1 : 0;
    incomplete += o.converged && o.used < 0.9 * o.seen ? 1 : 0;
    if (!o.converged || o.rms > 0.2 || o.used < 0.9 * o.seen)
      ADD_FAILURE() << fmt::format(
          "{}: overlap {:.2f}, F {:.3f} {:.3f} {:.3f} {:.3f}, rms {:.3f} px, {} of {} elements, "
          "residual {:.1f}, {} iterations; {}",
          first_seed + static_cast<unsigned>(k), overlap(motion), motion.gradient(0, 0),
          motion.gradient(0, 1), motion.gradient(1, 0), motion.gradient(1, 1), o.rms, o.used, o.seen,
          result.residual_rms, result.iterations, result.message);
  }
  EXPECT_EQ(lost, 0) << "of " << count;
  EXPECT_EQ(wrong, 0) << "of " << count;
  EXPECT_EQ(incomplete, 0) << "of " << count;
}

/// Some of `all`, which are tried at night.
int some(int all) {
  return std::getenv("KNOTHE_ALL_MOTIONS") != nullptr ? all : all / test::by_form(50, 4);
}

TEST(LargeMotion, RigidOnesAreFoundWhereHalfTheRegionIsInView) {
  expect_found(1000, some(400), 20, 0);
}
TEST(LargeMotion, StretchesOfAFifthAreFound) {
  expect_found(10000, some(400), 20, 0.2);
}
TEST(LargeMotion, AnyRotationIsFound) {
  expect_found(20000, some(200), 180, 0);
}

TEST(LargeMotion, ATurningSeriesIsFollowedPictureByPicture) {
  ImageCorrelation correlation(pattern().render({}, {.noise = 2, .seed = 9}), structured_mesh(k_region, 20));
  Eigen::VectorXd start;
  for (int k = 1; k <= 6; ++k) {
    const AffineMotion motion = about_middle(turned(30.0 * k), {3.0 * k, -2.0 * k});
    const auto result = correlation.correlate(
        pattern().render(field_of(motion), {.noise = 2, .seed = static_cast<unsigned>(k)}), start);
    ASSERT_TRUE(result.converged) << k << ": " << result.message;
    EXPECT_LT(outcome_of(correlation, result, motion).rms, 0.05) << k;
    start = result.displacement;
  }
}

TEST(LargeMotion, AWarmStartNeedsNoMoreStepsAtALargeRotation) {
  ImageCorrelation correlation(pattern().render(), structured_mesh(k_region, 20));
  for (const double degrees : {0.0, 20.0, 90.0, 180.0}) {
    const AffineMotion near = about_middle(turned(degrees), {0.3, -0.2}),
                       motion = about_middle(turned(degrees + 0.1), {0.6, -0.4});
    const auto result = correlation.correlate(pattern().render(field_of(motion)),
                                              nodal_displacement(near, correlation.mesh()));
    ASSERT_TRUE(result.converged) << result.message;
    EXPECT_FALSE(result.searched);
    EXPECT_LE(result.iterations, 4) << degrees;
    EXPECT_LT(outcome_of(correlation, result, motion).rms, 0.01) << degrees;
  }
}

TEST(AffineMotion, IsTheSameMotionAtEveryLevelAndTheFitOfItsOwnDisplacements) {
  const AffineMotion motion = about_middle(turned(33) * 1.1, {12, -7});
  const ImageMesh mesh = structured_mesh(k_region, 20);
  const AffineMotion fitted = mean_motion(mesh, nodal_displacement(motion, mesh));
  EXPECT_LT((fitted.gradient - motion.gradient).norm(), 1e-12);
  EXPECT_LT((fitted.shift - motion.shift).norm(), 1e-9);
  for (const int level : {1, 3}) {
    const AffineMotion coarse = at_level(motion, 0, level);
    const Eigen::Vector2d x(40, 90), moved = motion.moved(x),
                                     of_level = coarse.moved({to_level(x[0], level), to_level(x[1], level)});
    EXPECT_NEAR(from_level(of_level[0], level), moved[0], 1e-10);
    EXPECT_NEAR(from_level(of_level[1], level), moved[1], 1e-10);
    EXPECT_LT((at_level(coarse, level, 0).shift - motion.shift).norm(), 1e-10);
  }
}

TEST(MatchedMotion, IsNoneBetweenSurfacesThatHaveNothingInCommon) {
  const SpecklePattern other({.width = k_width, .height = k_height, .seed = 77});
  EXPECT_FALSE(matched_motion({pattern().render(), {}}, other.render(), 1));
  files::Picture uniform = other.render();
  uniform.pixels.assign(uniform.pixels.size(), 90);
  EXPECT_FALSE(matched_motion({pattern().render(), {}}, uniform, 1));
  EXPECT_FALSE(matched_motion({uniform, {}}, other.render(), 1));
}

}  // namespace
}  // namespace knothe::imaging
