#include "knothe/imaging/correlation/spline_image.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::imaging {
namespace {

files::Picture wave(int width, int height) {
  files::Picture p;
  p.width = width, p.height = height;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      p.pixels.push_back(static_cast<float>(100 + 50 * std::sin(0.31 * x + 0.2) * std::cos(0.23 * y)));
  return p;
}

TEST(SplineImage, PassesThroughThePixels) {
  const files::Picture p = wave(61, 47);
  const SplineImage image(p);
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) EXPECT_NEAR(image.at(x, y).value, p.at(x, y), 2e-4) << x << ' ' << y;
}

TEST(SplineImage, InterpolatesASmoothFunctionAndItsGradient) {
  const SplineImage image(wave(61, 47));
  for (double y = 6.25; y < 40; y += 3.7)
    for (double x = 6.6; x < 54; x += 2.3) {
      const auto v = image.at(x, y);
      const double a = 0.31 * x + 0.2, b = 0.23 * y;
      // The error of the cubic spline is of fourth order in the frequency: (0.31)^4 · 50/384 · few.
      EXPECT_NEAR(v.value, 100 + 50 * std::sin(a) * std::cos(b), 5e-3);
      EXPECT_NEAR(v.dx, 50 * 0.31 * std::cos(a) * std::cos(b), 2e-2);
      EXPECT_NEAR(v.dy, -50 * 0.23 * std::sin(a) * std::sin(b), 2e-2);
    }
}

TEST(SplineImage, ValuesAtPixelsAreThoseOfTheInterpolant) {
  const files::Picture p = wave(40, 33);
  const SplineImage image(p);
  std::vector<float> value, dx, dy;
  image.at_pixels(value, dx, dy);
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      const auto v = image.at(x, y);
      EXPECT_NEAR(value[p.index(x, y)], v.value, 1e-3);
      EXPECT_NEAR(dx[p.index(x, y)], v.dx, 1e-3);
      EXPECT_NEAR(dy[p.index(x, y)], v.dy, 1e-3);
    }
}

TEST(SplineImage, GaussianPrefilterDampsAWaveByItsTransferFunction) {
  const files::Picture p = wave(120, 110);
  const double sigma = 1.3;
  const SplineImage image(p, sigma);
  const double damped = std::exp(-0.5 * sigma * sigma * (0.31 * 0.31 + 0.23 * 0.23));
  for (int k = 20; k < 90; k += 7)
    EXPECT_NEAR(image.at(k, k).value, 100 + damped * 50 * std::sin(0.31 * k + 0.2) * std::cos(0.23 * k),
                0.02);
}

TEST(SplineImage, IsTheSameForAnyNumberOfThreads) {
  const files::Picture p = wave(200, 150);
  const SplineImage one(p, 1.0, 1), three(p, 1.0, 3);
  for (double y = 0; y < 149; y += 1.37)
    for (double x = 0; x < 199; x += 1.91) EXPECT_EQ(one.at(x, y).value, three.at(x, y).value);
}

TEST(SplineImage, RefusesATinyPicture) {
  try {
    const SplineImage image(wave(3, 9));
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(),
                 "a picture of 3 × 9 pixels is too small to interpolate: at least 4 × 4 are needed");
  }
}

}  // namespace
}  // namespace knothe::imaging
