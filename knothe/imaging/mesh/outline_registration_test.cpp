// Registration by the outline: pictures drawn with a known scale, turn and place; the truth is that drawing.
#include "knothe/imaging/mesh/outline_registration.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/imaging/mesh/mesh_field.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace {

using namespace knothe::imaging;
using knothe::files::Picture;

constexpr int k_width = 480, k_height = 300;

/// A notched beam of 96 × 40 mm, y up, seen by a camera.
const std::vector<std::array<double, 2>> k_beam{{-0.048, 0}, {-0.004, 0}, {-0.004, 0.008}, {0.004, 0.008},
                                                {0.004, 0},  {0.048, 0},  {0.048, 0.04},   {-0.048, 0.04}};

PictureFrame camera(double scale, double degrees, double x, double y) {
  PictureFrame frame = picture_frame(scale, {x, y});
  const auto turn = std::polar(1.0, degrees * std::numbers::pi / 180);
  frame.offset *= turn, frame.slope *= turn;
  return frame;
}

/// Share of body at a pixel: a smooth step of 0.7 px (standard deviation) across the polygon.
double body_at(const std::vector<std::array<double, 2>>& corners, const PictureFrame& frame, double x,
               double y) {
  const auto p = frame.model_point(x, y);
  bool inside = false;
  double nearest = 1e9;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const auto &a = corners[i], &b = corners[(i + 1) % corners.size()];
    if ((a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
      inside = !inside;
    const double ex = b[0] - a[0], ey = b[1] - a[1];
    const double t = std::clamp(((p[0] - a[0]) * ex + (p[1] - a[1]) * ey) / (ex * ex + ey * ey), 0.0, 1.0);
    nearest = std::min(nearest, std::hypot(p[0] - a[0] - t * ex, p[1] - a[1] - t * ey) / frame.scale());
  }
  return 0.5 * std::erfc((inside ? -nearest : nearest) / (0.7 * std::numbers::sqrt2));
}

Picture speckled(const PictureFrame& frame, std::uint64_t seed) {
  const SpecklePattern pattern({.width = k_width, .height = k_height, .seed = seed});
  return pattern.render({}, {.noise = 2, .seed = seed}, 1,
                        [&](double x, double y) { return body_at(k_beam, frame, x, y); });
}

Picture blank() {
  Picture picture;
  picture.width = k_width, picture.height = k_height;
  return picture;
}

/// A body of one grey level on another.
Picture plain(const PictureFrame& frame, float body, float behind) {
  Picture picture = blank();
  for (int y = 0; y < k_height; ++y)
    for (int x = 0; x < k_width; ++x)
      picture.pixels.push_back(behind + (body - behind) * static_cast<float>(body_at(k_beam, frame, x, y)));
  return picture;
}

/// Largest distance (px) of where two frames see the corners.
double distance(const PictureFrame& a, const PictureFrame& b) {
  double worst = 0;
  for (const auto& c : k_beam) {
    const auto p = a.picture_point({c[0], c[1], 0}), q = b.picture_point({c[0], c[1], 0});
    worst = std::max(worst, std::hypot(p[0] - q[0], p[1] - q[1]));
  }
  return worst;
}

std::string refused(const Picture& picture, const OutlineOptions& options) {
  try {
    (void)fit_outline(picture, polygon_outline(k_beam), options, "reference.tif");
  } catch (const knothe::DataError& error) {
    return error.what();
  }
  return "";
}

TEST(OutlineRegistration, ASpecklyBodyWhoseEndsAreOutOfViewIsFoundByItsNotch) {
  double squares = 0;
  int count = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const double angle = 1.5 - 0.7 * static_cast<double>(seed);
    const PictureFrame truth = camera(1.6e-4 + 1e-6 * static_cast<double>(seed), angle, 243.3, 270.7);
    const Picture picture = speckled(truth, seed);
    const OutlineFit fit = fit_outline(picture, polygon_outline(k_beam),
                                       {.start = camera(1.6e-4, 0, 250, 263)}, "reference.tif");
    EXPECT_LT(distance(fit.frame, truth), 0.4) << seed;
    EXPECT_GT(fit.used, 0.7 * fit.places);
    EXPECT_LT(fit.misfit, 0.25);
    EXPECT_LT(fit.frame.relative_scale_std, 1e-3);
    const double scale = std::log(fit.frame.scale() / truth.scale()) / fit.frame.relative_scale_std,
                 turn = std::arg(fit.frame.slope / truth.slope) / fit.angle_std;
    squares += scale * scale + turn * turn, count += 2;
  }
  // Errors in stated standard deviations.
  EXPECT_LT(std::sqrt(squares / count), 1.5);
}

TEST(OutlineRegistration, WithoutAStartABodyInViewIsFoundWhateverItsBrightness) {
  const PictureFrame truth = camera(2.4e-4, 7, 238.4, 226.1);
  for (const auto& [picture, limit] :
       {std::pair{plain(truth, 200, 30), 0.05}, std::pair{plain(truth, 20, 90), 0.05},
        std::pair{speckled(truth, 9), 0.25}}) {
    const OutlineFit fit = fit_outline(picture, polygon_outline(k_beam), {}, "reference.tif");
    EXPECT_LT(distance(fit.frame, truth), limit);
  }
}

TEST(OutlineRegistration, AMaskDoesAsWellAsItsPixelsAllow) {
  const PictureFrame truth = camera(2.4e-4, 3, 238.4, 226.1);
  Picture mask = plain(truth, 255, 0);
  for (float& v : mask.pixels) v = v > 127 ? 255 : 0;
  const OutlineFit fit = fit_outline(mask, polygon_outline(k_beam), {}, "mask.png");
  EXPECT_LT(distance(fit.frame, truth), 0.3);
  EXPECT_GT(fit.place_std[1], 0.1);  // says so itself
}

TEST(OutlineRegistration, CracksClampsAndShadowsDoNotCount) {
  const PictureFrame truth = camera(2.4e-4, -2, 238.4, 226.1);
  Picture picture = speckled(truth, 3);
  for (int y = 0; y < k_height; ++y)
    for (int x = 0; x < k_width; ++x) {
      if (x > 80 && x < 160 && y > 215) picture.at(x, y) = 240;            // a support
      if (x > 300 && x < 380 && y > 30 && y < 50) picture.at(x, y) = 128;  // a load cell's shadow
      if (std::abs(x - 250 - 6 * std::sin(0.1 * y)) < 2 && y > 50) picture.at(x, y) = 5;  // a crack
    }
  const OutlineFit fit =
      fit_outline(picture, polygon_outline(k_beam), {.start = camera(2.42e-4, 0, 233, 230)}, "reference.tif");
  EXPECT_LT(distance(fit.frame, truth), 0.3);
  EXPECT_LT(fit.used, fit.places);
}

TEST(OutlineRegistration, WhatTheSidesInViewDoNotTellIsSaid) {
  // Upper and lower face only, and no notch.
  const std::vector<std::array<double, 2>> plate{{-0.2, 0}, {0.2, 0}, {0.2, 0.04}, {-0.2, 0.04}};
  const PictureFrame close = camera(1.6e-4, 0, 240, 275);
  Picture picture = blank();
  for (int y = 0; y < k_height; ++y)
    for (int x = 0; x < k_width; ++x)
      picture.pixels.push_back(30 + 150 * static_cast<float>(body_at(plate, close, x, y)));
  const auto message = [&](const Picture& p, const OutlineOptions& options) {
    try {
      (void)fit_outline(p, polygon_outline(plate), options, "reference.tif");
    } catch (const knothe::DataError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(
      message(picture, {.start = close}),
      testing::HasSubstr("the outline does not tell the place to the right: edges were found on the upper "
                         "and lower sides only"));
  // A corner: lower and right.
  const PictureFrame corner = camera(1.6e-4, 0, 240 - 0.2 / 1.6e-4, 150);
  for (int y = 0; y < k_height; ++y)
    for (int x = 0; x < k_width; ++x)
      picture.at(x, y) = 30 + 150 * static_cast<float>(body_at(plate, corner, x, y));
  EXPECT_THAT(
      message(picture, {.start = corner}),
      testing::AllOf(testing::HasSubstr("does not tell the scale"), testing::HasSubstr("\"dic.scale_std\"")));
  // With a scale that is known the corner is enough.
  const OutlineFit fit =
      fit_outline(picture, polygon_outline(plate),
                  {.start = camera(1.6e-4, 0, 243 - 0.2 / 1.6e-4, 146), .scale_std = 1e-3}, "reference.tif");
  const auto p = fit.frame.picture_point({0.2, 0, 0});
  EXPECT_NEAR(p[0], 240, 0.1);
  EXPECT_NEAR(p[1], 150, 0.1);
  EXPECT_NEAR(fit.frame.relative_scale_std, 1e-3, 1e-4);
}

TEST(OutlineRegistration, WhereThereIsNoEdgeItSaysSo) {
  Picture grey = blank();
  grey.pixels.assign(static_cast<std::size_t>(k_width * k_height), 90.0F);
  EXPECT_THAT(refused(grey, {.start = camera(2.4e-4, 0, 240, 226)}),
              testing::HasSubstr("no edge of the body"));
  EXPECT_THAT(refused(grey, {}), testing::HasSubstr("no body stands out"));
  const Picture everywhere = SpecklePattern({.width = k_width, .height = k_height}).render({}, {.noise = 2});
  EXPECT_THAT(refused(everywhere, {.start = camera(2.4e-4, 0, 240, 226)}),
              testing::HasSubstr("reference.tif: error: "));
  EXPECT_THAT(refused(speckled(camera(1.6e-4, 0, 240, 275), 1), {}),
              testing::HasSubstr("reaches out of the picture"));
  // A scale in another unit.
  EXPECT_THAT(refused(everywhere, {.start = camera(2.4e-13, 0, 240, 226)}),
              testing::HasSubstr("reference.tif: error: "));
  // The start is 60 px off.
  EXPECT_NE(refused(speckled(camera(2.4e-4, 0, 240, 226), 1), {.start = camera(2.4e-4, 0, 180, 160)}), "");
}

TEST(OutlineRegistration, TheOutlineOfAMeshIsThatOfThePolygon) {
  ImageMesh mesh = structured_mesh({0, 0, 120, 80}, 20);   // "metres"
  mesh.elements.erase(mesh.elements.begin() + 3 * 6 + 2);  // a notch in the lowest row
  const Outline outline = outline_of(mesh);
  ASSERT_EQ(outline.size(), 8U);
  double area = 0;
  for (const auto& s : outline) area += 0.5 * (s.from[0] * s.to[1] - s.to[0] * s.from[1]);
  EXPECT_NEAR(area, 120 * 80 - 400, 1e-9);  // positive: the body is on the left
  EXPECT_THROW((void)polygon_outline({{0, 0}, {1, 1}, {2, 2}}), knothe::UsageError);
  EXPECT_EQ(polygon_outline({{0, 0}, {0, 1}, {0.5, 1}, {1, 1}, {1, 0}}).size(), 4U);
}

}  // namespace
