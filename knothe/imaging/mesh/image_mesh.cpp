#include "knothe/imaging/mesh/image_mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_rounding = 1e-9;    // px
constexpr std::size_t k_padding = 16;  // numbers that a vector may read beyond the last pixel

/// The interval of the row y inside an element; false if it does not meet it.
bool row_interval(const ImageMesh& mesh, const std::array<int, 4>& element, double y, double& left,
                  double& right) {
  const int n = ImageMesh::nodes_of(element);
  left = std::numeric_limits<double>::infinity(), right = -left;
  for (int a = 0; a < n; ++a) {
    const std::size_t p = element[a], q = element[(a + 1) % n];
    const double ya = mesh.y[p], yb = mesh.y[q];
    if (y < std::min(ya, yb) - k_rounding || y > std::max(ya, yb) + k_rounding) continue;
    if (std::abs(ya - yb) < k_rounding) {
      left = std::min({left, mesh.x[p], mesh.x[q]}), right = std::max({right, mesh.x[p], mesh.x[q]});
    } else {
      const double x = mesh.x[p] + (y - ya) / (yb - ya) * (mesh.x[q] - mesh.x[p]);
      left = std::min(left, x), right = std::max(right, x);
    }
  }
  return left <= right;
}

struct Box {
  double x0, y0, x1, y1;
};
Box box_of(const ImageMesh& mesh, const std::array<int, 4>& element) {
  const double far = std::numeric_limits<double>::infinity();
  Box b{far, far, -far, -far};
  for (int a = 0; a < ImageMesh::nodes_of(element); ++a) {
    const std::size_t p = element[a];
    b.x0 = std::min(b.x0, mesh.x[p]), b.x1 = std::max(b.x1, mesh.x[p]);
    b.y0 = std::min(b.y0, mesh.y[p]), b.y1 = std::max(b.y1, mesh.y[p]);
  }
  return b;
}

}  // namespace

Region ImageMesh::bounds() const {
  const auto [x0, x1] = std::minmax_element(x.begin(), x.end());
  const auto [y0, y1] = std::minmax_element(y.begin(), y.end());
  return {*x0, *y0, *x1, *y1};
}

ShapeFunctions ImageMesh::shape_functions(const std::array<int, 4>& element, double x0, double y0) const {
  std::array<double, 4> at_x{}, at_y{};
  const std::size_t n = nodes_of(element);
  for (std::size_t a = 0; a < n; ++a) {
    at_x[a] = x[element[a]];
    at_y[a] = y[element[a]];
  }
  return {std::span(at_x).first(n), std::span(at_y).first(n), x0, y0};
}

ImageMesh structured_mesh(const Region& given, double element_size, ElementShape shape) {
  Region region{std::min(given.x0, given.x1), std::min(given.y0, given.y1), std::max(given.x0, given.x1),
                std::max(given.y0, given.y1)};
  if (!(element_size >= 3))
    throw UsageError(
        fmt::format("elements of {} px: at least 3 × 3 pixels are needed, 16 to 32 are usual", element_size));
  const int columns = std::max<int>(1, std::lround(region.width() / element_size)),
            rows = std::max<int>(1, std::lround(region.height() / element_size));
  if (!(region.width() / columns >= 3 && region.height() / rows >= 3))
    throw UsageError(
        fmt::format("the region ({}, {}) to ({}, {}) is too small: elements need at least 3 × 3 pixels",
                    region.x0, region.y0, region.x1, region.y1));
  ImageMesh mesh;
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i <= columns; ++i) {
      mesh.x.push_back(region.x0 + region.width() * i / columns);
      mesh.y.push_back(region.y0 + region.height() * j / rows);
    }
  const auto node = [&](int i, int j) { return j * (columns + 1) + i; };
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      const std::array<int, 4> corner{node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)};
      if (shape == ElementShape::quadrilateral) {
        mesh.elements.push_back(corner);
      } else if ((i + j) % 2 == 0) {  // alternating diagonals: no preferred direction
        mesh.elements.push_back({corner[0], corner[1], corner[2], -1});
        mesh.elements.push_back({corner[0], corner[2], corner[3], -1});
      } else {
        mesh.elements.push_back({corner[0], corner[1], corner[3], -1});
        mesh.elements.push_back({corner[1], corner[2], corner[3], -1});
      }
    }
  return mesh;
}

namespace {

/// The elements that are wanted, and the nodes that they need.
ImageMesh part_of(const ImageMesh& mesh, const std::vector<char>& wanted) {
  ImageMesh kept;
  std::vector<int> number(mesh.x.size(), -1);
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    if (wanted[e] == 0) continue;
    std::array<int, 4> element = mesh.elements[e];
    for (int& node : element) {
      if (node < 0) continue;
      int& mine = number[node];
      if (mine < 0) {
        mine = kept.node_count();
        kept.x.push_back(mesh.x[node]);
        kept.y.push_back(mesh.y[node]);
      }
      node = mine;
    }
    kept.elements.push_back(element);
  }
  return kept;
}

}  // namespace

ImageMesh masked(const ImageMesh& mesh, const files::Picture& mask, double share) {
  const PixelTable table(mesh, mask.width, mask.height);
  std::vector<char> wanted(mesh.elements.size(), 0);
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    const auto& pixels = table.elements()[e];
    int set = 0;
    for (const auto& row : table.rows(pixels))
      for (int k = 0; k < row.count; ++k) set += mask.at(row.x + k, row.y) > 0 ? 1 : 0;
    wanted[e] = set >= share * pixels.pixel_count && pixels.pixel_count > 0 ? 1 : 0;
  }
  ImageMesh kept = part_of(mesh, wanted);
  if (kept.elements.empty())
    throw UsageError(
        "the mask leaves no element: it must be bright (not 0) where the surface is to be measured, and "
        "overlap the region");
  return kept;
}

ImageMesh elements_inside(const ImageMesh& mesh, const Region& region, const Region& picture) {
  const auto inside = [](const Region& r, const Box& b) {
    return b.x0 >= std::min(r.x0, r.x1) - k_rounding && b.x1 <= std::max(r.x0, r.x1) + k_rounding &&
           b.y0 >= std::min(r.y0, r.y1) - k_rounding && b.y1 <= std::max(r.y0, r.y1) + k_rounding;
  };
  std::vector<char> wanted(mesh.elements.size(), 0);
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    const Box box = box_of(mesh, mesh.elements[e]);
    wanted[e] = inside(region, box) && inside(picture, box) ? 1 : 0;
    const double half = ImageMesh::nodes_of(mesh.elements[e]) == 3 ? 0.5 : 1;
    if (wanted[e] != 0 && (std::min(box.x1 - box.x0, box.y1 - box.y0) < 3 ||
                           mesh.shape_functions(mesh.elements[e], box.x0, box.y0).area() < 9 * half))
      throw UsageError(
          fmt::format("element {} of the mesh is {:.1f} × {:.1f} px: at least 3 × 3 pixels are needed; take "
                      "a closer picture, or a coarser mesh",
                      e, box.x1 - box.x0, box.y1 - box.y0));
  }
  ImageMesh kept = part_of(mesh, wanted);
  if (kept.elements.empty())
    throw UsageError("no element of the mesh lies in the picture: are scale and origin right?");
  return kept;
}

ImageMesh triangulated(const ImageMesh& mesh) {
  ImageMesh result = mesh;
  result.elements.clear();
  for (const auto& n : mesh.elements) {
    result.elements.push_back({n[0], n[1], n[2], -1});
    if (ImageMesh::nodes_of(n) == 4) result.elements.push_back({n[0], n[2], n[3], -1});
  }
  return result;
}

PixelTable::PixelTable(const ImageMesh& mesh, int width, int height) {
  const Region bounds = mesh.bounds();
  if (bounds.x0 < -k_rounding || bounds.y0 < -k_rounding || bounds.x1 > width - 1 + k_rounding ||
      bounds.y1 > height - 1 + k_rounding)
    throw UsageError(fmt::format(
        "the mesh reaches from ({:.1f}, {:.1f}) to ({:.1f}, {:.1f}) px, outside the picture of {} × {} px "
        "(pixel centres 0 … {}, 0 … {}); make the region smaller",
        bounds.x0, bounds.y0, bounds.x1, bounds.y1, width, height, width - 1, height - 1));
  std::vector<bool> taken(static_cast<std::size_t>(width) * height, false);
  const auto index = [&](int x, int y) { return static_cast<std::size_t>(y) * width + x; };
  std::vector<std::vector<ElementPixels::Row>> rows(mesh.elements.size());
  // First half-open, so that shared edges go to the right and lower element; then what is left on the outer
  // border.
  for (const bool closed : {false, true})
    for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
      const Box box = box_of(mesh, mesh.elements[e]);
      const int first = std::ceil(box.y0 - k_rounding), last = std::floor(box.y1 + k_rounding);
      for (int y = std::max(0, first); y <= std::min(height - 1, last); ++y) {
        if (!closed && y > box.y1 - k_rounding) continue;
        double left = 0, right = 0;
        if (!row_interval(mesh, mesh.elements[e], y, left, right)) continue;
        int x = std::max<int>(0, std::ceil(left - k_rounding));
        const int end = closed ? std::min<int>(width - 1, std::floor(right + k_rounding)) + 1
                               : std::ceil(right - k_rounding);
        for (; x < end; ++x) {
          if (taken[index(x, y)]) continue;
          taken[index(x, y)] = true;
          auto& mine = rows[e];
          if (!mine.empty() && mine.back().y == y && mine.back().x + mine.back().count == x)
            ++mine.back().count;
          else
            mine.push_back({x, y, 1});
        }
      }
    }
  elements_.resize(mesh.elements.size());
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    ElementPixels& pixels = elements_[e];
    const Box box = box_of(mesh, mesh.elements[e]);
    pixels.x_origin = std::round(0.5 * (box.x0 + box.x1)),
    pixels.y_origin = std::round(0.5 * (box.y0 + box.y1));
    const ShapeFunctions shape = mesh.shape_functions(mesh.elements[e], pixels.x_origin, pixels.y_origin);
    if (!shape.is_valid())
      throw UsageError(
          fmt::format("element {} of the mesh, around pixel ({:.0f}, {:.0f}), is neither a triangle with an "
                      "area nor a convex quadrilateral: correct the mesh, or split it into triangles",
                      e, pixels.x_origin, pixels.y_origin));
    pixels.coefficients = shape.coefficients();
    pixels.natural = shape.is_natural();
    if (pixels.natural)
      for (auto& row : rows[e]) {
        row.first = xi_.size();
        for (int k = 0; k < row.count; ++k) {
          const auto [xi, eta] = shape.coordinates(row.x + k, row.y);
          xi_.push_back(xi), eta_.push_back(eta);
        }
      }
    pixels.first_row = rows_.size();
    pixels.row_count = rows[e].size();
    for (const auto& row : rows[e]) pixels.pixel_count += row.count;
    rows_.insert(rows_.end(), rows[e].begin(), rows[e].end());
  }
  for (auto* values : {&xi_, &eta_}) values->resize(values->empty() ? 0 : values->size() + k_padding, 0.0F);
}

PointLocator::PointLocator(const ImageMesh& mesh) : mesh_(&mesh), bounds_(mesh.bounds()) {
  cell_ = std::max(
      1.0, std::sqrt(std::max(1.0, bounds_.width() * bounds_.height()) / std::max(1, mesh.element_count())));
  columns_ = static_cast<int>(bounds_.width() / cell_) + 1;
  rows_ = static_cast<int>(bounds_.height() / cell_) + 1;
  cells_.resize(static_cast<std::size_t>(columns_) * rows_);
  for (int e = 0; e < mesh.element_count(); ++e) {
    const Box box = box_of(mesh, mesh.elements[e]);
    shapes_.push_back(mesh.shape_functions(mesh.elements[e], box.x0, box.y0));
    extents_.push_back({box.x0, box.y0, box.x1, box.y1});
    const auto column = [&](double x) { return std::clamp<int>((x - bounds_.x0) / cell_, 0, columns_ - 1); };
    const auto row = [&](double y) { return std::clamp<int>((y - bounds_.y0) / cell_, 0, rows_ - 1); };
    for (int j = row(box.y0 - 1e-6); j <= row(box.y1 + 1e-6); ++j)
      for (int i = column(box.x0 - 1e-6); i <= column(box.x1 + 1e-6); ++i)
        cells_[j * columns_ + i].push_back(e);
  }
}

PointLocator::Place PointLocator::find(double x, double y) const {
  Place place;
  constexpr double k_slack = 1e-7;
  if (!(x >= bounds_.x0 - k_slack && x <= bounds_.x1 + k_slack && y >= bounds_.y0 - k_slack &&
        y <= bounds_.y1 + k_slack))
    return place;
  const int i = std::clamp<int>((x - bounds_.x0) / cell_, 0, columns_ - 1),
            j = std::clamp<int>((y - bounds_.y0) / cell_, 0, rows_ - 1);
  for (const int e : cells_[j * columns_ + i]) {
    const Extent& box = extents_[e];
    if (x < box.x0 - k_slack || x > box.x1 + k_slack || y < box.y0 - k_slack || y > box.y1 + k_slack)
      continue;
    place.shape = shapes_[e].values(x, y);
    const std::ptrdiff_t count = ImageMesh::nodes_of(mesh_->elements[e]);
    const bool inside =
        std::all_of(place.shape.begin(), place.shape.begin() + count, [](double n) { return n > -1e-7; });
    if (!inside) continue;
    place.element = e;
    return place;
  }
  return place;
}

}  // namespace knothe::imaging
