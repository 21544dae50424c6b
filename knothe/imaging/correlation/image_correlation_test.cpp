#include "knothe/imaging/correlation/image_correlation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {
namespace {

using ::testing::HasSubstr;

const SpecklePattern& pattern() {
  static const SpecklePattern made({.width = 320, .height = 256});
  return made;
}
const Region k_region{30, 30, 280, 205};

/// Error of the nodal displacements against the exact field: mean and root mean square of both components.
struct NodalError {
  double bias_u = 0, bias_v = 0, rms = 0, largest = 0;
};
NodalError nodal_error(const ImageMesh& mesh, const Eigen::VectorXd& displacement,
                       const DisplacementField& exact) {
  NodalError e;
  const int n = mesh.node_count();
  for (int a = 0; a < n; ++a) {
    const auto d = exact(mesh.x[static_cast<std::size_t>(a)], mesh.y[static_cast<std::size_t>(a)]);
    const double du = displacement[2 * a] - d.u, dv = displacement[2 * a + 1] - d.v;
    e.bias_u += du / n, e.bias_v += dv / n, e.rms += (du * du + dv * dv) / (2 * n);
    e.largest = std::max({e.largest, std::abs(du), std::abs(dv)});
  }
  e.rms = std::sqrt(e.rms);
  return e;
}

DisplacementField rigid(double u, double v) {
  return [=](double, double) { return Displacement{u, v, {}}; };
}
/// Rotation by an angle about the centre of the region, with a shift.
DisplacementField rotation(double degrees, double u, double v) {
  const double c = std::cos(degrees * M_PI / 180) - 1, s = std::sin(degrees * M_PI / 180);
  return [=](double x, double y) {
    const double dx = x - 155, dy = y - 117;
    return Displacement{u + c * dx - s * dy, v + s * dx + c * dy, {c, -s, s, c}};
  };
}

TEST(ImageCorrelation, RigidShiftsHaveNoBias) {
  const auto reference = pattern().render();
  ImageCorrelation correlation(reference, structured_mesh(k_region, 25));
  for (int k = 0; k <= 10; k += 2) {
    const auto exact = rigid(0.1 * k, -0.05 * k);
    const auto result = correlation.correlate(pattern().render(exact));
    ASSERT_TRUE(result.converged) << result.message;
    const auto e = nodal_error(correlation.mesh(), result.displacement, exact);
    EXPECT_LT(std::abs(e.bias_u), 1.5e-3) << k;
    EXPECT_LT(std::abs(e.bias_v), 1.5e-3) << k;
    EXPECT_LT(e.rms, 0.01) << k;
    EXPECT_EQ(result.elements_rejected, 0);
  }
}

TEST(ImageCorrelation, FindsLargeMotionsWithoutAStart) {
  const auto reference = pattern().render();
  ImageCorrelation correlation(reference, structured_mesh(k_region, 25));
  for (const auto& exact : {rigid(20, -12), rotation(5, 3, -2), rigid(-19.3, 8.7)}) {
    const auto result = correlation.correlate(pattern().render(exact));
    ASSERT_TRUE(result.converged) << result.message;
    const auto e = nodal_error(correlation.mesh(), result.displacement, exact);
    EXPECT_LT(e.rms, 0.02) << result.displacement.head(4).transpose();
  }
}

TEST(ImageCorrelation, APredictionIsTakenWhereItFitsBetterThanTheStart) {
  ImageCorrelation correlation(pattern().render(), structured_mesh(k_region, 25));
  const auto exact = rigid(9, -6);
  const auto moved = pattern().render(exact);
  const auto all = [&](double u, double v) {
    Eigen::VectorXd d(2 * correlation.mesh().node_count());
    for (Eigen::Index a = 0; a < d.size(); a += 2) d.segment<2>(a) << u, v;
    return d;
  };
  const auto alone = correlation.correlate(moved, all(0, 0));
  EXPECT_TRUE(alone.searched);  // too far from where the last picture was
  const auto predicted = correlation.correlate(moved, all(0, 0), {}, all(8.6, -5.7));
  EXPECT_TRUE(predicted.predicted && predicted.converged && !predicted.searched);
  EXPECT_LE(predicted.iterations, 5);  // 4 with vector instructions, whose sums are others
  EXPECT_LT(nodal_error(correlation.mesh(), predicted.displacement, exact).rms, 0.01);
  const auto misled = correlation.correlate(moved, all(8.6, -5.7), {}, all(-9, 6));
  EXPECT_TRUE(!misled.predicted && misled.converged && !misled.searched);
  EXPECT_THROW((void)correlation.correlate(moved, all(0, 0), {}, Eigen::VectorXd::Zero(4)),
               knothe::UsageError);
}

TEST(ImageCorrelation, ABendingFieldIsFollowed) {
  const DisplacementField bending = [](double x, double y) {
    const double a = 3.0 / 125.0 / 125.0, dx = x - 155, dy = y - 117;
    return Displacement{-2 * a * dx * dy / 2, 0.5 * a * dx * dx, {-a * dy, -a * dx, a * dx, 0}};
  };
  const auto reference = pattern().render();
  for (const auto shape : {ElementShape::quadrilateral, ElementShape::triangle}) {
    ImageCorrelation correlation(reference, structured_mesh(k_region, 25, shape));
    const auto result = correlation.correlate(pattern().render(bending));
    ASSERT_TRUE(result.converged) << result.message;
    EXPECT_LT(nodal_error(correlation.mesh(), result.displacement, bending).rms, 0.02);
  }
}

TEST(ImageCorrelation, BrightnessAndContrastAreTakenOut) {
  const auto reference = pattern().render();
  const auto exact = rigid(0.3, 0.7);
  const auto darker = pattern().render(exact, {.gain = 0.75, .offset = 10});
  for (const auto brightness : {Brightness::global, Brightness::per_element}) {
    ImageCorrelation correlation(reference, structured_mesh(k_region, 25), {.brightness = brightness});
    const auto result = correlation.correlate(darker);
    ASSERT_TRUE(result.converged) << result.message;
    EXPECT_LT(nodal_error(correlation.mesh(), result.displacement, exact).rms, 0.015);
    if (brightness == Brightness::global) {
      EXPECT_NEAR(result.gain, 1 / 0.75, 0.01);
      EXPECT_NEAR(result.offset, -10 / 0.75, 1);
    }
  }
}

TEST(ImageCorrelation, ElementsOnACrackAreTakenOut) {
  // A crack along x = 150 opens by 8 px on its right side below y = 130.
  const double tip = 130, opening = 8;
  const DisplacementField cracked = [=](double x, double y) {
    const double depth = std::max(0.0, y - tip) / 75;
    if (x < 150) return Displacement{0.2, 0.1, {}};
    return Displacement{0.2 + opening * depth, 0.1, {0, y > tip ? opening / 75 : 0, 0, 0}};
  };
  ImageCorrelation correlation(pattern().render(), structured_mesh(k_region, 25));
  const auto result = correlation.correlate(pattern().render(cracked));
  ASSERT_TRUE(result.converged) << result.message;
  int on_crack = 0, flagged = 0, flagged_elsewhere = 0;
  std::string where;
  for (std::size_t e = 0; e < correlation.mesh().elements.size(); ++e) {
    const auto& nodes = correlation.mesh().elements[e];
    const double left = correlation.mesh().x[static_cast<std::size_t>(nodes[0])],
                 right = correlation.mesh().x[static_cast<std::size_t>(nodes[1])],
                 bottom = correlation.mesh().y[static_cast<std::size_t>(nodes[2])];
    const bool cut = left < 150 && right > 150 && bottom > 170;
    // In the frame of the reference picture the crack is the line x = 150, however wide it opens.
    on_crack += cut ? 1 : 0;
    flagged += cut && result.element_valid[e] == 0 ? 1 : 0;
    if (result.element_valid[e] == 0)
      where.append(std::to_string(left)).append(" ").append(std::to_string(bottom)).append("; ");
    flagged_elsewhere += !(left < 170 && right > 140) && result.element_valid[e] == 0 ? 1 : 0;
  }
  EXPECT_GE(on_crack, 2);
  EXPECT_EQ(flagged, on_crack);
  EXPECT_EQ(flagged_elsewhere, 0) << where;
  // The rest is as good as ever.
  for (int a = 0; a < correlation.mesh().node_count(); ++a)
    if (correlation.mesh().x[static_cast<std::size_t>(a)] < 110) {
      EXPECT_NEAR(result.displacement[2 * a], 0.2, 0.05);
    }
}

TEST(ImageCorrelation, IsBitIdenticalForAnyNumberOfThreads) {
  const auto reference = pattern().render();
  const auto deformed = pattern().render(rotation(0.5, 0.3, 0.2));
  ImageCorrelation one(reference, structured_mesh(k_region, 16), {.threads = 1}),
      two(reference, structured_mesh(k_region, 16), {.threads = 2});
  EXPECT_EQ(one.correlate(deformed).displacement, two.correlate(deformed).displacement);
}

TEST(ImageCorrelation, SaturatedPixelsAndTheMaskDoNotCount) {
  auto reference = pattern().render(), deformed = pattern().render(rigid(0.4, 0));
  files::Picture mask = reference;
  mask.pixels.assign(mask.pixels.size(), 1);
  for (int y = 60; y < 90; ++y)
    for (int x = 60; x < 100; ++x) reference.at(x, y) = reference.maximum, mask.at(x, y + 80) = 0;
  for (int y = 65; y < 85; ++y)
    for (int x = 65; x < 95; ++x) deformed.at(x, y + 80) = 0;
  ImageCorrelation correlation(reference, structured_mesh(k_region, 25), {}, mask);
  const auto result = correlation.correlate(deformed);
  ASSERT_TRUE(result.converged) << result.message;
  for (int a = 0; a < correlation.mesh().node_count(); ++a)
    if (result.displacement[2 * a] != 0) {
      EXPECT_NEAR(result.displacement[2 * a], 0.4, 0.1);
    }
}

TEST(ImageCorrelation, SaysWhatIsWrong) {
  const auto message_of = [](const auto& call) -> std::string {
    try {
      call();
    } catch (const UsageError& error) {
      return error.what();
    }
    return "no UsageError";
  };
  files::Picture uniform = pattern().render();
  const auto reference = uniform;
  uniform.pixels.assign(uniform.pixels.size(), 7);
  EXPECT_THAT(message_of([&] { ImageCorrelation(uniform, structured_mesh(k_region, 25)); }),
              HasSubstr("elements have no texture"));
  ImageCorrelation correlation(reference, structured_mesh(k_region, 25));
  const auto result = correlation.correlate(uniform);
  EXPECT_FALSE(result.converged);
  EXPECT_EQ(result.message, "the picture is uniform (every pixel is 7): nothing can be followed in it");
  const SpecklePattern other({.width = 200, .height = 200});
  EXPECT_THAT(message_of([&] { (void)correlation.correlate(other.render()); }),
              HasSubstr("the deformed picture has 200 × 200 pixels, the reference picture 320 × 256"));
  EXPECT_THAT(message_of([&] { (void)correlation.correlate(reference, Eigen::VectorXd::Zero(3)); }),
              HasSubstr("3 displacements to start with"));
}

}  // namespace
}  // namespace knothe::imaging
