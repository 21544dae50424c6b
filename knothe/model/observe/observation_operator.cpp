#include "knothe/model/observe/observation_operator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/observe/shape_functions.hpp"

namespace knothe::model {

namespace {

constexpr double k_match_distance = 1e-6;  // metres (docs/reference/formats.md)
constexpr std::array<const char*, 3> k_component_names = {"x", "y", "z"};

/// Finds dofs by point and component; sorted by x, so that a search looks at a thin slice only.
class DofFinder {
 public:
  explicit DofFinder(const Dofs& dofs) : dofs_(dofs), by_x_(dofs.components.size()) {
    std::iota(by_x_.begin(), by_x_.end(), std::size_t{0});
    std::stable_sort(by_x_.begin(), by_x_.end(), [&](std::size_t a, std::size_t b) { return x(a) < x(b); });
  }

  [[nodiscard]] std::optional<std::size_t> at(const Eigen::Vector3d& point, std::int64_t component) const {
    auto first = std::lower_bound(by_x_.begin(), by_x_.end(), point.x() - k_match_distance,
                                  [&](std::size_t dof, double value) { return x(dof) < value; });
    std::optional<std::size_t> best;
    double least = k_match_distance;
    for (; first != by_x_.end() && x(*first) <= point.x() + k_match_distance; ++first) {
      const double distance = (this->point(*first) - point).norm();
      if (dofs_.components[*first] == component && distance <= least) {
        best = *first;
        least = distance;
      }
    }
    return best;
  }

  /// For messages: the nearest dof of that component and its distance in metres.
  [[nodiscard]] std::string nearest(const Eigen::Vector3d& target, std::int64_t component) const {
    double least = std::numeric_limits<double>::infinity();
    std::size_t best = 0;
    for (Index dof = 0; dof < std::ssize(dofs_.components); ++dof) {
      const double distance = (point(dof) - target).norm();
      if (dofs_.components[dof] == component && distance < least) {
        least = distance;
        best = dof;
      }
    }
    if (least == std::numeric_limits<double>::infinity()) return "the model has no dof of that component";
    const Eigen::Vector3d p = point(best);
    return fmt::format("the nearest dof of that component is {} at ({}, {}, {}), {:.3g} m away", best, p.x(),
                       p.y(), p.z(), least);
  }

 private:
  [[nodiscard]] double x(std::size_t dof) const { return dofs_.points[3 * dof]; }
  [[nodiscard]] Eigen::Vector3d point(std::size_t dof) const {
    return Eigen::Map<const Eigen::Vector3d>(dofs_.points.data() + 3 * dof);
  }

  const Dofs& dofs_;
  std::vector<std::size_t> by_x_;
};

/// A cell that holds a point, with its vertices' weights there.
struct Location {
  std::vector<std::int64_t> vertices;
  Eigen::VectorXd weights;
};

/// Finds the cell of a point; the cells' boxes are sorted by their least x, so that a search looks at a thin
/// slice only.
class CellFinder {
 public:
  CellFinder(const Mesh& mesh, const ReferenceElement& element) : mesh_(mesh), element_(element) {
    for (Index cell = 0; cell < mesh_.cell_count(); ++cell) {
      const ElementNodes x = nodes_of(cell);
      const double low = x.row(0).minCoeff(), extent = x.row(0).maxCoeff() - low;
      // A curved edge reaches beyond its nodes.
      cells_.push_back({low - 0.25 * extent, cell});
      widest_ = std::max(widest_, 1.5 * extent);
    }
    std::sort(cells_.begin(), cells_.end());
  }

  /// The first cell that holds the point.
  [[nodiscard]] std::optional<Location> locate(const Eigen::Vector3d& point) const {
    std::optional<Location> found;
    Index first = std::ssize(cells_);
    auto it = std::lower_bound(cells_.begin(), cells_.end(),
                               std::pair(point.x() - widest_ - k_match_distance, Index{0}));
    for (; it != cells_.end() && it->first <= point.x() + k_match_distance; ++it) {
      if (it->second >= first) continue;
      if (auto weights = element_.weights_at(nodes_of(it->second), point, k_match_distance)) {
        first = it->second;
        const auto vertices = vertices_of(first);
        found = Location{{vertices.begin(), vertices.end()}, std::move(*weights)};
      }
    }
    return found;
  }

 private:
  [[nodiscard]] std::span<const std::int64_t> vertices_of(Index cell) const {
    return std::span(mesh_.cells).subspan(cell * mesh_.nodes_per_cell, mesh_.nodes_per_cell);
  }
  [[nodiscard]] ElementNodes nodes_of(Index cell) const {
    ElementNodes x(3, mesh_.nodes_per_cell);
    for (Index i = 0; const std::int64_t vertex : vertices_of(cell))
      x.col(i++) = Eigen::Map<const Eigen::Vector3d>(mesh_.points.data() + 3 * vertex);
    return x;
  }

  const Mesh& mesh_;
  ReferenceElement element_;
  std::vector<std::pair<double, Index>> cells_;  ///< least x, cell
  double widest_ = 0;
};

/// "observation 3 (x component at (0.1, 0.2, 0.05))".
std::string describe(std::size_t i, const Eigen::Vector3d& point, std::int64_t component) {
  return fmt::format("observation {} ({} component at ({}, {}, {}))", i, k_component_names[component],
                     point.x(), point.y(), point.z());
}

/// Nothing for a type of cells that values are not interpolated on.
std::optional<ReferenceElement> element_of(const Mesh& mesh) {
  const auto element = ReferenceElement::named(mesh.type);
  const Index nodes = mesh.nodes_per_cell;
  return element && element->nodes() == nodes ? element : std::nullopt;
}

ReferenceElement element_of(const Mesh& mesh, const std::string& where, const std::string& observation) {
  const auto element = element_of(mesh);
  if (!element) {
    throw DataError(fmt::format(
        "{}: {} is at no dof, and there is no interpolation on {} cells with {} nodes: place it at a dof, or "
        "use a mesh of hexahedra, tetrahedra, quadrilaterals or triangles, linear or quadratic",
        where, observation, mesh.type, mesh.nodes_per_cell));
  }
  return *element;
}

}  // namespace

ObservationOperator::ObservationOperator(const Dofs& dofs, const std::optional<Mesh>& mesh,
                                         const std::string& where, const Dofs& places) {
  const auto& [points, components] = places;
  if (points.size() != 3 * components.size()) {
    throw DataError(fmt::format("{}: {} coordinates for {} observations: 3 each are needed", where,
                                points.size(), components.size()));
  }
  if (components.empty()) return;
  if (dofs.empty()) {
    throw DataError(fmt::format("{}: the model has no /dofs: it cannot be observed at points", where));
  }
  const DofFinder finder(dofs);
  std::optional<CellFinder> cells;
  for (Index i = 0; i < std::ssize(components); ++i) {
    const std::int64_t component = components[i];
    if (component < 0 || component > 2) {
      throw DataError(fmt::format("{}: observation {} has component {}: 0 (x), 1 (y) or 2 (z) is needed",
                                  where, i, component));
    }
    const Eigen::Vector3d point = Eigen::Map<const Eigen::Vector3d>(points.data() + 3 * i);
    const std::string observation = describe(i, point, component);
    if (!point.allFinite())
      throw DataError(fmt::format("{}: {} is not at a finite point", where, observation));
    if (const auto dof = finder.at(point, component)) {
      rows_.push_back({{*dof, 1.0}});
      continue;
    }
    if (!mesh) {
      throw DataError(fmt::format("{}: {} is at no dof, and the model has no mesh to interpolate on; {}",
                                  where, observation, finder.nearest(point, component)));
    }
    if (!cells) cells.emplace(*mesh, element_of(*mesh, where, observation));
    const auto location = cells->locate(point);
    if (!location) {
      throw DataError(fmt::format("{}: {} is outside the mesh; {}", where, observation,
                                  finder.nearest(point, component)));
    }
    auto& row = rows_.emplace_back();
    for (Index k = 0; k < std::ssize(location->vertices); ++k) {
      const double weight = location->weights[k];
      if (weight == 0.0) continue;
      const std::int64_t vertex = location->vertices[k];
      const auto dof =
          finder.at(Eigen::Map<const Eigen::Vector3d>(mesh->points.data() + 3 * vertex), component);
      if (!dof) {
        throw DataError(fmt::format("{}: {} lies in a cell whose mesh point {} has no dof of that component",
                                    where, observation, vertex));
      }
      row.push_back({*dof, weight});
    }
  }
}

ObservationOperator::ObservationOperator(std::span<const std::size_t> dofs) {
  for (const std::size_t dof : dofs) rows_.push_back({{dof, 1.0}});
}

Eigen::MatrixXd ObservationOperator::apply(const Eigen::Ref<const Eigen::MatrixXd>& fields) const {
  Eigen::MatrixXd observed = Eigen::MatrixXd::Zero(rows(), fields.cols());
  for (Index i = 0; i < rows(); ++i) {
    for (const Entry& entry : rows_[i]) {
      observed.row(i) += entry.weight * fields.row(entry.dof);
    }
  }
  return observed;
}

std::vector<bool> are_inside(const Mesh& mesh, std::span<const double> points) {
  const Index n = std::ssize(points) / 3;
  const auto element = element_of(mesh);
  if (!element) return std::vector<bool>(n, true);
  const CellFinder cells(mesh, *element);
  std::vector<bool> inside(n);
  for (Index i = 0; i < n; ++i)
    inside[i] = cells.locate(Eigen::Map<const Eigen::Vector3d>(points.data() + 3 * i)).has_value();
  return inside;
}

}  // namespace knothe::model
