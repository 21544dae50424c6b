#include "knothe/offline/full_order/crack_solutions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/offline/full_order/structure.hpp"

namespace {

using namespace knothe::offline;
using knothe::files::message_of;

constexpr double k_corner = 0.02;  // y of the notch's corner

/// Crack every 2 mm; solved once for all tests.
const CrackedBeam& cracked_beam() {
  static const CrackedBeam beam({}, {.count = 40, .spacing = 0.002}, {});
  return beam;
}

/// The mesh whose nodes on the crack line are really twins below the tip, and really one from the tip on.
HexahedronMesh really_cracked(double length, std::vector<std::int64_t>& new_number) {
  HexahedronMesh mesh = cracked_beam().mesh();
  std::map<std::array<double, 3>, std::int64_t> seen;
  std::vector<double> points;
  new_number.clear();
  for (std::int64_t node = 0; node < mesh.node_count(); ++node) {
    const std::array<double, 3> point = {mesh.points[3 * node], mesh.points[3 * node + 1],
                                         mesh.points[3 * node + 2]};
    const auto [place, fresh] = seen.try_emplace(point, static_cast<std::int64_t>(points.size() / 3));
    const bool open = point[1] < k_corner + length - 1e-9;
    if (!fresh && !open) {
      new_number.push_back(place->second);
      continue;
    }
    new_number.push_back(static_cast<std::int64_t>(points.size() / 3));
    points.insert(points.end(), point.begin(), point.end());
  }
  mesh.points = points;
  for (auto& node : mesh.cells) node = new_number[node];
  for (NodeSet* set :
       {&mesh.support_left, &mesh.support_right, &mesh.load, &mesh.symmetry, &mesh.left_face}) {
    for (auto& node : *set) node = new_number[node];
  }
  return mesh;
}

TEST(CrackedBeam, agrees_with_meshes_whose_nodes_are_really_doubled) {
  for (const int index : {0, 1, 13, 39}) {
    std::vector<std::int64_t> new_number;
    const double length = cracked_beam().lengths()[index];
    const Structure structure(really_cracked(length, new_number), {}, "cracked");
    EXPECT_NEAR(cracked_beam().stiffness()[index], 2 * structure.unit_reaction(),
                1e-8 * 2 * structure.unit_reaction());
    const auto solution = cracked_beam().solution(index);
    double largest = 0;
    for (std::size_t node = 0; node < new_number.size(); ++node)
      for (int c = 0; c < 3; ++c)
        largest = std::max(
            largest, std::abs(solution[3 * node + c] - structure.unit_lift()[3 * new_number[node] + c]));
    EXPECT_LT(largest, 1e-8) << "length " << length;
  }
}

TEST(CrackedBeam, without_a_crack_is_the_uncracked_beam) {
  std::vector<std::int64_t> new_number;
  const HexahedronMesh mesh = really_cracked(0, new_number);
  std::map<std::array<double, 3>, int> points;
  for (std::int64_t node = 0; node < mesh.node_count(); ++node)
    EXPECT_EQ((++points[{mesh.points[3 * node], mesh.points[3 * node + 1], mesh.points[3 * node + 2]}]), 1);
  // The coarser mesh of the full-order model is a little stiffer.
  const double full_order = 2 * Structure(beam_mesh({}), {}, "beam").unit_reaction();
  EXPECT_LT(cracked_beam().stiffness()[0], full_order);
  EXPECT_GT(cracked_beam().stiffness()[0], 0.97 * full_order);
}

TEST(CrackedBeam, grows_more_compliant_and_releases_energy) {
  const auto k = cracked_beam().stiffness();
  for (std::size_t i = 1; i < k.size(); ++i) EXPECT_LT(k[i], k[i - 1]) << i;
  EXPECT_LT(k.back(), 0.05 * k[0]);
}

TEST(CrackedBeam, energy_release_rate_agrees_with_linear_fracture_mechanics) {
  // G = -(u²/2b) dk/da per unit width, K_I = Y 6 M √a / (b W²) with Brown and Srawley's Y for three-point
  // bending at a span of 8 W (1966); a = notch + crack. Plane strain inside, plane stress at the faces: G =
  // K²/E … K² (1 - ν²)/E.
  const auto k = cracked_beam().stiffness();
  const ElasticConstants elastic;
  for (const int index : {5, 10, 15}) {
    const double force = k[index];  // unit displacement
    const double release = -(k[index + 1] - k[index - 1]) / (2 * 0.002) / 2 / 0.1;
    const double a = k_corner + cracked_beam().lengths()[index], x = a / 0.1;
    const double shape = 1.96 + x * (-2.75 + x * (13.66 + x * (-23.98 + x * 25.22)));
    const double intensity = shape * 6 * (force * 0.8 / 4) * std::sqrt(a) / (0.1 * 0.01);
    const double expected = intensity * intensity / elastic.young_modulus;
    EXPECT_GT(release, 0.85 * expected) << index;
    EXPECT_LT(release, 1.1 * expected) << index;
  }
}

TEST(CrackedBeam, interpolation_is_exact_at_nodes_and_takes_the_right_flank) {
  const auto& mesh = cracked_beam().mesh();
  const int index = 20;
  const auto solution = cracked_beam().solution(index);
  const auto values =
      cracked_beam().interpolate(mesh.points, std::vector<std::int64_t>(mesh.node_count(), 0));
  // The last node at a place is the right one of a pair.
  std::map<std::array<double, 3>, double> right;
  for (std::int64_t node = 0; node < mesh.node_count(); ++node)
    right[{mesh.points[3 * node], mesh.points[3 * node + 1], mesh.points[3 * node + 2]}] = solution[3 * node];
  const auto n = static_cast<std::size_t>(mesh.node_count());
  for (std::size_t node = 0; node < n; ++node)
    EXPECT_NEAR(values[index * n + node],
                (right[{mesh.points[3 * node], mesh.points[3 * node + 1], mesh.points[3 * node + 2]}]),
                1e-13);
  // The flanks open: right of the line u_x is larger than left of it.
  const double just_left = cracked_beam().line() - 1e-5, just_right = cracked_beam().line() + 1e-5;
  const auto flanks =
      cracked_beam().interpolate(std::vector<double>{just_left, 0.021, 0.05, just_right, 0.021, 0.05,
                                                     cracked_beam().line(), 0.021, 0.05},
                                 std::vector<std::int64_t>{0, 0, 0});
  EXPECT_GT(flanks[3 * index + 1], flanks[3 * index] + 0.05);
  EXPECT_NEAR(flanks[3 * index + 2], flanks[3 * index + 1], 1e-3);
}

TEST(CrackedBeam, serves_every_node_of_the_full_order_mesh) {
  for (const double element : {0.005, 0.01}) {
    BeamOptions options;
    options.element = element;
    const CrackedBeam beam(options, {.count = 5, .spacing = 0.01}, {});
    const HexahedronMesh mesh = beam_mesh(options);
    std::vector<std::int64_t> components(mesh.node_count(), 1);
    const auto values = beam.interpolate(mesh.points, components);
    EXPECT_EQ(values.size(), 5u * components.size());
    for (const auto node : mesh.load) EXPECT_NEAR(values[node], -1.0, 1e-9);
    for (const auto node : mesh.support_right) EXPECT_NEAR(values[node], 0.0, 1e-12);
  }
}

TEST(CrackedBeam, points_outside_and_senseless_options_are_refused_with_the_reason) {
  const std::vector<std::int64_t> x = {0};
  const auto refused = [&](const std::vector<double>& point) {
    return message_of<knothe::DataError>([&] { (void)cracked_beam().interpolate(point, x); });
  };
  EXPECT_NE(refused({0.5, 0.05, 0.0}).find("(0.5, 0.05, 0) m is not in the beam"), std::string::npos);
  EXPECT_NE(refused({0.0, 0.01, 0.0}).find("not in the beam"), std::string::npos);  // in the notch
  EXPECT_EQ(refused({0.0, 0.03, 0.0}), "");
  const auto options = [](CrackedBeamOptions crack) {
    return message_of<knothe::ProjectError>([&] { CrackedBeam({}, crack, {}); });
  };
  EXPECT_NE(options({.count = 81}).find("at most 80 lengths"), std::string::npos);
  EXPECT_NE(options({.count = 1}).find("at least two"), std::string::npos);
  EXPECT_NE(options({.count = 4, .spacing = 0.003}).find("does not divide"), std::string::npos);
}

}  // namespace
