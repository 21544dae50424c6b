#include "knothe/model/observe/observation_operator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <optional>

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

std::optional<Location> locate(const Mesh& mesh, const ReferenceElement& element,
                               const Eigen::Vector3d& point) {
  const Index k = mesh.nodes_per_cell;
  ElementNodes x(3, k);
  for (std::size_t cell = 0; cell < mesh.cell_count(); ++cell) {
    const auto vertices = std::span(mesh.cells).subspan(cell * mesh.nodes_per_cell, mesh.nodes_per_cell);
    for (Index i = 0; i < k; ++i) {
      x.col(i) = Eigen::Map<const Eigen::Vector3d>(mesh.points.data() + 3 * vertices[i]);
    }
    if (auto weights = element.weights_at(x, point, k_match_distance)) {
      return Location{{vertices.begin(), vertices.end()}, std::move(*weights)};
    }
  }
  return std::nullopt;
}

/// "observation 3 (x component at (0.1, 0.2, 0.05))".
std::string describe(std::size_t i, const Eigen::Vector3d& point, std::int64_t component) {
  return fmt::format("observation {} ({} component at ({}, {}, {}))", i, k_component_names[component],
                     point.x(), point.y(), point.z());
}

ReferenceElement element_of(const Mesh& mesh, const std::string& where, const std::string& observation) {
  const auto element = ReferenceElement::named(mesh.type);
  if (!element || element->nodes() != static_cast<Index>(mesh.nodes_per_cell)) {
    throw DataError(fmt::format(
        "{}: {} is at no dof, and there is no interpolation on {} cells with {} nodes: place it at a dof, or "
        "use a mesh of VTK_HEXAHEDRON, VTK_TETRA, VTK_QUAD or VTK_TRIANGLE",
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
    const auto location = locate(*mesh, element_of(*mesh, where, observation), point);
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

}  // namespace knothe::model
