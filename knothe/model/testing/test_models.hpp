#pragma once
/// @file Manufactured snapshots and models for this room's tests.
#include <cmath>
#include <functional>
#include <random>

#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::model {

/// Random entries, standard normal.
inline std::vector<double> normal_values(std::size_t n, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> values(n);
  for (double& value : values) value = normal(random);
  return values;
}

/// Two parameters on uneven grids.
inline std::vector<Axis> two_axes() {
  return {{"Y0", {0.5, 0.7, 0.9, 1.2, 1.5}, "1", "onset energy", 216.0},
          {"Ad", {0.5, 0.8, 1.0, 1.2, 1.3, 1.5}, "1", "brittleness", 2.25e-3}};
}

/// 2 × 1 × 1 hexahedra on [0, 0.2] × [0, 0.1] × [0, 0.1], sheared so that they are no boxes; every node has
/// three dofs.
inline Mesh small_mesh() {
  Mesh mesh;
  for (const double z : {0.0, 0.1}) {
    for (const double y : {0.0, 0.1}) {
      for (const double x : {0.0, 0.1, 0.2}) {
        mesh.points.insert(mesh.points.end(), {x + 0.1 * y, y + 0.2 * x * z, z + 0.05 * x});
      }
    }
  }
  mesh.cells = {0, 1, 4, 3, 6, 7, 10, 9, 1, 2, 5, 4, 7, 8, 11, 10};
  return mesh;
}

inline Dofs dofs_on(const Mesh& mesh) {
  Dofs dofs;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    for (int component = 0; component < 3; ++component) {
      dofs.points.insert(dofs.points.end(), mesh.points.begin() + 3 * static_cast<std::ptrdiff_t>(i),
                         mesh.points.begin() + 3 * static_cast<std::ptrdiff_t>(i) + 3);
      dofs.components.push_back(component);
    }
  }
  return dofs;
}

/// A field u(dof, t, p) by formula.
using Field = std::function<double(std::size_t dof, double t, std::span<const double> p)>;

inline Snapshots snapshots_of(const Field& field, std::vector<Axis> axes, std::vector<double> time,
                              std::size_t dofs) {
  Snapshots snapshots;
  snapshots.axes = std::move(axes);
  snapshots.time = std::move(time);
  for (std::size_t g = 0; g < snapshots.grid_size(); ++g) {
    const std::vector<double> p = snapshots.parameters_at(g);
    for (const double t : snapshots.time) {
      for (std::size_t dof = 0; dof < dofs; ++dof) snapshots.values.push_back(field(dof, t, p));
    }
  }
  return snapshots;
}

/// n uneven steps.
inline std::vector<double> uneven_steps(std::size_t n) {
  std::vector<double> time;
  for (std::size_t i = 0; i < n; ++i)
    time.push_back(0.1 * static_cast<double>(i + 1) * (1.0 + 0.01 * static_cast<double>(i)));
  return time;
}

/// A front that travels over `dofs` points in x with a speed that depends on the parameters: of no small
/// rank.
inline Field travelling_front(std::size_t dofs) {
  return [dofs](std::size_t dof, double t, std::span<const double> p) {
    const double x = static_cast<double>(dof) / static_cast<double>(dofs);
    return 1e-4 * (t * x + 0.2 / (1 + std::exp(-20 * (t * p[0] - x - 0.3 * p[1]))));
  };
}

/// A random model of either form on `small_mesh`, with an output and crack solutions.
inline ModelContents random_contents(Form form) {
  ModelContents model;
  model.form = form;
  model.axes = two_axes();
  model.time = {0.0, 1.0, 2.5, 3.0};
  model.mesh = small_mesh();
  model.dofs = dofs_on(*model.mesh);
  const std::size_t dofs = model.dofs.components.size();
  model.parameter_modes = 3;
  model.space_modes = form == Form::canonical ? 3 : 5;
  model.space = normal_values(model.space_modes * dofs, 1);
  model.lift = normal_values(4 * dofs, 2);
  if (form == Form::canonical) {
    model.temporal = normal_values(3 * 4, 3);
    model.parameters = {normal_values(3 * 5, 4), normal_values(3 * 6, 5)};
  } else {
    model.temporal = normal_values(4 * 5 * 3, 6);
    model.joint = normal_values(3 * 5 * 6, 7);
  }
  model.outputs = {{"force", {"N", "reaction force"}, normal_values(5 * 6 * 4, 8)}};
  model.crack = {{0.0, 0.001, 0.002}, normal_values(2 * dofs, 9), normal_values(3 * 2, 10)};
  model.project = "[model]\n# Ȳ₀\n";
  model.relative_error = 1.5e-3;
  model.max_error_m = 2e-7;
  return model;
}

}  // namespace knothe::model
