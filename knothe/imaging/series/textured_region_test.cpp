// Where the pattern is, in pictures whose pattern is known to be somewhere.
#include "knothe/imaging/series/textured_region.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace knothe::imaging {
namespace {

/// Noise of `strength` grey levels of 65,535 everywhere; of 8,000 inside `surface`.
files::Picture picture_of(const Region& surface, double strength = 60) {
  files::Picture p;
  p.width = 640, p.height = 480, p.bit_depth = 16, p.maximum = 65535;
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      const bool inside = x >= surface.x0 && x <= surface.x1 && y >= surface.y0 && y <= surface.y1;
      p.pixels.push_back((inside ? 20000 : 1000) +
                         (inside ? 8000 : static_cast<float>(strength)) * normal(random));
    }
  return p;
}

void paint(files::Picture& p, const Region& where, float level) {
  for (int y = static_cast<int>(where.y0); y <= where.y1; ++y)
    for (int x = static_cast<int>(where.x0); x <= where.x1; ++x) p.at(x, y) = level;
}

/// Inside the surface, and at most two blocks smaller on each side.
void expect_near(const std::optional<Region>& found, const Region& surface) {
  ASSERT_TRUE(found);
  EXPECT_GE(found->x0, surface.x0);
  EXPECT_LE(found->x0, surface.x0 + 32);
  EXPECT_GE(found->y0, surface.y0);
  EXPECT_LE(found->y0, surface.y0 + 32);
  EXPECT_LE(found->x1, surface.x1);
  EXPECT_GE(found->x1, surface.x1 - 32);
  EXPECT_LE(found->y1, surface.y1);
  EXPECT_GE(found->y1, surface.y1 - 32);
}

TEST(TexturedRegion, IsTheSurfaceBeforeADarkBackground) {
  for (const Region& surface : {Region{100, 90, 500, 400}, Region{37, 203, 411, 309}}) {
    SCOPED_TRACE(surface.x0);
    expect_near(textured_region(picture_of(surface), 10), surface);
  }
}

TEST(TexturedRegion, LeavesAMarginWhereTheSurfaceGoesOutOfThePicture) {
  const auto found = textured_region(picture_of({0, 100, 639, 380}), 10);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->x0, 10);
  EXPECT_EQ(found->x1, 629);
}

TEST(TexturedRegion, HasPoresInIt) {
  files::Picture p = picture_of({100, 90, 500, 400});
  paint(p, {300, 250, 325, 275}, 500);
  paint(p, {180, 200, 200, 210}, 500);
  expect_near(textured_region(p, 10), {100, 90, 500, 400});
}

TEST(TexturedRegion, LeavesOutARollerThatHasAPatternToo) {
  // It stands on the surface, whose rectangle is the larger one.
  files::Picture p = picture_of({0, 160, 639, 440});
  const files::Picture roller = picture_of({250, 40, 400, 159}, 60);
  for (int y = 40; y < 160; ++y)
    for (int x = 250; x <= 400; ++x) p.at(x, y) = roller.at(x, y);
  expect_near(textured_region(p, 0), {0, 160, 639, 440});
}

TEST(TexturedRegion, IsNoneWhereThePatternIsEverywhere) {
  EXPECT_FALSE(textured_region(picture_of({0, 0, 639, 479}), 10));
  // Nor is a region that is weaker by a factor of two a background, or a spot one.
  EXPECT_FALSE(textured_region(picture_of({0, 0, 319, 479}, 4000), 10));
  files::Picture spot = picture_of({0, 0, 639, 479});
  paint(spot, {100, 100, 150, 150}, 500);
  EXPECT_FALSE(textured_region(spot, 10));
}

TEST(TexturedRegion, IsNoneInAPictureWithoutPatternOrTooSmallForBlocks) {
  EXPECT_FALSE(textured_region(picture_of({-2, -2, -1, -1}), 10));
  files::Picture small;
  small.width = 12, small.height = 9, small.pixels.assign(108, 3);
  EXPECT_FALSE(textured_region(small, 1));
}

}  // namespace
}  // namespace knothe::imaging
