#pragma once
/// @file Finite-element meshes over a picture: nodes in pixel coordinates, triangles and convex
/// quadrilaterals, and the pixels that belong to each element.
#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/correlation/shape_functions.hpp"

namespace knothe::imaging {

/// Upright rectangle given by two opposite corners, px, both inclusive.
struct Region {
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  [[nodiscard]] double width() const { return x1 - x0; }
  [[nodiscard]] double height() const { return y1 - y0; }
};

enum class ElementShape { quadrilateral, triangle };

/// Nodes and elements. A triangle has −1 as its fourth node; the nodes of a quadrilateral go round it.
struct ImageMesh {
  std::vector<double> x, y;  ///< px
  std::vector<std::array<int, 4>> elements;
  [[nodiscard]] int node_count() const { return x.size(); }
  [[nodiscard]] int element_count() const { return elements.size(); }
  [[nodiscard]] static int nodes_of(const std::array<int, 4>& element) { return element[3] < 0 ? 3 : 4; }
  [[nodiscard]] Region bounds() const;
  /// Shape functions of an element about an origin, px.
  [[nodiscard]] ShapeFunctions shape_functions(const std::array<int, 4>& element, double x0, double y0) const;
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

/// The same mesh with each quadrilateral cut into two triangles.
[[nodiscard]] ImageMesh triangulated(const ImageMesh& mesh);

/// Shape functions of one element, N_a = Σ_m c_am (1, X, Y, X Y)_m, and its pixels. X = x − x_origin, Y = y −
/// y_origin, but where `natural` they are the natural coordinates, one pair per pixel (shape_functions.hpp).
struct ElementPixels {
  struct Row {
    int x, y, count;
    std::uint32_t first = 0;  ///< of its natural coordinates
  };
  double x_origin = 0, y_origin = 0;
  std::array<std::array<double, 4>, 4> coefficients{};
  std::uint32_t first_row = 0, row_count = 0;
  int pixel_count = 0;
  bool natural = false;
};

/// Every pixel centre inside the mesh belongs to exactly one element: on an edge between two to the right or
/// lower one.
class PixelTable {
 public:
  PixelTable() = default;
  /// Errors: UsageError for an element without area, a quadrilateral that is not convex, and a mesh that
  /// reaches outside a picture of that size.
  PixelTable(const ImageMesh& mesh, int width, int height);
  [[nodiscard]] const std::vector<ElementPixels>& elements() const { return elements_; }
  [[nodiscard]] std::span<const ElementPixels::Row> rows(const ElementPixels& e) const {
    return {rows_.data() + e.first_row, e.row_count};
  }
  /// The row `count` further on in this table, or its last.
  [[nodiscard]] const ElementPixels::Row& row_ahead(const ElementPixels::Row& row, std::size_t count) const {
    return rows_[std::min<std::size_t>(&row - rows_.data() + count, rows_.size() - 1)];
  }
  /// X and Y of the k-th pixel of a row.
  [[nodiscard]] std::array<double, 2> coordinates(const ElementPixels& e, const ElementPixels::Row& row,
                                                  int k) const {
    if (!e.natural) return {row.x + k - e.x_origin, row.y - e.y_origin};
    const std::size_t at = row.first + k;
    return {xi_[at], eta_[at]};
  }
  /// Natural coordinates of the pixels of a row, and whatever follows for a vector's length.
  [[nodiscard]] const float* xi(const ElementPixels::Row& row) const { return xi_.data() + row.first; }
  [[nodiscard]] const float* eta(const ElementPixels::Row& row) const { return eta_.data() + row.first; }

 private:
  std::vector<ElementPixels> elements_;
  std::vector<ElementPixels::Row> rows_;
  std::vector<float> xi_, eta_;
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
  [[nodiscard]] const ShapeFunctions& shape(int element) const { return shapes_[element]; }

 private:
  struct Extent {
    double x0, y0, x1, y1;
  };
  const ImageMesh* mesh_;
  std::vector<ShapeFunctions> shapes_;
  std::vector<Extent> extents_;
  Region bounds_;
  double cell_ = 1;
  int columns_ = 0, rows_ = 0;
  std::vector<std::vector<int>> cells_;
};

}  // namespace knothe::imaging
