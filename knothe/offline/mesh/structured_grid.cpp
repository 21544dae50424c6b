#include "knothe/offline/mesh/structured_grid.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::offline {

std::vector<double> graded_positions(double from, double to, double first, double growth, double largest) {
  const double length = std::abs(to - from);
  std::vector<double> intervals;
  double sum = 0, interval = first;
  while (sum < length * (1 - 1e-9)) {
    interval = std::min(interval * growth, largest);
    intervals.push_back(interval);
    sum += interval;
  }
  // Too long by less than one interval: the last one goes if the rest is nearer to the length.
  if (intervals.size() > 1 && sum - length > length - (sum - intervals.back())) {
    sum -= intervals.back();
    intervals.pop_back();
  }
  std::vector<double> positions{from};
  double reached = 0;
  for (const double value : intervals) {
    reached += value;
    positions.push_back(from + (to - from) * (reached / sum));
  }
  positions.back() = to;
  return positions;
}

std::vector<double> uniform_positions(double from, double to, std::size_t count) {
  std::vector<double> positions(count + 1);
  for (std::size_t i = 0; i <= count; ++i) positions[i] = from + (to - from) * (1.0 * i / count);
  positions.back() = to;
  return positions;
}

HexahedronMesh structured_grid(std::span<const double> x, std::span<const double> y,
                               std::span<const double> z,
                               const std::function<bool(const std::array<double, 3>&)>& is_inside) {
  const std::size_t ny = y.size(), nz = z.size();
  const auto grid_number = [&](std::size_t i, std::size_t j, std::size_t k) -> std::int64_t {
    return (i * nz + k) * ny + j;
  };
  std::vector<std::int64_t> number(x.size() * ny * nz, -1);
  HexahedronMesh mesh;
  for (Index i = 0; i + 1 < std::ssize(x); ++i)
    for (std::size_t k = 0; k + 1 < nz; ++k)
      for (std::size_t j = 0; j + 1 < ny; ++j) {
        if (!is_inside({(x[i] + x[i + 1]) / 2, (y[j] + y[j + 1]) / 2, (z[k] + z[k + 1]) / 2})) continue;
        for (const std::size_t c : {k, k + 1})
          for (const auto& [a, b] :
               {std::pair{i, j}, std::pair{i + 1, j}, std::pair{i + 1, j + 1}, std::pair{i, j + 1}}) {
            mesh.cells.push_back(grid_number(a, b, c));
            number[mesh.cells.back()] = 0;
          }
      }
  for (Index i = 0; i < std::ssize(x); ++i)
    for (std::size_t k = 0; k < nz; ++k)
      for (std::size_t j = 0; j < ny; ++j) {
        auto& entry = number[grid_number(i, j, k)];
        if (entry < 0) continue;
        entry = mesh.node_count();
        mesh.points.insert(mesh.points.end(), {x[i], y[j], z[k]});
      }
  for (auto& node : mesh.cells) node = number[node];
  mesh.elastic.assign(mesh.cells.size() / 8, 0);
  return mesh;
}

NodeSet nodes_where(const HexahedronMesh& mesh,
                    const std::function<bool(double, double, double)>& condition) {
  NodeSet result;
  for (std::int64_t n = 0; n < mesh.node_count(); ++n)
    if (condition(mesh.points[3 * n], mesh.points[3 * n + 1], mesh.points[3 * n + 2])) result.push_back(n);
  return result;
}

}  // namespace knothe::offline
