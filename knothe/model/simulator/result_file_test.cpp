#include "knothe/model/simulator/result_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/files/vtu.hpp"

namespace knothe::model {
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
  const Snapshots solution = read_result({.field = "all.pvd", .time_units = "min"}, folder.file(""));
  EXPECT_EQ(solution.time_units, "s");
  EXPECT_THAT(solution.time, ElementsAre(60, 120, 180));
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

constexpr const char* k_dat = R"(
 displacements (vx,vy,vz) for set TIP and time  0.5000000E+00

         7  1.0  0.0 -2.0

 total force (fx,fy,fz) for set BOTTOM and time  0.5000000E+00

       0.0 0.0 20.0

 displacements (vx,vy,vz) for set TIP and time  0.1000000E+01

         7  1.5  0.0 -4.0

 total force (fx,fy,fz) for set BOTTOM and time  0.1000000E+01

       0.0 0.0 40.0
)";

TEST(ResultFile, PrintedTablesOfCalculixAreChosenByNameAndConverted) {
  const files::TestFolder folder;
  files::write_text_atomically(folder.file("job.dat"), k_dat);
  EXPECT_EQ(read_result({.field = "job.dat"}, folder.file("")).quantities.size(), 6u);
  ResultOptions options{.field = "job.dat", .names = {"BOTTOM.fz", "TIP.7.vz"}, .units = {"kN", "mm"}};
  const Snapshots solution = read_result(options, folder.file(""));
  EXPECT_THAT(solution.time, ElementsAre(0.5, 1.0));
  EXPECT_THAT(solution.values, ElementsAre(20e3, -2e-3, 40e3, -4e-3));
  EXPECT_EQ(solution.quantities[0].units, "N");
  EXPECT_EQ(solution.quantities[1].name, "TIP.7.vz");
  EXPECT_EQ(solution.quantities[1].units, "m");
  options.names = {"BOTTOM.f_z"};
  EXPECT_THAT(
      message_of<DataError>([&] { (void)read_result(options, folder.file("")); }),
      HasSubstr("there is no \"BOTTOM.f_z\" of [offline.command] \"names\" (did you mean \"BOTTOM.fz\"?)"));
}

TEST(ResultFile, SnapshotsOfOnePointAreASolution) {
  const files::TestFolder folder;
  Snapshots written;
  written.axes = {{"a", {1.5}}};
  written.time = {1, 2};
  written.values = {3, 4, 5, 6};
  written.field = {"1", "quantities"};
  written.quantities = {{"opening", "mm"}, {"load", "kN"}};
  write_snapshots(written, folder.file("solution.h5"));
  const Snapshots solution = read_result({.field = "solution.h5"}, folder.file(""));
  EXPECT_THAT(solution.values, ElementsAre(3e-3, 4e3, 5e-3, 6e3));
  EXPECT_EQ(solution.quantities[0].units, "m");
  EXPECT_EQ(solution.quantities[1].units, "N");
}

}  // namespace
}  // namespace knothe::model
