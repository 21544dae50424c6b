#include "knothe/simulator/result_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/files/vtu.hpp"

namespace knothe::simulator {
namespace {

using files::message_of;
using testing::ElementsAre;
using testing::HasSubstr;

/// A field file of two points and no cells.
void write_two_points(const std::string& path, double size, const std::string& units) {
  const std::vector<double> points{0, 0, 0, 1, 0, 0};
  files::VtuGrid grid{points, {}, 8, "VTK_HEXAHEDRON", {}, {}, 0.5};
  grid.point_fields = {{"displacement", 3, {size, 0, 0, 2 * size, 0, 0}, units}};
  files::write_vtu(grid, path);
}

TEST(ResultFile, DisplacementsOfASeriesAreConvertedToMetres) {
  const files::TestFolder folder;
  write_two_points(folder.file("a.vtu"), 3.0, "mm");
  write_two_points(folder.file("b.vtu"), 4e-3, "m");
  write_two_points(folder.file("c.vtu"), 5e-3, "");
  files::write_pvd(std::vector<files::PvdEntry>{{3, "c.vtu"}, {1, "a.vtu"}, {2, "b.vtu"}},
                   folder.file("all.pvd"));
  const reduction::Snapshots solution = read_result({.field = "all.pvd"}, folder.file(""));
  EXPECT_THAT(solution.time, ElementsAre(1, 2, 3));
  EXPECT_THAT(solution.values,
              ElementsAre(3e-3, 0, 0, 6e-3, 0, 0, 4e-3, 0, 0, 8e-3, 0, 0, 5e-3, 0, 0, 1e-2, 0, 0));
}

TEST(ResultFile, AFieldInAnotherUnitThanOfLengthIsRefused) {
  const files::TestFolder folder;
  write_two_points(folder.file("a.vtu"), 3.0, "m/s");
  EXPECT_THAT(
      message_of<DataError>([&] { (void)read_result({.field = "a.vtu"}, folder.file("")); }),
      HasSubstr(
          "the field displacement is in \"m/s\" (key UNITS_LABEL): a displacement in m, or in another unit "
          "of length, is needed"));
}

}  // namespace
}  // namespace knothe::simulator
