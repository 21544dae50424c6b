#include "knothe/imaging/mesh/image_mesh.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::imaging {
namespace {

using ::testing::HasSubstr;

template <class Call>
std::string message_of(const Call& call) {
  try {
    call();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "no UsageError";
}

TEST(ImageMesh, DividesTheRegionEvenly) {
  const ImageMesh mesh = structured_mesh({10, 20, 109, 80}, 25);
  EXPECT_EQ(mesh.element_count(), 4 * 2);
  EXPECT_EQ(mesh.node_count(), 5 * 3);
  EXPECT_DOUBLE_EQ(mesh.x[1] - mesh.x[0], 99.0 / 4);
  EXPECT_DOUBLE_EQ(mesh.y.back(), 80);
  EXPECT_EQ(structured_mesh({109, 80, 10, 20}, 25, ElementShape::triangle).element_count(), 16);
}

TEST(PixelTable, EveryPixelBelongsToExactlyOneElement) {
  for (const auto shape : {ElementShape::quadrilateral, ElementShape::triangle})
    for (const double size : {7.0, 10.0, 12.5, 31.7}) {
      const Region region{3, 5, 83, 61};
      const ImageMesh mesh = structured_mesh(region, size, shape);
      const PixelTable table(mesh, 100, 80);
      std::vector<int> owners(100 * 80, 0);
      for (const auto& element : table.elements())
        for (const auto& row : table.rows(element))
          for (int k = 0; k < row.count; ++k) {
            ++owners[static_cast<std::size_t>(row.y * 100 + row.x + k)];
            // Inside by its shape functions, which sum to 1.
            const double x = row.x + k - element.x_origin, y = row.y - element.y_origin;
            double sum = 0;
            for (const auto& c : element.coefficients) {
              const double n = c[0] + c[1] * x + c[2] * y + c[3] * x * y;
              EXPECT_GT(n, -1e-9);
              sum += n;
            }
            EXPECT_NEAR(sum, 1, 1e-12);
          }
      for (int y = 0; y < 80; ++y)
        for (int x = 0; x < 100; ++x)
          EXPECT_EQ(owners[static_cast<std::size_t>(y * 100 + x)],
                    x >= 3 && x <= 83 && y >= 5 && y <= 61 ? 1 : 0)
              << x << ' ' << y << ' ' << size;
    }
}

/// A structured mesh whose inner nodes are moved, so that its elements are general quadrilaterals.
ImageMesh distorted_mesh(const Region& region, double size) {
  ImageMesh mesh = structured_mesh(region, size);
  for (std::size_t a = 0; a < mesh.x.size(); ++a) {
    const double edge = std::min(
        {mesh.x[a] - region.x0, region.x1 - mesh.x[a], mesh.y[a] - region.y0, region.y1 - mesh.y[a]});
    if (edge < 1e-9) continue;
    mesh.x[a] += 0.2 * size * std::sin(1.7 * static_cast<double>(a));
    mesh.y[a] += 0.2 * size * std::cos(2.3 * static_cast<double>(a));
  }
  return mesh;
}

TEST(PixelTable, GeneralQuadrilateralsShareThePixelsAndMapThemBack) {
  const Region region{3, 5, 83, 61};
  const ImageMesh mesh = distorted_mesh(region, 16);
  const PixelTable table(mesh, 100, 80);
  std::vector<int> owners(100 * 80, 0);
  for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
    const auto& element = table.elements()[e];
    for (const auto& row : table.rows(element))
      for (int k = 0; k < row.count; ++k) {
        ++owners[static_cast<std::size_t>(row.y * 100 + row.x + k)];
        const auto [xi, eta] = table.coordinates(element, row, k);
        double x = 0, y = 0;
        for (std::size_t a = 0; a < 4; ++a) {
          const auto& c = element.coefficients[a];
          const double n = c[0] + c[1] * xi + c[2] * eta + c[3] * xi * eta;
          EXPECT_GT(n, -1e-6);
          x += n * mesh.x[static_cast<std::size_t>(mesh.elements[e][a])];
          y += n * mesh.y[static_cast<std::size_t>(mesh.elements[e][a])];
        }
        EXPECT_NEAR(x, row.x + k, 1e-4);  // the coordinates are kept as float
        EXPECT_NEAR(y, row.y, 1e-4);
      }
  }
  for (int y = 5; y <= 61; ++y)
    for (int x = 3; x <= 83; ++x)
      EXPECT_EQ(owners[static_cast<std::size_t>(y * 100 + x)], 1) << x << ' ' << y;
}

TEST(ShapeFunctions, OfAGeneralQuadrilateralReproduceALinearFieldAndItsArea) {
  const std::vector<double> x{10, 31, 36, 8}, y{12, 9, 33, 27};
  const ShapeFunctions shape(x, y, 20, 20);
  ASSERT_TRUE(shape.is_valid() && shape.is_natural());
  const auto n = shape.values(22.3, 17.9);
  const auto g = shape.gradients(22.3, 17.9);
  double value = 0, dx = 0, dy = 0, area = 0;
  for (std::size_t a = 0; a < 4; ++a) {
    const double u = 0.3 + 0.02 * x[a] - 0.05 * y[a];
    value += n[a] * u, dx += g[a][0] * u, dy += g[a][1] * u;
  }
  EXPECT_NEAR(value, 0.3 + 0.02 * 22.3 - 0.05 * 17.9, 1e-12);
  EXPECT_NEAR(dx, 0.02, 1e-12);
  EXPECT_NEAR(dy, -0.05, 1e-12);
  for (const auto& point : shape.integration_points()) area += point.weight;
  EXPECT_NEAR(area, shape.area(), 1e-9);
  EXPECT_NEAR(area, 0.5 * std::abs((36 - 10) * (27.0 - 9) - (8.0 - 31) * (33 - 12)), 1e-9);  // diagonals
}

TEST(ImageMesh, AMaskKeepsElementsThatItCovers) {
  files::Picture mask;
  mask.width = mask.height = 101;
  mask.pixels.assign(101 * 101, 0);
  for (int y = 0; y <= 100; ++y)
    for (int x = 0; x < 50; ++x) mask.at(x, y) = 255;
  const ImageMesh all = structured_mesh({0, 0, 100, 100}, 25);
  const ImageMesh kept = masked(all, mask);
  EXPECT_EQ(kept.element_count(), 8);
  EXPECT_EQ(kept.node_count(), 15);
  for (const double x : kept.x) EXPECT_LE(x, 50);
  mask.pixels.assign(101 * 101, 0);
  EXPECT_THAT(message_of([&] { (void)masked(all, mask); }), HasSubstr("the mask leaves no element"));
}

TEST(PointLocator, FindsPointsAndInterpolatesLinearFieldsExactly) {
  for (const auto shape : {ElementShape::quadrilateral, ElementShape::triangle}) {
    const ImageMesh mesh = structured_mesh({2, 3, 92, 71}, 11, shape);
    const PointLocator locator(mesh);
    for (double y = 3; y <= 71; y += 3.4)
      for (double x = 2; x <= 92; x += 4.5) {
        const auto place = locator.find(x, y);
        ASSERT_GE(place.element, 0) << x << ' ' << y;
        double px = 0, py = 0;
        const auto& nodes = mesh.elements[static_cast<std::size_t>(place.element)];
        for (std::size_t a = 0; a < static_cast<std::size_t>(ImageMesh::nodes_of(nodes)); ++a) {
          px += place.shape[a] * mesh.x[static_cast<std::size_t>(nodes[a])];
          py += place.shape[a] * mesh.y[static_cast<std::size_t>(nodes[a])];
        }
        EXPECT_NEAR(px, x, 1e-9);
        EXPECT_NEAR(py, y, 1e-9);
      }
    EXPECT_EQ(locator.find(1.9, 30).element, -1);
    EXPECT_EQ(locator.find(30, 71.2).element, -1);
  }
}

TEST(ImageMesh, SaysWhatIsWrong) {
  EXPECT_THAT(message_of([] {
                (void)structured_mesh({0, 0, 100, 100}, 2);
              }),
              HasSubstr("elements of 2 px: at least 3 × 3 pixels are needed"));
  EXPECT_THAT(message_of([] {
                (void)structured_mesh({0, 0, 100, 1}, 20);
              }),
              HasSubstr("is too small: elements need at least 3 × 3 pixels"));
  EXPECT_THAT(
      message_of([] {
        const PixelTable table(structured_mesh({0, 0, 100, 50}, 20), 100, 60);
      }),
      HasSubstr("the mesh reaches from (0.0, 0.0) to (100.0, 50.0) px, outside the picture of 100 × 60 px"));
  ImageMesh slanted{{0, 10, 12, 1}, {0, 1, 12, 10}, {{0, 2, 1, 3}}};  // its sides cross
  EXPECT_THAT(
      message_of([&] { const PixelTable table(slanted, 50, 50); }),
      HasSubstr("around pixel (6, 6), is neither a triangle with an area nor a convex quadrilateral"));
}

}  // namespace
}  // namespace knothe::imaging
