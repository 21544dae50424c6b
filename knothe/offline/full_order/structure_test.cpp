#include "knothe/offline/full_order/structure.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/offline/mesh/beam_mesh.hpp"
#include "knothe/offline/mesh/structured_grid.hpp"

namespace {

using namespace knothe::offline;

/// A unit cube of distorted hexahedra, compressed from above between frictionless plates.
HexahedronMesh distorted_cube() {
  const auto planes = uniform_positions(0, 1, 4);
  HexahedronMesh mesh = structured_grid(planes, planes, planes, [](const auto&) { return true; });
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> shift(-0.06, 0.06);
  for (auto& coordinate : mesh.points)
    if (coordinate > 0.01 && coordinate < 0.99) coordinate += shift(generator);
  mesh.support_left = nodes_where(mesh, [](double x, double y, double) { return x == 0 && y == 0; });
  mesh.left_face = nodes_where(mesh, [](double x, double, double) { return x == 0; });
  mesh.support_right = nodes_where(mesh, [](double, double y, double) { return y == 0; });
  mesh.symmetry = nodes_where(mesh, [](double, double, double z) { return z == 0; });
  mesh.load = nodes_where(mesh, [](double, double y, double) { return y == 1; });
  return mesh;
}

TEST(Structure, passes_the_patch_test_on_distorted_elements) {
  const ElasticConstants elastic;
  for (const auto support : {LeftSupport::support_line, LeftSupport::left_face}) {
    HexahedronMesh mesh = distorted_cube();
    mesh.left_support = support;
    const Structure structure(mesh, elastic, "cube");
    // Uniaxial stress: u = (ν x, -y, ν z) for a unit displacement, reaction E.
    double largest = 0;
    for (std::int64_t node = 0; node < mesh.node_count(); ++node) {
      const double* point = &mesh.points[3 * node];
      const double exact[3] = {elastic.poisson_ratio * point[0], -point[1], elastic.poisson_ratio * point[2]};
      for (int c = 0; c < 3; ++c)
        largest = std::max(largest, std::abs(structure.unit_lift()[3 * node + c] - exact[c]));
    }
    EXPECT_LT(largest, 1e-12);
    EXPECT_NEAR(structure.unit_reaction(), elastic.young_modulus, 1e-11 * elastic.young_modulus);
  }
}

TEST(Structure, stress_of_any_affine_field_is_exact_and_in_equilibrium) {
  const HexahedronMesh mesh = distorted_cube();
  const ElasticConstants elastic;
  const Structure structure(mesh, elastic, "cube");
  const double gradient[3][3] = {{1e-3, -2e-3, 0.5e-3}, {0.7e-3, 3e-3, -1e-3}, {2e-3, 1e-3, -0.4e-3}};
  std::vector<double> u(mesh.points.size()), force(u.size());
  for (std::int64_t node = 0; node < mesh.node_count(); ++node)
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k) u[3 * node + c] += gradient[c][k] * mesh.points[3 * node + k];
  structure.stiffness().multiply(u, force);
  double scale = 0, inner = 0;
  for (std::int64_t node = 0; node < mesh.node_count(); ++node) {
    bool inside = true;
    for (int k = 0; k < 3; ++k)
      inside = inside && mesh.points[3 * node + k] > 0.01 && mesh.points[3 * node + k] < 0.99;
    for (int c = 0; c < 3; ++c) {
      scale = std::max(scale, std::abs(force[3 * node + c]));
      if (inside) inner = std::max(inner, std::abs(force[3 * node + c]));
    }
  }
  EXPECT_LT(inner, 1e-12 * scale);
  const Voigt strain = {gradient[0][0],
                        gradient[1][1],
                        gradient[2][2],
                        gradient[0][1] + gradient[1][0],
                        gradient[1][2] + gradient[2][1],
                        gradient[2][0] + gradient[0][2]};
  const Voigt stress = elastic_stress(strain, elastic.lambda(), elastic.mu());
  double total = 0;
  for (std::size_t i = 1; i < force.size(); i += 3) total += force[i];
  EXPECT_NEAR(total, 0.0, 1e-11 * scale);
  // Virtual work in the field itself: u·K u = σ:ε V.
  double work = 0, exact = 0;
  for (std::size_t i = 0; i < u.size(); ++i) work += u[i] * force[i];
  for (int i = 0; i < 6; ++i) exact += stress[i] * strain[i];
  EXPECT_NEAR(work, exact, 1e-11 * exact);
}

TEST(Structure, bends_as_beam_theory_says) {
  // Between load and support the bending moment is F/2 (a - |x|), so the deflection's second difference over
  // equal distances δ is δ² M(x)/(E I), whatever the shear, the rigid rotation and what happens under load
  // and supports.
  BeamOptions options;
  options.notch_depth = 0;
  options.element = 0.01;
  options.largest_element = 0.01;
  const Structure structure(beam_mesh(options), {}, "beam");
  const double wanted[3] = {0.15, 0.2, 0.25};
  double deflection[3], position[3];
  const auto& mesh = structure.mesh();
  for (int k = 0; k < 3; ++k) {
    double nearest = 1;
    for (std::int64_t node = 0; node < mesh.node_count(); ++node) {
      const double* point = &mesh.points[3 * node];
      if (std::abs(point[1] - 0.05) > 1e-9 || point[2] > 1e-9 || std::abs(point[0] - wanted[k]) > nearest)
        continue;
      nearest = std::abs(point[0] - wanted[k]);
      position[k] = point[0];
      deflection[k] = structure.unit_lift()[3 * node + 1];
    }
  }
  // Divided difference: w[x0,x1,x2] = w''/2 at the mean position, exact for a cubic.
  const double divided = ((deflection[2] - deflection[1]) / (position[2] - position[1]) -
                          (deflection[1] - deflection[0]) / (position[1] - position[0])) /
                         (position[2] - position[0]);
  const double mean = (position[0] + position[1] + position[2]) / 3;
  const double moment = structure.unit_reaction() / 2 * (0.4 - mean);
  const double inertia = 0.05 * std::pow(0.1, 3) / 12;
  EXPECT_NEAR(2 * divided, moment / (30e9 * inertia), 0.01 * moment / (30e9 * inertia));
}

TEST(Structure, stiffness_of_the_papers_mesh_is_near_the_converged_one) {
  // Elements of half and a quarter of the size everywhere: the differences fall, and Richardson's
  // extrapolation from the two finest is the reference.
  double stiffness[3];
  for (int k = 0; k < 3; ++k) {
    BeamOptions options;
    options.element = 0.01 / std::pow(2, k);
    options.largest_element = 0.025 / std::pow(2, k);
    options.notch_width = 0.01;  // the same notch for all
    options.load_half_width = 0.005;
    stiffness[k] = Structure(beam_mesh(options), {}, "beam").unit_reaction();
  }
  EXPECT_GT(stiffness[0], stiffness[1]);
  EXPECT_GT(stiffness[1], stiffness[2]);
  EXPECT_GT(stiffness[0] - stiffness[1], 1.5 * (stiffness[1] - stiffness[2]));
  const double ratio = (stiffness[0] - stiffness[1]) / (stiffness[1] - stiffness[2]);
  const double converged = stiffness[2] - (stiffness[1] - stiffness[2]) / (ratio - 1);
  EXPECT_NEAR(stiffness[1], converged, 0.04 * converged);
}

TEST(Structure, a_body_that_is_not_held_is_refused) {
  HexahedronMesh mesh = distorted_cube();
  mesh.support_left = {};
  EXPECT_NE(knothe::files::message_of<knothe::DataError>([&] {
              Structure(mesh, {}, "cube");
            }).find("\"support_left\""),
            std::string::npos);
  // It may turn about the vertical axis through the corner that is held.
  mesh = distorted_cube();
  mesh.support_left = mesh.symmetry =
      nodes_where(mesh, [](double x, double y, double z) { return x == 0 && y == 0 && z == 0; });
  EXPECT_NE(knothe::files::message_of<knothe::NumericalError>([&] {
              Structure(mesh, {}, "cube");
            }).find("some part of the body can move freely"),
            std::string::npos);
  // A second cube that touches nothing.
  mesh = distorted_cube();
  const auto nodes = mesh.node_count(), cells = mesh.cell_count();
  for (std::int64_t i = 0; i < 3 * nodes; ++i)
    mesh.points.push_back(mesh.points[i] + (i % 3 == 0 ? 5.0 : 0.0));
  for (std::int64_t i = 0; i < 8 * cells; ++i) mesh.cells.push_back(mesh.cells[i] + nodes);
  mesh.elastic.resize(2 * cells, 0);
  EXPECT_NE(knothe::files::message_of<knothe::DataError>([&] {
              Structure(mesh, {}, "cube");
            }).find("cube: the mesh is in 2 parts that share no face: element "),
            std::string::npos);
}

}  // namespace
