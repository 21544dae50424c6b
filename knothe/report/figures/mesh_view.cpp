#include "knothe/report/figures/mesh_view.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "knothe/base/error.hpp"

namespace knothe::report {
namespace {

constexpr int k_colours = 48;

/// The six faces of a hexahedron in VTK's vertex order.
constexpr std::array<std::array<int, 4>, 6> k_faces = {
    {{0, 1, 2, 3}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}}};

double mix(const std::array<double, 4>& corner, double s, double t) {
  return (1 - s) * (1 - t) * corner[0] + s * (1 - t) * corner[1] + s * t * corner[2] +
         (1 - s) * t * corner[3];
}

}  // namespace

OuterFace outer_face(const model::Mesh& mesh) {
  if (mesh.nodes_per_cell != 8)
    throw DataError(fmt::format("mesh/cells: {} nodes per cell; the picture of a mesh needs hexahedra of 8",
                                mesh.nodes_per_cell));
  double top = -INFINITY, extent = 0.0;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    top = std::max(top, mesh.points[3 * i + 2]);
    for (int c = 0; c < 3; ++c) extent = std::max(extent, std::abs(mesh.points[3 * i + c]));
  }
  OuterFace face;
  std::map<std::size_t, std::size_t> own_number;
  for (std::size_t cell = 0; cell < mesh.cell_count(); ++cell) {
    for (const auto& corners : k_faces) {
      std::array<std::size_t, 4> nodes{};
      bool outside = true;
      for (std::size_t k = 0; k < 4; ++k) {
        const std::int64_t node = mesh.cells[8 * cell + corners[k]], points = mesh.point_count();
        if (node < 0 || node >= points)
          throw DataError(fmt::format("mesh/cells[{},{}] = {}: no such point", cell, corners[k], node));
        nodes[k] = node;
        outside = outside && mesh.points[3 * nodes[k] + 2] >= top - 1e-6 * extent;
      }
      if (!outside) continue;
      std::array<std::size_t, 4> own{};
      for (std::size_t k = 0; k < 4; ++k) {
        const auto [entry, is_new] = own_number.try_emplace(nodes[k], face.nodes.size());
        if (is_new) {
          face.nodes.push_back(nodes[k]);
          face.points.push_back({mesh.points[3 * nodes[k]], mesh.points[3 * nodes[k] + 1]});
        }
        own[k] = entry->second;
      }
      face.cells.push_back(own);
    }
  }
  return face;
}

std::vector<std::ptrdiff_t> dofs_of_face(const OuterFace& face, const model::Dofs& dofs,
                                         std::int64_t component) {
  double top = -INFINITY;
  for (std::size_t i = 0; i < dofs.components.size(); ++i) top = std::max(top, dofs.points[3 * i + 2]);
  const auto key = [](double x, double y) { return std::pair(std::llround(x * 1e7), std::llround(y * 1e7)); };
  std::map<std::pair<long long, long long>, std::ptrdiff_t> index;
  for (std::size_t i = 0; i < dofs.components.size(); ++i)
    if (dofs.components[i] == component && dofs.points[3 * i + 2] >= top - 1e-7)
      index[key(dofs.points[3 * i], dofs.points[3 * i + 1])] = i;
  std::vector<std::ptrdiff_t> found;
  for (const auto& point : face.points) {
    const auto entry = index.find(key(point[0], point[1]));
    found.push_back(entry == index.end() ? -1 : entry->second);
  }
  return found;
}

std::vector<std::array<std::array<double, 2>, 2>> outline(const OuterFace& face) {
  std::map<std::pair<std::size_t, std::size_t>, int> cells_at;
  for (const auto& cell : face.cells)
    for (std::size_t k = 0; k < 4; ++k) ++cells_at[std::minmax({cell[k], cell[(k + 1) % 4]})];
  std::vector<std::array<std::array<double, 2>, 2>> edges;
  for (const auto& [nodes, count] : cells_at)
    if (count == 1) edges.push_back({face.points[nodes.first], face.points[nodes.second]});
  return edges;
}

double plot_height_of(const OuterFace& face, double plot_width) {
  double low = INFINITY, high = -INFINITY, bottom = INFINITY, top = -INFINITY;
  for (const auto& point : face.points) {
    low = std::min(low, point[0]), high = std::max(high, point[0]);
    bottom = std::min(bottom, point[1]), top = std::max(top, point[1]);
  }
  return std::clamp(52.0 + (plot_width - 60.0) * ((top - bottom) / (high - low) + 0.08), 130.0, 420.0);
}

Plot mesh_plot(const std::string& title, const OuterFace& face, std::span<const double> value,
               std::span<const std::array<double, 2>> shift, const std::string& bar_label) {
  if (value.size() != face.points.size() || (!shift.empty() && shift.size() != value.size()))
    throw DataError(
        fmt::format("figure '{}': {} values for {} nodes", title, value.size(), face.points.size()));
  double low = value.empty() ? 0.0 : *std::min_element(value.begin(), value.end());
  double high = value.empty() ? 1.0 : *std::max_element(value.begin(), value.end());
  const bool signed_field = low < 0.0 && high > 0.0 && std::min(-low, high) > 0.02 * std::max(-low, high);
  if (signed_field) high = std::max(high, -low), low = -high;
  if (!(high > low)) high = low + std::max(std::abs(low), 1e-12);
  const auto colour_of = [&](double v) {
    const double fraction = std::round((v - low) / (high - low) * k_colours) / k_colours;
    return signed_field ? blue_white_red(fraction) : viridis(fraction);
  };

  std::vector<Cell> cells;
  for (const auto& quadrilateral : face.cells) {
    std::array<double, 4> x{}, y{}, v{};
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t node = quadrilateral[k];
      x[k] = face.points[node][0] + (shift.empty() ? 0.0 : shift[node][0]);
      y[k] = face.points[node][1] + (shift.empty() ? 0.0 : shift[node][1]);
      v[k] = value[node];
    }
    // Split where the colour changes within the element, so that coarse elements are shaded too.
    const auto [least, most] = std::minmax_element(v.begin(), v.end());
    const int parts = std::clamp<int>(std::ceil((*most - *least) / (high - low) * k_colours / 3.0), 1, 6);
    for (int i = 0; i < parts; ++i)
      for (int j = 0; j < parts; ++j) {
        const double s0 = double(i) / parts, s1 = double(i + 1) / parts, t0 = double(j) / parts,
                     t1 = double(j + 1) / parts;
        cells.push_back({{{mix(x, s0, t0), mix(y, s0, t0)},
                          {mix(x, s1, t0), mix(y, s1, t0)},
                          {mix(x, s1, t1), mix(y, s1, t1)},
                          {mix(x, s0, t1), mix(y, s0, t1)}},
                         colour_of(mix(v, 0.5 * (s0 + s1), 0.5 * (t0 + t1)))});
      }
  }
  Plot plot(title, {""}, {""});
  plot.as_map().cells(std::move(cells));
  plot.colour_bar(
      {bar_label, low, high, signed_field ? ColourBar::Map::blue_white_red : ColourBar::Map::viridis});
  return plot;
}

}  // namespace knothe::report
