#pragma once
/// @file Finite-element meshes over a picture: nodes in pixel coordinates, triangles and upright rectangles,
/// and the pixels that belong to each element.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "knothe/files/picture.hpp"

namespace knothe::imaging {

/// Upright rectangle given by two opposite corners, px, both inclusive.
struct Region {
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  [[nodiscard]] double width() const { return x1 - x0; }
  [[nodiscard]] double height() const { return y1 - y0; }
};

enum class ElementShape { quadrilateral, triangle };

/// Nodes and elements. A triangle has −1 as its fourth node; the nodes of a rectangle go round it.
struct ImageMesh {
  std::vector<double> x, y;  ///< px
  std::vector<std::array<int, 4>> elements;
  [[nodiscard]] int node_count() const { return static_cast<int>(x.size()); }
  [[nodiscard]] int element_count() const { return static_cast<int>(elements.size()); }
  [[nodiscard]] static int nodes_of(const std::array<int, 4>& element) { return element[3] < 0 ? 3 : 4; }
  [[nodiscard]] Region bounds() const;
};

/// Equal elements over a region, their size adjusted to divide it evenly; triangles are halves of the
/// rectangles. Errors: UsageError for an empty region or elements of less than 3 px.
[[nodiscard]] ImageMesh structured_mesh(const Region& region, double element_size,
                                        ElementShape shape = ElementShape::quadrilateral);

/// The elements of which at least `share` of the pixels are set in the mask (0: not), with the nodes they
/// need. Errors: UsageError if mask and mesh do not overlap.
[[nodiscard]] ImageMesh masked(const ImageMesh& mesh, const files::Picture& mask, double share = 0.5);

/// The elements that lie wholly in both regions, with the nodes they need. Errors: UsageError if none does,
/// or one of them is smaller than 3 px.
[[nodiscard]] ImageMesh elements_inside(const ImageMesh& mesh, const Region& region, const Region& picture);

/// The same mesh with each rectangle cut into two triangles.
[[nodiscard]] ImageMesh triangulated(const ImageMesh& mesh);

/// Shape functions of one element, N_a(x, y) = Σ_m c_am (1, X, Y, X Y)_m with X = x − x_0, Y = y − y_0 (exact
/// for triangles and upright rectangles), and its pixels.
struct ElementPixels {
  struct Row {
    int x, y, count;
  };
  double x_origin = 0, y_origin = 0;
  std::array<std::array<double, 4>, 4> coefficients{};
  std::uint32_t first_row = 0, row_count = 0;
  int pixel_count = 0;
};

/// Every pixel centre inside the mesh belongs to exactly one element: on an edge between two to the right or
/// lower one.
class PixelTable {
 public:
  PixelTable() = default;
  /// Errors: UsageError for an element that is neither a triangle nor an upright rectangle, or reaches
  /// outside a picture of that size.
  PixelTable(const ImageMesh& mesh, int width, int height);
  [[nodiscard]] const std::vector<ElementPixels>& elements() const { return elements_; }
  [[nodiscard]] std::span<const ElementPixels::Row> rows(const ElementPixels& e) const {
    return {rows_.data() + e.first_row, e.row_count};
  }

 private:
  std::vector<ElementPixels> elements_;
  std::vector<ElementPixels::Row> rows_;
};

/// Finds the element of any point.
class PointLocator {
 public:
  explicit PointLocator(const ImageMesh& mesh);
  struct Place {
    int element = -1;  ///< −1: outside the mesh
    std::array<double, 4> shape{};
  };
  [[nodiscard]] Place find(double x, double y) const;
  /// N_a = Σ_m c_am (1, X, Y, XY)_m of an element with X, Y from its origin.
  struct Shape {
    double x_origin = 0, y_origin = 0;
    std::array<std::array<double, 4>, 4> coefficients{};
  };
  [[nodiscard]] const Shape& shape(int element) const { return shapes_[static_cast<std::size_t>(element)]; }

 private:
  struct Extent {
    double x0, y0, x1, y1;
  };
  const ImageMesh* mesh_;
  std::vector<Shape> shapes_;
  std::vector<Extent> extents_;
  Region bounds_;
  double cell_ = 1;
  int columns_ = 0, rows_ = 0;
  std::vector<std::vector<int>> cells_;
};

}  // namespace knothe::imaging
