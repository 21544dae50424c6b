#include "knothe/offline/full_order/crack_solutions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/dense_solvers.hpp"
#include "knothe/offline/full_order/structure.hpp"
#include "knothe/offline/mesh/structured_grid.hpp"

namespace knothe::offline {
namespace {

constexpr double k_near = 1e-7;  // m

/// Planes from the crack line to one end of the beam, through the places that must be planes.
std::vector<double> planes_to_end(double line, double end, const BeamOptions& beam,
                                  const CrackedBeamOptions& options) {
  std::vector<double> stops;
  for (const double place :
       {line, beam.load_half_width, beam.refined_half_width, beam.support, beam.length / 2})
    for (const double stop : {-place, place})
      if ((stop - line) * (end - line) > k_near * std::abs(end - line)) stops.push_back(stop);
  std::sort(stops.begin(), stops.end(),
            [&](double a, double b) { return std::abs(a - line) < std::abs(b - line); });
  std::vector<double> result{line};
  double interval = options.spacing / options.growth;
  for (const double stop : stops) {
    if (std::abs(stop - result.back()) < k_near) continue;
    const double largest =
        std::abs(stop) <= beam.refined_half_width + k_near ? beam.element : beam.largest_element;
    const auto segment =
        graded_positions(result.back(), stop, interval, options.growth, std::max(largest, options.spacing));
    interval = std::abs(segment.back() - segment[segment.size() - 2]);
    result.insert(result.end(), segment.begin() + 1, segment.end());
  }
  return result;
}

void validate(const BeamOptions& beam, const CrackedBeamOptions& options) {
  beam.validate();
  if (!(options.spacing > 0))
    throw ProjectError(fmt::format("crack: spacing is {} m; it must be positive", options.spacing));
  if (!(options.growth >= 1 && options.growth <= 3))
    throw ProjectError(fmt::format("crack: growth is {}; it must be from 1 to 3", options.growth));
  if (options.count < 2)
    throw ProjectError(fmt::format("crack: count is {}; at least two lengths are needed", options.count));
  const double ligament = beam.height - beam_grid(beam).notch_depth;
  if (options.count * options.spacing > ligament + k_near)
    throw ProjectError(fmt::format(
        "crack: {} lengths every {} m do not leave one element of the {} m above the notch whole; "
        "at most {} lengths",
        options.count, options.spacing, ligament, std::floor(ligament / options.spacing + 1e-6)));
  const double rows = ligament / options.spacing;
  if (std::abs(rows - std::round(rows)) > 1e-6)
    throw ProjectError(fmt::format("crack: spacing of {} m does not divide the {} m above the notch",
                                   options.spacing, ligament));
}

}  // namespace

CrackedBeam::CrackedBeam(const BeamOptions& beam, const CrackedBeamOptions& options,
                         const ElasticConstants& elastic) {
  validate(beam, options);
  for (int i = 0; i < options.count; ++i) lengths_.push_back(i * options.spacing);
  make_mesh(beam, options);
  solve(elastic);
}

void CrackedBeam::make_mesh(const BeamOptions& beam, const CrackedBeamOptions& options) {
  const BeamGrid grid = beam_grid(beam);
  line_ = grid.notch_half_width;
  corner_ = grid.notch_depth;
  auto& [x, y, z] = planes_;
  const auto right = planes_to_end(line_, beam.length / 2, beam, options);
  const auto left = planes_to_end(line_, -beam.length / 2, beam, options);
  x.assign(left.rbegin(), left.rend());
  x.insert(x.end(), right.begin() + 1, right.end());
  if (corner_ > k_near) {
    y = graded_positions(corner_, 0, options.spacing / options.growth, options.growth, beam.element);
    std::reverse(y.begin(), y.end());
    y.pop_back();
  }
  const auto above =
      uniform_positions(corner_, beam.height, std::round((beam.height - corner_) / options.spacing));
  y.insert(y.end(), above.begin(), above.end());
  z = grid.z;

  mesh_ = structured_grid(x, y, z, [&](const std::array<double, 3>& centre) {
    return !(std::abs(centre[0]) < line_ && centre[1] < corner_);
  });
  cell_at_.assign((x.size() - 1) * (y.size() - 1) * (z.size() - 1), -1);
  for (std::int64_t cell = 0; cell < mesh_.cell_count(); ++cell) {
    const auto centre = mesh_.cell_centre(cell);
    std::size_t index = 0;
    for (int c = 0; c < 3; ++c) {
      const auto& planes = planes_[c];
      const auto interval = std::upper_bound(planes.begin(), planes.end(), centre[c]) - planes.begin() - 1;
      index = index * (planes.size() - 1) + interval;
    }
    cell_at_[index] = cell;
  }
  open_line(corner_ + lengths_.back());
  mark_beam(mesh_, beam);
}

void CrackedBeam::open_line(double top) {
  const NodeSet line = nodes_where(mesh_, [&](double x, double y, double) {
    return std::abs(x - line_) < k_near && y > corner_ - k_near && y < top - k_near;
  });
  std::vector<std::int64_t> twin(mesh_.node_count(), -1);
  for (const auto node : line) {
    twin[node] = mesh_.node_count();
    for (int c = 0; c < 3; ++c) mesh_.points.push_back(mesh_.points[3 * node + c]);
    pairs_.push_back({node, twin[node]});
  }
  for (std::int64_t cell = 0; cell < mesh_.cell_count(); ++cell) {
    if (mesh_.cell_centre(cell)[0] < line_) continue;
    for (int a = 0; a < 8; ++a) {
      auto& node = mesh_.cells[8 * cell + a];
      if (node < std::ssize(twin) && twin[node] >= 0) node = twin[node];
    }
  }
  std::sort(pairs_.begin(), pairs_.end(), [&](const auto& a, const auto& b) {
    return mesh_.points[3 * a[0] + 1] < mesh_.points[3 * b[0] + 1];
  });
}

void CrackedBeam::solve(const ElasticConstants& elastic) {
  const Structure body(mesh_, elastic, "cracked beam");
  const std::size_t n = body.free_count();
  const std::size_t dofs = body.dof_count();
  // Ties: free dofs of left and right node of each pair, from below; the first tie of each pair.
  std::vector<std::array<int, 2>> ties;
  std::vector<std::size_t> first_tie;
  for (const auto& [left, right] : pairs_) {
    first_tie.push_back(ties.size());
    for (int c = 0; c < 3; ++c) {
      const int a = body.free_index(3 * left + c), b = body.free_index(3 * right + c);
      if (a >= 0 && b >= 0) ties.push_back({a, b});
    }
  }
  const std::size_t m = ties.size();
  const auto jump = [&](std::span<const double> field, std::size_t tie) {
    return field[ties[tie][1]] - field[ties[tie][0]];
  };

  // Flexibility between the ties, A K⁻¹ Aᵀ, and the jumps of the fully cracked solution, in blocks of
  // columns.
  std::vector<double> flexibility(m * m), open_jump(m), open(n);
  for (std::size_t i = 0; i < n; ++i) open[i] = body.unit_lift()[body.free_dofs()[i]];
  for (std::size_t i = 0; i < m; ++i) open_jump[i] = jump(open, i);
  constexpr std::size_t k_block = 32;
  for (std::size_t first = 0; first < m; first += k_block) {
    const std::size_t columns = std::min(k_block, m - first);
    std::vector<double> right(n * columns, 0.0);
    for (std::size_t j = 0; j < columns; ++j) {
      right[n * j + ties[first + j][0]] = -1;
      right[n * j + ties[first + j][1]] = 1;
    }
    body.factor().solve(right, columns);
    for (std::size_t j = 0; j < columns; ++j)
      for (std::size_t i = 0; i < m; ++i)
        flexibility[m * (first + j) + i] = jump(std::span(right).subspan(n * j, n), i);
  }

  solutions_.resize(lengths_.size() * dofs);
  std::vector<double> force(dofs);
  for (Index index = 0; index < std::ssize(lengths_); ++index) {
    // The pair at the tip, and all above it, are closed: A u = 0 there by forces λ, u = u_open - K⁻¹ Aᵀ λ.
    const double tip = corner_ + lengths_[index];
    std::size_t pair = 0;
    while (pair < pairs_.size() && mesh_.points[3 * pairs_[pair][0] + 1] < tip - k_near) ++pair;
    const std::size_t closed = pair < pairs_.size() ? first_tie[pair] : m;
    const std::size_t size = m - closed;
    std::vector<double> system(size * size), lambda(open_jump.begin() + closed, open_jump.end());
    for (std::size_t j = 0; j < size; ++j)
      std::copy_n(&flexibility[m * (closed + j) + closed], size, &system[size * j]);
    if (!solve_positive_definite(system, size, lambda, 1))
      throw NumericalError(
          fmt::format("crack of length {} m: the nodes of the crack line cannot be tied", lengths_[index]));
    std::vector<double> right(n, 0.0);
    for (std::size_t i = 0; i < size; ++i) {
      right[ties[closed + i][0]] -= lambda[i];
      right[ties[closed + i][1]] += lambda[i];
    }
    body.factor().solve(right);
    double* solution = &solutions_[dofs * index];
    for (std::size_t dof = 0; dof < dofs; ++dof) {
      const int free = body.free_index(dof);
      solution[dof] = body.unit_lift()[dof] - (free >= 0 ? right[free] : 0.0);
    }
    body.stiffness().multiply(std::span<const double>(solution, dofs), force);
    stiffness_.push_back(2 *
                         std::inner_product(force.begin(), force.end(), body.unit_prescribed().begin(), 0.0));
  }
}

std::span<const double> CrackedBeam::solution(int index) const {
  const std::size_t dofs = mesh_.points.size();
  return std::span(solutions_).subspan(dofs * index, dofs);
}

CrackedBeam::Place CrackedBeam::locate(const double* point) const {
  // Interval on whose right side of the lower plane the point is; second choice (on a plane): the one before.
  std::array<std::array<std::ptrdiff_t, 2>, 3> choices;
  for (int c = 0; c < 3; ++c) {
    const auto& planes = planes_[c];
    const auto last = std::ssize(planes) - 2;
    const auto from_right =
        std::upper_bound(planes.begin(), planes.end(), point[c] + k_near) - planes.begin() - 1;
    const auto from_left =
        std::upper_bound(planes.begin(), planes.end(), point[c] - k_near) - planes.begin() - 1;
    const bool outside = point[c] < planes.front() - k_near || point[c] > planes.back() + k_near;
    choices[c] = {outside ? -1 : std::clamp<std::ptrdiff_t>(from_right, 0, last),
                  outside ? -1 : std::clamp<std::ptrdiff_t>(from_left, 0, last)};
  }
  for (const auto i : choices[0])
    for (const auto j : choices[1])
      for (const auto k : choices[2]) {
        if (i < 0 || j < 0 || k < 0) continue;
        const auto rows = std::ssize(planes_[1]) - 1, layers = std::ssize(planes_[2]) - 1;
        const std::int64_t cell = cell_at_[(i * rows + j) * layers + k];
        if (cell < 0) continue;
        const double a = (point[0] - planes_[0][i]) / (planes_[0][i + 1] - planes_[0][i]);
        const double b = (point[1] - planes_[1][j]) / (planes_[1][j + 1] - planes_[1][j]);
        const double c = (point[2] - planes_[2][k]) / (planes_[2][k + 1] - planes_[2][k]);
        Place place;
        std::copy_n(&mesh_.cells[8 * cell], 8, place.nodes.begin());
        place.weights = {
            (1 - a) * (1 - b) * (1 - c), a * (1 - b) * (1 - c), a * b * (1 - c), (1 - a) * b * (1 - c),
            (1 - a) * (1 - b) * c,       a * (1 - b) * c,       a * b * c,       (1 - a) * b * c};
        return place;
      }
  throw DataError(fmt::format("crack solutions: the point ({:.6g}, {:.6g}, {:.6g}) m is not in the beam",
                              point[0], point[1], point[2]));
}

std::vector<double> CrackedBeam::interpolate(std::span<const double> points,
                                             std::span<const std::int64_t> components) const {
  const std::size_t n = components.size(), dofs = mesh_.points.size();
  std::vector<double> values(lengths_.size() * n);
  for (std::size_t i = 0; i < n; ++i) {
    const Place place = locate(&points[3 * i]);
    for (Index index = 0; index < std::ssize(lengths_); ++index) {
      double sum = 0;
      for (int a = 0; a < 8; ++a)
        sum += place.weights[a] * solutions_[dofs * index + 3 * place.nodes[a] + components[i]];
      values[index * n + i] = sum;
    }
  }
  return values;
}

}  // namespace knothe::offline
