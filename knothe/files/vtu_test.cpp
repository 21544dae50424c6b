#include "knothe/files/vtu.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <regex>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::files {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::vector<double> k_points{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
const std::vector<std::int64_t> k_cells{0, 1, 2, 3};

VtuGrid tetrahedron() {
  VtuGrid grid{k_points, k_cells, 4, "VTK_TETRA", {}, {}, 0.5};
  grid.point_fields.push_back({"u & v", 3, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}});
  grid.cell_fields.push_back({"damage", 1, {0.25}});
  return grid;
}

/// The block of DataArray `name`, found through its offset as a VTK reader would.
template <class T>
std::vector<T> block(const std::string& text, const std::string& name) {
  std::smatch match;
  EXPECT_TRUE(std::regex_search(text, match, std::regex("Name=\"" + name + "\"[^>]*offset=\"([0-9]+)\"")));
  const std::string marker = "<AppendedData encoding=\"raw\">\n_";
  const std::size_t start = text.find(marker) + marker.size() + std::stoul(match[1]);
  std::uint64_t length = 0;
  std::memcpy(&length, text.data() + start, 8);
  std::vector<T> values(length / sizeof(T));
  std::memcpy(values.data(), text.data() + start + 8, length);
  return values;
}

TEST(Vtu, BlocksAreWhereTheirOffsetsSay) {
  const TestFolder folder;
  write_vtu(tetrahedron(), folder.file("a.vtu"));
  const std::string text = read_text(folder.file("a.vtu"));
  EXPECT_THAT(text, HasSubstr("NumberOfPoints=\"4\" NumberOfCells=\"1\""));
  EXPECT_THAT(text, HasSubstr("Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">0.5<"));
  EXPECT_THAT(text, HasSubstr("header_type=\"UInt64\""));
  EXPECT_EQ(block<double>(text, "Points"), k_points);
  EXPECT_EQ(block<std::int64_t>(text, "connectivity"), k_cells);
  EXPECT_THAT(block<std::int64_t>(text, "offsets"), ElementsAre(4));
  EXPECT_THAT(block<std::uint8_t>(text, "types"), ElementsAre(10));
  EXPECT_EQ(block<double>(text, "u &amp; v"), tetrahedron().point_fields[0].values);
  EXPECT_THAT(block<double>(text, "damage"), ElementsAre(0.25));
}

TEST(Vtu, MistakesAreNamed) {
  const TestFolder folder;
  const auto complaint = [&](const VtuGrid& grid) {
    return message_of<UsageError>([&] { write_vtu(grid, folder.file("a.vtu")); });
  };
  VtuGrid grid = tetrahedron();
  grid.type = "VTK_BANANA";
  EXPECT_THAT(complaint(grid), HasSubstr("VTK_BANANA is no cell type"));
  grid = tetrahedron();
  grid.point_fields[0].values.pop_back();
  EXPECT_THAT(complaint(grid), HasSubstr("field u & v has 11 values, 4 x 3 are needed"));
  grid = tetrahedron();
  grid.point_fields[0].values[5] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(complaint(grid), HasSubstr("field u & v[1,2] is not finite"));
  EXPECT_EQ(folder.number_of_files(), 0U);
  EXPECT_EQ(vtk_cell("vtk_hexahedron").type, 12);
  EXPECT_EQ(vtk_cell("QUAD").type, 9);
}

TEST(Vtu, SeriesNameTheirFilesAndTimes) {
  const TestFolder folder;
  write_pvd(std::vector<PvdEntry>{{0.5, "u_0.vtu"}, {1.0, "u_1.vtu"}}, folder.file("u.pvd"));
  EXPECT_THAT(read_text(folder.file("u.pvd")),
              HasSubstr("<DataSet timestep=\"0.5\" part=\"0\" file=\"u_0.vtu\"/>"));
}

}  // namespace
}  // namespace knothe::files
