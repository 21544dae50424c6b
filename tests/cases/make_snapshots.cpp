/// @file Snapshots of a solver that is a formula: the cases' stand-in for an offline phase, also where
/// deal.II is not built.
///
/// usage: make_snapshots FOLDER
/// writes FOLDER/snapshots.h5 (docs/reference/formats.md), FOLDER/without_mesh.h5, the same without its mesh,
/// and FOLDER/other_schema.h5, a model file of a schema to come. The formula is written a second time, in
/// Python, in analytic_model.py: the cases' independent answer.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <numbers>
#include <string>
#include <tuple>

#include "knothe/files/hdf5.hpp"
#include "knothe/model/compress/snapshots.hpp"

namespace {

using knothe::model::Mesh;
using knothe::model::Snapshots;

constexpr int k_cells_x = 8, k_cells_y = 2, k_cells_z = 1;
constexpr double k_half_length = 0.12, k_height = 0.1, k_thickness = 0.05;
constexpr int k_nodes = 7;

/// Component `c` of the displacement at (x, y, z), model time t and parameters (y0, ad), metres.
double displacement(int c, double x, double y, double z, double t, double y0, double ad) {
  const double s = x / k_half_length, r = y / k_height;
  const double elastic = c == 0 ? 0.2 * s * (1 - 2 * r) : c == 1 ? s * s - 1 : 0.05 * s * z / k_thickness;
  const double brittle = c == 0 ? std::sin(20 * x) : c == 1 ? std::cos(15 * x) : 0.3;
  const double onset = c == 0 ? std::cos(25 * x + 10 * y) : c == 1 ? std::sin(25 * x + 10 * y) : 0.2;
  const double mixed = r * std::cos(10 * x);
  return 4e-4 * t * elastic + 12e-6 * ad * t * t * brittle +
         8e-6 * std::exp(-y0) * std::sin(std::numbers::pi * t) * onset +
         5e-6 * t * std::exp(-0.5 * y0 * ad) * mixed;
}

double reaction_force(double t, double y0, double ad) {
  return 2000 * t * std::exp(-0.3 * y0 * ad);
}

Mesh make_mesh() {
  Mesh mesh;
  for (int k = 0; k <= k_cells_z; ++k) {
    for (int j = 0; j <= k_cells_y; ++j) {
      for (int i = 0; i <= k_cells_x; ++i) {
        mesh.points.push_back(k_half_length * (2.0 * i / k_cells_x - 1));
        mesh.points.push_back(k_height * j / k_cells_y);
        mesh.points.push_back(k_thickness * k / k_cells_z);
      }
    }
  }
  const auto node = [](int i, int j, int k) { return i + (k_cells_x + 1) * (j + (k_cells_y + 1) * k); };
  for (int k = 0; k < k_cells_z; ++k) {
    for (int j = 0; j < k_cells_y; ++j) {
      for (int i = 0; i < k_cells_x; ++i) {
        for (int up : {0, 1}) {
          for (int vertex : {node(i, j, k + up), node(i + 1, j, k + up), node(i + 1, j + 1, k + up),
                             node(i, j + 1, k + up)}) {
            mesh.cells.push_back(vertex);
          }
        }
      }
    }
  }
  return mesh;
}

Snapshots make_snapshots(int steps) {
  Snapshots s;
  for (const auto& [name, reference, meaning] :
       {std::tuple{"Y0", 216.0, "damage threshold"}, std::tuple{"Ad", 2.25e-3, "brittleness"}}) {
    s.axes.push_back({name, {}, "1", meaning, reference});
    for (int i = 0; i < k_nodes; ++i)
      s.axes.back().nodes.push_back(0.5 + static_cast<double>(i) / (k_nodes - 1));
  }
  for (int i = 1; i <= steps; ++i) s.time.push_back(static_cast<double>(i) / steps);
  s.mesh = make_mesh();
  for (std::size_t n = 0; n < s.mesh->point_count(); ++n) {
    for (int c = 0; c < 3; ++c) {
      s.dofs.points.insert(s.dofs.points.end(), &s.mesh->points[3 * n], &s.mesh->points[3 * n] + 3);
      s.dofs.components.push_back(c);
    }
  }
  s.outputs = {{"imposed_displacement", {"m", "imposed displacement"}, {}},
               {"reaction_force", {"N", "reaction force"}, {}}};
  for (double y0 : s.axes[0].nodes) {
    for (double ad : s.axes[1].nodes) {
      for (double t : s.time) {
        for (std::size_t i = 0; i < s.dofs.components.size(); ++i) {
          const double* p = &s.dofs.points[3 * i];
          s.values.push_back(
              displacement(static_cast<int>(s.dofs.components[i]), p[0], p[1], p[2], t, y0, ad));
        }
        s.outputs[0].values.push_back(4e-4 * t);
        s.outputs[1].values.push_back(reaction_force(t, y0, ad));
      }
    }
  }
  return s;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) return std::fputs("usage: make_snapshots FOLDER [STEPS]\n", stderr), 2;
  const std::string folder = argv[1];
  try {
    Snapshots snapshots = make_snapshots(argc == 3 ? std::atoi(argv[2]) : 12);
    knothe::model::write_snapshots(snapshots, folder + "/snapshots.h5");
    snapshots.mesh.reset();
    knothe::model::write_snapshots(snapshots, folder + "/without_mesh.h5");
    knothe::files::Hdf5Writer other(folder + "/other_schema.h5");
    other.integer_attribute("/", "schema_version", 2);
    other.close();
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "make_snapshots: %s\n", error.what()), 1;
  }
  return 0;
}
