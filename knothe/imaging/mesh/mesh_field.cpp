#include "knothe/imaging/mesh/mesh_field.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_reach = 12;  // px beyond the outline within which the field is continued
constexpr double k_cell = 8;    // px
constexpr double k_blur = 0.7;  // px: standard deviation of the step across the outline

}  // namespace

MeshField::MeshField(ImageMesh mesh)
    : mesh_(std::move(mesh)), locator_(mesh_), displacement_(Eigen::VectorXd::Zero(2 * mesh_.node_count())) {
  std::map<std::array<int, 2>, int> count;
  for (const auto& nodes : mesh_.elements) {
    const int n = ImageMesh::nodes_of(nodes);
    for (int a = 0; a < n; ++a) {
      const int p = nodes[a], q = nodes[(a + 1) % n];
      ++count[{std::min(p, q), std::max(p, q)}];
    }
  }
  for (const auto& [edge, times] : count)
    if (times == 1) edges_.push_back(edge);
  bounds_ = mesh_.bounds();
  bounds_ = {bounds_.x0 - k_reach, bounds_.y0 - k_reach, bounds_.x1 + k_reach, bounds_.y1 + k_reach};
  columns_ = static_cast<int>(bounds_.width() / k_cell) + 1;
  rows_ = static_cast<int>(bounds_.height() / k_cell) + 1;
  cells_.resize(static_cast<std::size_t>(columns_) * rows_);
  for (Index e = 0; e < std::ssize(edges_); ++e) {
    const std::size_t p = edges_[e][0], q = edges_[e][1];
    const auto cell = [](double at, double from, int last) {
      return std::clamp<int>((at - from) / k_cell, 0, last);
    };
    const int i0 = cell(std::min(mesh_.x[p], mesh_.x[q]) - k_reach, bounds_.x0, columns_ - 1),
              i1 = cell(std::max(mesh_.x[p], mesh_.x[q]) + k_reach, bounds_.x0, columns_ - 1);
    const int j0 = cell(std::min(mesh_.y[p], mesh_.y[q]) - k_reach, bounds_.y0, rows_ - 1),
              j1 = cell(std::max(mesh_.y[p], mesh_.y[q]) + k_reach, bounds_.y0, rows_ - 1);
    for (int j = j0; j <= j1; ++j)
      for (int i = i0; i <= i1; ++i) cells_[j * columns_ + i].push_back(e);
  }
}

MeshField::Nearest MeshField::nearest_edge(double x, double y) const {
  Nearest best;
  if (!(x >= bounds_.x0 && x <= bounds_.x1 && y >= bounds_.y0 && y <= bounds_.y1)) return best;
  const int i = std::min<int>((x - bounds_.x0) / k_cell, columns_ - 1),
            j = std::min<int>((y - bounds_.y0) / k_cell, rows_ - 1);
  for (const int e : cells_[j * columns_ + i]) {
    const std::size_t p = edges_[e][0], q = edges_[e][1];
    const double dx = mesh_.x[q] - mesh_.x[p], dy = mesh_.y[q] - mesh_.y[p];
    const double along =
        std::clamp(((x - mesh_.x[p]) * dx + (y - mesh_.y[p]) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
    const double distance = std::hypot(x - mesh_.x[p] - along * dx, y - mesh_.y[p] - along * dy);
    if (best.edge < 0 || distance < best.distance) best = {e, along, distance};
  }
  return best;
}

Displacement MeshField::at(double x, double y) const {
  Displacement d;
  const auto place = locator_.find(x, y);
  if (place.element < 0) {
    const Nearest near = nearest_edge(x, y);
    if (near.edge < 0) return d;
    const auto& edge = edges_[near.edge];
    const auto value = [&](int k) {
      return (1 - near.along) * displacement_[2 * edge[0] + k] + near.along * displacement_[2 * edge[1] + k];
    };
    d.u = value(0), d.v = value(1);
    return d;
  }
  const auto& nodes = mesh_.elements[place.element];
  const auto gradients = locator_.shape(place.element).gradients(x, y);
  for (Index a = 0; a < ImageMesh::nodes_of(nodes); ++a) {
    const double u = displacement_[2 * nodes[a]], v = displacement_[2 * nodes[a] + 1];
    const auto [slope_x, slope_y] = gradients[a];
    d.u += place.shape[a] * u, d.v += place.shape[a] * v;
    d.gradient[0] += slope_x * u, d.gradient[1] += slope_y * u;
    d.gradient[2] += slope_x * v, d.gradient[3] += slope_y * v;
  }
  return d;
}

double MeshField::body(double x, double y) const {
  const Nearest near = nearest_edge(x, y);
  const bool inside = locator_.find(x, y).element >= 0;
  if (near.edge < 0 || near.distance > 6 * k_blur) return inside ? 1 : 0;
  const double distance = inside ? near.distance : -near.distance;
  return 0.5 * std::erfc(-distance / (std::sqrt(2.0) * k_blur));
}

double MeshField::outline_distance(double x, double y) const {
  const Nearest near = nearest_edge(x, y);
  return near.edge < 0 ? std::numeric_limits<double>::infinity() : near.distance;
}

files::Picture without_outline(const MeshField& field, int width, int height, double margin,
                               const files::Picture& mask) {
  files::Picture result = mask;
  if (mask.pixels.empty()) {
    result.width = width, result.height = height;
    result.pixels.assign(static_cast<std::size_t>(width) * height, 1);
  }
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (field.outline_distance(x, y) < margin) result.at(x, y) = 0;
  return result;
}

}  // namespace knothe::imaging
