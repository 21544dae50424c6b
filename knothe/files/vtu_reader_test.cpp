#include "knothe/files/vtu_reader.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::files {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::vector<double> k_points{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
const std::vector<std::int64_t> k_cells{0, 1, 2, 3};

void write_tetrahedron(const std::string& path, double size) {
  VtuGrid grid{k_points, k_cells, 4, "VTK_TETRA", {}, {}, 0.5};
  grid.point_fields.push_back({"temperature", 1, {1, 2, 3, size}});
  grid.point_fields.push_back({"displacement", 3, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, size}, "mm"});
  write_vtu(grid, path);
}

TEST(VtuReader, ReadsFieldsCellsAndTimeOfRawData) {
  const TestFolder folder;
  write_tetrahedron(folder.file("a.vtu"), 12);
  const VtuContents grid = read_vtu(folder.file("a.vtu"));
  EXPECT_EQ(grid.points, k_points);
  EXPECT_EQ(grid.connectivity, k_cells);
  EXPECT_THAT(grid.types, ElementsAre(10));
  EXPECT_EQ(grid.time, 0.5);
  ASSERT_EQ(grid.point_fields.size(), 2u);
  EXPECT_EQ(grid.point_fields[1].name, "displacement");
  EXPECT_EQ(grid.point_fields[1].components, 3u);
  EXPECT_EQ(grid.point_fields[0].units, "");
  EXPECT_EQ(grid.point_fields[1].units, "mm");
  EXPECT_EQ(grid.point_fields[1].values[11], 12);
}

/// One point with u = (1, 2, 3): Float64, as `meshio` 5 and ParaView write it (made by Python's zlib and
/// base64).
std::string one_point(const std::string& attributes, const std::string& u) {
  return "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\" " + attributes +
         "><UnstructuredGrid><Piece NumberOfPoints=\"1\" NumberOfCells=\"0\"><Points><DataArray "
         "type=\"Float64\" "
         "NumberOfComponents=\"3\" format=\"ascii\">0 0 0</DataArray></Points><Cells><DataArray "
         "type=\"Int64\" "
         "Name=\"connectivity\" format=\"ascii\"/><DataArray type=\"Int64\" Name=\"offsets\" "
         "format=\"ascii\"/><DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\"/></Cells><PointData>"
         "<DataArray type=\"Float64\" Name=\"u\" NumberOfComponents=\"3\" " +
         u + "</DataArray></PointData></Piece></UnstructuredGrid></VTKFile>\n";
}

TEST(VtuReader, ReadsTextBase64AndCompressedData) {
  for (const auto& [attributes, u] :
       {std::pair<std::string, std::string>{"", "format=\"ascii\">1 2 3"},
        {"",
         "format=\"ascii\"><InformationKey name=\"UNITS_LABEL\" "
         "location=\"vtkDataArray\">m</InformationKey>\n1 2 3"},
        {"header_type=\"UInt32\"", "format=\"binary\">GAAAAAAAAAAAAPA/AAAAAAAAAEAAAAAAAAAIQA=="},
        {"header_type=\"UInt32\" compressor=\"vtkZLibDataCompressor\"",
         "format=\"binary\">AQAAABgAAAAAAAAAFAAAAA==eJxjYACBD/YMEOAAoTgcABe3Abg="}}) {
    const VtuContents grid = parse_vtu_contents(one_point(attributes, u), "a.vtu");
    ASSERT_EQ(grid.point_fields.size(), 1u) << u;
    EXPECT_THAT(grid.point_fields[0].values, ElementsAre(1, 2, 3)) << u;
  }
}

TEST(VtuReader, MistakesAreNamedWithTheirPlace) {
  const std::string text = one_point("", "format=\"ascii\">1 2 ");
  EXPECT_THAT(message_of<DataError>([&] { (void)parse_vtu_contents(text, "a.vtu"); }),
              HasSubstr("u has 2 values for 1 points of 3 components"));
}

TEST(PvdReader, GivesTheFilesInTheOrderOfTheirTimes) {
  const TestFolder folder;
  write_pvd(std::vector<PvdEntry>{{2.0, "b.vtu"}, {1.0, "a.vtu"}}, folder.file("s.pvd"));
  const std::vector<PvdEntry> entries = read_pvd(folder.file("s.pvd"));
  ASSERT_EQ(entries.size(), 2u);
  EXPECT_EQ(entries[0].file, "a.vtu");
  EXPECT_EQ(entries[1].time, 2.0);
  write_pvd(std::vector<PvdEntry>{{2.0, "b.vtu"}, {2.0, "a.vtu"}}, folder.file("s.pvd"));
  EXPECT_THAT(message_of<DataError>([&] { (void)read_pvd(folder.file("s.pvd")); }),
              HasSubstr("two files for the time 2"));
  write_text_atomically(folder.file("s.pvd"), "<a/>");
  EXPECT_THAT(message_of<DataError>([&] { (void)read_pvd(folder.file("s.pvd")); }), HasSubstr("no PVD file"));
}

}  // namespace
}  // namespace knothe::files
