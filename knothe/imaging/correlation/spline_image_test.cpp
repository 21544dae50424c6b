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
  // Twenty pixels from the borders, where the reflection is no longer felt.
  const SplineImage image(wave(101, 87));
  for (double y = 20.25; y < 66; y += 3.7)
    for (double x = 20.6; x < 80; x += 2.3) {
      const auto v = image.at(x, y);
      const double a = 0.31 * x + 0.2, b = 0.23 * y;
      // The error of the quintic spline is of sixth order in the frequency, 1e-6 of the wave's; the rest is
      // rounding.
      EXPECT_NEAR(v.value, 100 + 50 * std::sin(a) * std::cos(b), 1e-3);
      EXPECT_NEAR(v.dx, 50 * 0.31 * std::cos(a) * std::cos(b), 2e-3);
      EXPECT_NEAR(v.dy, -50 * 0.23 * std::sin(a) * std::sin(b), 2e-3);
    }
}

TEST(SplineImage, TheReflectionAtTheBordersIsForgottenWithinTenPixels) {
  const SplineImage image(wave(61, 47));
  for (double y = 10.25; y < 37; y += 3.7)
    for (double x = 10.6; x < 50; x += 2.3)
      EXPECT_NEAR(image.at(x, y).value, 100 + 50 * std::sin(0.31 * x + 0.2) * std::cos(0.23 * y), 5e-3);
}

TEST(SplineImage, GradientsAtPixelsAreThoseOfTheFunction) {
  const files::Picture p = wave(40, 33);
  const PixelRows rows{8, p.height - 5};
  const PixelGradients found = pixel_gradients(p, 0, rows, 1);
  for (int y = 10; y < p.height - 10; ++y)
    for (int x = 10; x < p.width - 10; ++x) {
      const double a = 0.31 * x + 0.2, b = 0.23 * y;
      const std::size_t i = p.index(x, y - rows.first);
      EXPECT_NEAR(found.value[i], p.at(x, y), 1e-3);
      EXPECT_NEAR(found.dx[i], 50 * 0.31 * std::cos(a) * std::cos(b), 1e-3);
      EXPECT_NEAR(found.dy[i], -50 * 0.23 * std::sin(a) * std::sin(b), 1e-3);
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
