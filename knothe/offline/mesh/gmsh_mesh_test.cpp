#include "knothe/offline/mesh/gmsh_mesh.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/offline/full_order/structure.hpp"

namespace {

using namespace knothe::offline;
using knothe::files::message_of;

// Made by Gmsh from testdata/beam.geo.
const std::string k_folder = std::string(KNOTHE_OFFLINE_FOLDER) + "/testdata/";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto place = text.find(from);
  EXPECT_NE(place, std::string::npos) << from;
  return text.replace(place, from.size(), to);
}
/// What reading a mesh of that text says.
std::string refusal(const std::string& text, LeftSupport left_support = LeftSupport::support_line) {
  const knothe::files::TestFolder folder;
  knothe::files::write_text_atomically(folder.file("mesh.msh"), text);
  return message_of<knothe::DataError>([&] { (void)read_gmsh_mesh(folder.file("mesh.msh"), left_support); });
}

class GmshMesh : public ::testing::TestWithParam<std::string> {};

TEST_P(GmshMesh, has_the_beams_cells_groups_and_volume) {
  const HexahedronMesh mesh = read_gmsh_mesh(k_folder + GetParam());
  EXPECT_EQ(mesh.cell_count(), 29 * 10 - 2);
  EXPECT_EQ(mesh.node_count(), 660);
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    const auto centre = mesh.cell_centre(cell);
    const bool protected_place = centre[1] > 0.09 && std::abs(centre[0]) < 0.015;
    EXPECT_EQ(mesh.elastic[cell] != 0, std::abs(centre[0]) > 0.055 || protected_place) << mesh.names[cell];
  }
  EXPECT_EQ(mesh.support_left.size(), 2u);
  EXPECT_EQ(mesh.support_right.size(), 2u);
  EXPECT_EQ(mesh.load.size(), 4u);
  EXPECT_EQ(mesh.symmetry.size(), 330u);
  EXPECT_EQ(mesh.left_face.size(), 22u);
  for (const auto node : mesh.support_right) EXPECT_NEAR(mesh.points[3 * node], 0.4, 1e-9);
  for (const auto node : mesh.load) EXPECT_NEAR(mesh.points[3 * node + 1], 0.1, 1e-9);
  EXPECT_NEAR(mesh.points[3 * mesh.mouth_left], -0.005, 1e-9);
  const Structure structure(mesh, {}, GetParam());
  const auto& weights = structure.elements().weights;
  EXPECT_NEAR(std::accumulate(weights.begin(), weights.end(), 0.0), 0.05 * (0.84 * 0.1 - 0.01 * 0.02), 1e-12);
}

TEST(GmshMesh, the_opening_is_measured_where_the_group_crack_mouth_says) {
  const std::string path =
      std::string(KNOTHE_OFFLINE_FOLDER) + "/../../examples/half_notched/half_notched.msh";
  const HexahedronMesh mesh = read_gmsh_mesh(path);
  for (const auto& [node, x] : {std::pair(mesh.mouth_left, -0.01), std::pair(mesh.mouth_right, 0.01)}) {
    EXPECT_NEAR(mesh.points[3 * node], x, 1e-12);
    EXPECT_EQ(mesh.points[3 * node + 1], 0);
    EXPECT_NEAR(mesh.points[3 * node + 2], 0.025, 1e-12);
  }
  // One of the two points in a group without a name.
  EXPECT_NE(
      refusal(replaced(knothe::files::read_text(path), " 15 2 7 7 ", " 15 2 9 9 "))
          .find("the physical group \"crack_mouth\" has 1 point(s) of the mesh: it takes two, one on either "
                "side of the crack"),
      std::string::npos);
}

INSTANTIATE_TEST_SUITE_P(Formats, GmshMesh, ::testing::Values("beam22.msh", "beam41.msh"),
                         [](const auto& format) { return format.param.substr(0, 6); });

TEST(GmshMesh, both_formats_give_the_same_body) {
  const Structure a(read_gmsh_mesh(k_folder + "beam22.msh"), {}, "2.2");
  const Structure b(read_gmsh_mesh(k_folder + "beam41.msh"), {}, "4.1");
  EXPECT_NEAR(a.unit_reaction(), b.unit_reaction(), 1e-9 * a.unit_reaction());
}

TEST(GmshMesh, a_missing_group_is_named_with_those_that_are_there) {
  for (const std::string file : {"beam22.msh", "beam41.msh"}) {
    const std::string text = knothe::files::read_text(k_folder + file);
    for (const std::string group : {"elastic", "support_left", "support_right", "load", "symmetry"}) {
      const std::string message = refusal(replaced(text, '"' + group + '"', "\"" + group + "s\""));
      EXPECT_NE(message.find("group \"" + group + "\" is missing"), std::string::npos) << message;
      EXPECT_NE(message.find(group + "s"), std::string::npos) << message;
    }
    const std::string unnamed_face = replaced(text, "\"left_face\"", "\"left\"");
    EXPECT_EQ(refusal(unnamed_face), "");
    EXPECT_NE(refusal(unnamed_face, LeftSupport::left_face).find("\"left_face\" is missing"),
              std::string::npos);
  }
}

/// One cube in format 2.2; enough for messages about cells.
std::string cube(const std::string& hexahedron) {
  return "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 1 "
         "\"elastic\"\n$EndPhysicalNames\n$Nodes\n8\n"
         "1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n5 0 0 1\n6 1 0 1\n7 1 1 1\n8 0 1 1\n$EndNodes\n$Elements\n1\n" +
         hexahedron + "\n$EndElements\n";
}

TEST(GmshMesh, faulty_files_are_refused_with_the_reason) {
  EXPECT_NE(
      message_of<knothe::DataError>([] { (void)read_gmsh_mesh("/nowhere/beam.msh"); }).find("No such file"),
      std::string::npos);
  EXPECT_NE(refusal("").find("empty"), std::string::npos);
  EXPECT_NE(refusal("hello").find("where $MeshFormat is expected"), std::string::npos);
  EXPECT_NE(refusal("$MeshFormat\n4.1 1 8\n").find("save as ASCII"), std::string::npos);
  EXPECT_NE(refusal("$MeshFormat\n4 0 8\n$EndMeshFormat\n").find("4.1 and 2.2 are read"), std::string::npos);
  const std::string text = knothe::files::read_text(k_folder + "beam41.msh");
  EXPECT_NE(refusal(text.substr(0, text.size() / 2)).find("cut off"), std::string::npos);
  EXPECT_NE(refusal(cube("77 4 2 1 1 1 2 3 5")).find("element 77 is a tetrahedron"), std::string::npos);
  EXPECT_NE(refusal(cube("77 12 2 1 1 1 2 3 5")).find("first-order"), std::string::npos);
  EXPECT_NE(refusal(cube("77 5 2 1 1 1 2 3 4 5 6 7 9")).find("uses node 9"), std::string::npos);
  EXPECT_NE(refusal(cube("77 5 2 1 1 1 2 3 4 5 6 7 8")).find("\"support_left\" is missing"),
            std::string::npos);
}

TEST(GmshMesh, an_inverted_element_is_named_by_its_number) {
  const std::string text = knothe::files::read_text(k_folder + "beam22.msh");
  const auto place = text.find(" 5 2 ", text.find("$Elements"));
  ASSERT_NE(place, std::string::npos);
  const auto begin = text.rfind('\n', place) + 1, end = text.find('\n', place);
  std::istringstream line(text.substr(begin, end - begin));
  std::vector<std::string> words{std::istream_iterator<std::string>(line), {}};
  ASSERT_EQ(words.size(), 13u);
  std::rotate(words.begin() + 5, words.begin() + 9, words.end());  // upper face first
  std::string turned;
  for (const auto& word : words) turned += word + ' ';
  const std::string message = refusal(text.substr(0, begin) + turned + text.substr(end));
  EXPECT_NE(message.find("element " + words[0] + " ("), std::string::npos) << message;
  EXPECT_NE(message.find("is inverted"), std::string::npos) << message;
}

}  // namespace
