#include "knothe/files/surface_mesh.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/files/vtu.hpp"

namespace knothe::files {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// A quadrilateral and a triangle beside it; node 7 of the file belongs to a line alone.
const std::string k_gmsh_2 = R"($MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
2 1 "face"
$EndPhysicalNames
$Nodes
6
1 0 0 0
2 30 0 0
7 -9 -9 0
3 34 28 0
4 2 30 0
5 60 10 0
$EndNodes
$Elements
3
1 1 2 0 1 7 1
2 3 2 1 1 1 2 3 4
3 2 2 1 1 2 5 3
$EndElements
)";
const std::string k_gmsh_4 = R"($MeshFormat
4.1 0 8
$EndMeshFormat
$Entities
0 0 1 0
1 0 0 0 60 30 0 0 0
$EndEntities
$Nodes
2 6 1 7
1 1 0 1
7
-9 -9 0
2 1 0 5
1
2
3
4
5
0 0 0
30 0 0
34 28 0
2 30 0
60 10 0
$EndNodes
$Elements
3 3 1 3
1 1 1 1
1 7 1
2 1 3 1
2 1 2 3 4
2 1 2 1
3 2 5 3
$EndElements
)";

std::string vtu(const std::string& head, const std::string& format, const std::array<std::string, 4>& data) {
  const auto array = [&](const char* type, const char* name, const std::string& content) {
    return std::string("<DataArray type=\"") + type + "\" Name=\"" + name +
           "\" NumberOfComponents='3' format=\"" + format + "\">\n" + content + "\n</DataArray>\n";
  };
  return "<?xml version=\"1.0\"?>\n<!-- <Piece> -->\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" " +
         head +
         ">\n<UnstructuredGrid><Piece NumberOfPoints=\"5\" "
         "NumberOfCells=\"2\">\n<PointData></PointData><Points>" +
         array("Float32", "Points", data[0]) + "</Points><Cells>" + array("Int32", "connectivity", data[1]) +
         array("Int32", "offsets", data[2]) + array("UInt8", "types", data[3]) +
         "</Cells></Piece></UnstructuredGrid></VTKFile>\n";
}
const std::array<std::string, 4> k_plain{"0 0 0  30 0 0  34 28 0\n2 30 0 60 1e1 0", "0 1 2 3 1 4 2", "4 7",
                                         "9 5"};
// The same, as VTK codes them (little-endian; made with Python's struct, zlib and base64).
const std::array<std::string, 4> k_base64{
    "PAAAAAAAAAAAAAAAAAAAAAAA8EEAAAAAAAAAAAAACEIAAOBBAAAAAAAAAEAAAPBBAAAAAAAAcEIAACBBAAAAAA==",
    "HAAAAAAAAAABAAAAAgAAAAMAAAABAAAABAAAAAIAAAA=", "CAAAAAQAAAAHAAAA", "AgAAAAkF"};
const std::array<std::string, 4> k_zlib{
    "AQAAAACAAAA8AAAAHwAAAA==eJxjYEAGHxwRbA4nBoYHML4DQq4AKK4AZgMAhSAFIQ==",
    "AQAAAACAAAAcAAAAFgAAAA==eJxjYGBgYARiJiBmhrJZoHwAAMAADg==",
    "AQAAAACAAAAIAAAADgAAAA==eJxjYWBgYAdiAABEAAw=", "AQAAAACAAAACAAAACgAAAA==eJzjZAUAABkADw=="};

void expect_the_two_elements(const SurfaceMesh& mesh) {
  EXPECT_THAT(mesh.points, ElementsAre(0, 0, 0, 30, 0, 0, 34, 28, 0, 2, 30, 0, 60, 10, 0));
  ASSERT_EQ(mesh.cells.size(), 2U);
  EXPECT_THAT(mesh.cells[0], ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(mesh.cells[1], ElementsAre(1, 4, 2, -1));
}

TEST(SurfaceMesh, IsReadFromEveryForm) {
  std::string reordered = k_gmsh_2;  // the line's node stands elsewhere: nodes keep the file's order
  expect_the_two_elements(parse_gmsh(reordered, "a.msh"));
  expect_the_two_elements(parse_gmsh(k_gmsh_4, "a.msh"));
  expect_the_two_elements(parse_vtu(vtu("", "ascii", k_plain), "a.vtu"));
  expect_the_two_elements(parse_vtu(vtu("byte_order=\"LittleEndian\"", "binary", k_base64), "a.vtu"));
  expect_the_two_elements(parse_vtu(vtu("compressor=\"vtkZLibDataCompressor\"", "binary", k_zlib), "a.vtu"));
}

TEST(SurfaceMesh, WhatWeWriteIsReadBack) {
  const TestFolder folder;
  const std::vector<double> points{0, 0, 0, 1.5, 0, 0, 1.5, 2, 0, 0, 2, 0};
  const std::vector<std::int64_t> cells{0, 1, 2, 3};
  VtuGrid grid{points, cells, 4, "VTK_QUAD", {{"u<&", 1, {1, 2, 3, 4}}}, {}};
  grid.time = 0.5;
  write_vtu(grid, folder.file("q.vtu"));
  const SurfaceMesh mesh = read_surface_mesh(folder.file("q.vtu"));
  EXPECT_EQ(mesh.points, points);
  EXPECT_THAT(mesh.cells[0], ElementsAre(0, 1, 2, 3));
  write_text_atomically(folder.file("g.msh"), k_gmsh_4);
  expect_the_two_elements(read_surface_mesh(folder.file("g.msh")));
}

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  const auto at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), with);
}

TEST(SurfaceMesh, MistakesAreNamedWithTheirPlace) {
  const auto gmsh = [](const std::string& base, const std::string& what, const std::string& with) {
    return message_of<DataError>([&] { (void)parse_gmsh(replaced(base, what, with), "a.msh"); });
  };
  const auto cut = [](const std::string& text, const std::string& from) {
    return text.substr(0, text.find(from));
  };
  EXPECT_THAT(gmsh(k_gmsh_2, "2.2 0", "4 0"),
              HasSubstr("a.msh:2:1: error: Gmsh format 4; 4.1 and 2.2 are read"));
  EXPECT_THAT(gmsh(k_gmsh_4, "4.1 0", "4.1 1"),
              HasSubstr("a.msh:2:5: error: a binary Gmsh file; save as ASCII"));
  EXPECT_THAT(gmsh(k_gmsh_2, "30 0 0", "x 0 0"),
              HasSubstr("a.msh:11:3: error: \"x\" is not a finite number; a node's x"));
  EXPECT_THAT(gmsh(k_gmsh_2, "30 0 0", "nan 0 0"), HasSubstr("is not a finite number"));
  EXPECT_THAT(gmsh(k_gmsh_2, "7 -9", "1 -9"), HasSubstr("node 1 is there twice"));
  EXPECT_THAT(gmsh(k_gmsh_2, "1 2 5 3", "1 2 8 3"),
              HasSubstr("a.msh:21:13: error: element 3 uses node 8, which is not among"));
  EXPECT_THAT(gmsh(k_gmsh_2, "3 2 2 1", "3 9 2 1"),
              HasSubstr("elements of Gmsh's type 9; image correlation takes linear"));
  EXPECT_THAT(gmsh(k_gmsh_4, "2 1 3 1\n2 1 2 3 4", "3 1 4 1\n2 1 2 3 4"),
              testing::IsEmpty());  // a volume: left out
  EXPECT_THAT(message_of<DataError>([&] { (void)parse_gmsh(cut(k_gmsh_4, "34 28"), "a.msh"); }),
              HasSubstr("the file ends where a node's x should be: it is cut off"));
  EXPECT_THAT(message_of<DataError>([&] { (void)parse_gmsh(cut(k_gmsh_2, "$Elements"), "a.msh"); }),
              HasSubstr("no triangles or quadrilaterals: save the surface's mesh too"));
  EXPECT_THAT(message_of<DataError>([&] { (void)parse_gmsh("solid x", "a.msh"); }),
              HasSubstr("a.msh:1:1: error: \"solid\", where $MeshFormat is expected"));
  const auto vtk = [](const std::string& what, const std::string& with) {
    return message_of<DataError>([&] {
      (void)parse_vtu(replaced(vtu("header_type=\"UInt32\"", "ascii", k_plain), what, with), "a.vtu");
    });
  };
  EXPECT_THAT(vtk("\"UnstructuredGrid\"", "\"PolyData\""),
              HasSubstr("a.vtu:3:1: error: a VTK file of type \"PolyData\""));
  EXPECT_THAT(vtk("NumberOfPoints=\"5\"", "NumberOfPoints=\"6\""), HasSubstr("15 coordinates for 6 points"));
  EXPECT_THAT(vtk("1 4 2", "1 5 2"), HasSubstr("cell 1 has the point 5, there are 5"));
  EXPECT_THAT(vtk("4 7", "4 8"), HasSubstr("the offset of cell 1 is 8, there are 7 nodes in all"));
  EXPECT_THAT(vtk("9 5", "23 5"), HasSubstr("cell 0 is of second order"));
  EXPECT_THAT(vtk("1e1", "ten"),
              HasSubstr("a.vtu:7:11: error: \"ten\" among the points: a number is expected"));
  EXPECT_THAT(vtk("Name=\"types\"", "Name=\"kind\""), HasSubstr("the file's Cells have no types"));
  EXPECT_THAT(vtk("header_type=\"UInt32\"", "compressor=\"vtkLZMADataCompressor\""),
              HasSubstr("save it with zlib"));
  EXPECT_THAT(message_of<DataError>([&] {
                (void)parse_vtu(replaced(vtu("compressor=\"vtkZLibDataCompressor\"", "binary", k_zlib),
                                         "GHxwRb", "GHxwRc"),
                                "a.vtu");
              }),
              HasSubstr("a compressed block cannot be read: the file is damaged"));
  EXPECT_THAT(message_of<DataError>([&] { (void)parse_vtu("<VTKFile type=\"Unstr", "a.vtu"); }),
              HasSubstr("Error parsing element attribute: this is no VTU file, or it is cut off"));
  EXPECT_THAT(message_of<DataError>([&] { (void)read_surface_mesh("a.stl"); }),
              HasSubstr("Gmsh (.msh) and VTK (.vtu)"));
  EXPECT_THAT(message_of<DataError>([&] { (void)read_surface_mesh("/nowhere/a.msh"); }),
              HasSubstr("/nowhere/a.msh"));
}

}  // namespace
}  // namespace knothe::files
