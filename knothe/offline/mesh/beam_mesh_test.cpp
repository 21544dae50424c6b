#include "knothe/offline/mesh/beam_mesh.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/offline/full_order/finite_elements.hpp"
#include "knothe/offline/mesh/structured_grid.hpp"

namespace {

using namespace knothe::offline;
using knothe::files::message_of;

double volume(const HexahedronMesh& mesh) {
  const auto elements = evaluate_finite_elements(mesh.points, mesh.cells);
  return std::accumulate(elements.weights.begin(), elements.weights.end(), 0.0);
}

TEST(BeamMesh, default_is_the_papers_case) {
  const HexahedronMesh mesh = beam_mesh({});
  EXPECT_EQ(3 * mesh.node_count(), 7560);
  EXPECT_NEAR(volume(mesh), 0.84 * 0.1 * 0.05 - 0.005 * 0.02 * 0.05, 1e-15);
  int damageable = 0, fine = 0;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    const auto centre = mesh.cell_centre(cell);
    const bool inside = std::abs(centre[0]) < 0.0525;
    const bool under_load = centre[1] > 0.095 && std::abs(centre[0]) < 0.0125;
    EXPECT_EQ(mesh.elastic[cell] == 0, inside && !under_load);
    EXPECT_FALSE(std::abs(centre[0]) < 0.0025 && centre[1] < 0.02) << "a cell in the notch";
    damageable += mesh.elastic[cell] == 0 ? 1 : 0;
    if (!inside) continue;
    ++fine;
    const auto* nodes = &mesh.cells[8 * cell];
    EXPECT_NEAR(mesh.points[3 * nodes[1]] - mesh.points[3 * nodes[0]], 0.005, 1e-12);
    EXPECT_NEAR(mesh.points[3 * nodes[3] + 1] - mesh.points[3 * nodes[0] + 1], 0.005, 1e-12);
  }
  EXPECT_EQ(fine, 21 * 20 - 4);
  EXPECT_EQ(damageable, 21 * 20 - 4 - 5);
  ASSERT_EQ(mesh.support_left.size(), 2u);
  EXPECT_NEAR(mesh.points[3 * mesh.support_left[0]], -0.4, 1e-15);
  EXPECT_EQ(mesh.support_right.size(), 2u);
  EXPECT_EQ(mesh.load.size(), 8u);  // x = ±2.5 and ±7.5 mm
  EXPECT_EQ(mesh.symmetry.size(), mesh.points.size() / 6);
  EXPECT_NEAR(mesh.points[3 * mesh.mouth_left], -0.0025, 1e-15);
  EXPECT_NEAR(mesh.points[3 * mesh.mouth_right], 0.0025, 1e-15);
  EXPECT_NEAR(mesh.points[3 * mesh.mouth_right + 2], 0.05, 1e-15);
  EXPECT_EQ(mesh.points[3 * mesh.mouth_right + 1], 0.0);
}

TEST(BeamMesh, other_element_sizes_keep_notch_supports_and_load) {
  for (const double element : {0.02, 0.01, 0.0025}) {
    BeamOptions options;
    options.element = element;
    options.layers = 2;
    const HexahedronMesh mesh = beam_mesh(options);
    const double notch = std::max(0.005, element);
    EXPECT_NEAR(volume(mesh), 0.05 * (0.84 * 0.1 - notch * 0.02), 1e-14) << element;
    EXPECT_EQ(mesh.support_left.size(), 3u);
    EXPECT_GE(mesh.load.size(), 6u);
    EXPECT_NEAR(mesh.points[3 * mesh.mouth_right], notch / 2, 1e-12);
  }
  BeamOptions plain;
  plain.notch_depth = 0;
  EXPECT_NEAR(volume(beam_mesh(plain)), 0.84 * 0.1 * 0.05, 1e-14);
}

TEST(BeamMesh, the_papers_left_boundary_is_the_whole_face) {
  BeamOptions options;
  options.left_support = LeftSupport::left_face;
  const HexahedronMesh mesh = beam_mesh(options);
  EXPECT_EQ(mesh.left_support, LeftSupport::left_face);
  EXPECT_EQ(mesh.left_face.size(), 21u * 2u);
}

TEST(BeamMesh, senseless_options_are_refused_with_the_reason) {
  const auto refused = [](auto change) {
    BeamOptions options;
    change(options);
    return message_of<knothe::ProjectError>([&] { (void)beam_mesh(options); });
  };
  EXPECT_NE(refused([](auto& o) { o.element = 0.05; }).find("at least four elements"), std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.element = -1; }).find("element is -1; it must be positive"),
            std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.element = 1e-5; }).find("more than 400"), std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.layers = 0; }).find("layers is 0"), std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.notch_depth = 0.095; }).find("notch_depth is 0.095"), std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.support = 0.5; }).find("the beam ends at 0.42"), std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.load_half_width = 0.1; }).find("load_half_width is 0.1"),
            std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.refined_half_width = 0.4; }).find("refined_half_width"),
            std::string::npos);
}

TEST(GradedPositions, end_exactly_and_grow_by_at_most_the_ratio) {
  for (const auto& [from, to] : {std::pair{0.0525, 0.4}, std::pair{0.02, 0.0}, std::pair{0.0, 0.001}}) {
    const auto x = graded_positions(from, to, 0.005, 1.2, 0.025);
    EXPECT_EQ(x.front(), from);
    EXPECT_EQ(x.back(), to);
    for (std::size_t i = 2; i < x.size(); ++i)
      EXPECT_LT((x[i] - x[i - 1]) / (x[i - 1] - x[i - 2]), 1.2 + 1e-9);
  }
}

TEST(HexahedronMesh, faulty_cells_are_named) {
  HexahedronMesh mesh = beam_mesh({});
  EXPECT_NO_THROW(validate(mesh, "beam"));
  HexahedronMesh inverted = mesh;
  std::swap(inverted.cells[8 * 7 + 0], inverted.cells[8 * 7 + 4]);
  std::swap(inverted.cells[8 * 7 + 1], inverted.cells[8 * 7 + 5]);
  std::swap(inverted.cells[8 * 7 + 2], inverted.cells[8 * 7 + 6]);
  std::swap(inverted.cells[8 * 7 + 3], inverted.cells[8 * 7 + 7]);
  EXPECT_NE(message_of<knothe::DataError>([&] { validate(inverted, "beam"); }).find("element 7 (centre"),
            std::string::npos);
  HexahedronMesh flat = mesh;
  flat.cells[8 * 9 + 1] = flat.cells[8 * 9 + 0];
  EXPECT_NE(message_of<knothe::DataError>([&] { validate(flat, "beam"); }).find("element 9"),
            std::string::npos);
  // The elements to the right of the ligament get nodes of their own where they meet the others: two halves.
  HexahedronMesh halves = mesh;
  std::set<std::int64_t> left;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell)
    if (mesh.cell_centre(cell)[0] < 0.005)
      left.insert(&mesh.cells[static_cast<std::size_t>(8 * cell)],
                  &mesh.cells[static_cast<std::size_t>(8 * cell)] + 8);
  std::map<std::int64_t, std::int64_t> copies;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    if (mesh.cell_centre(cell)[0] < 0.005) continue;
    for (int a = 0; a < 8; ++a) {
      std::int64_t& node = halves.cells[static_cast<std::size_t>(8 * cell + a)];
      if (!left.contains(node)) continue;
      const auto [copy, fresh] = copies.emplace(node, halves.node_count());
      if (fresh)
        for (int c = 0; c < 3; ++c)
          halves.points.push_back(mesh.points[static_cast<std::size_t>(3 * node + c)]);
      node = copy->second;
    }
  }
  const std::string parts = message_of<knothe::DataError>([&] { validate(halves, "beam"); });
  EXPECT_NE(parts.find("beam: the mesh is in 2 parts that share no face: element "), std::string::npos)
      << parts;
  HexahedronMesh loose = mesh;
  loose.points.insert(loose.points.end(), {1.0, 1.0, 1.0});
  EXPECT_NE(message_of<knothe::DataError>([&] { validate(loose, "beam"); }).find("node 2520"),
            std::string::npos);
}

}  // namespace
