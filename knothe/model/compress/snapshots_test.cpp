#include "knothe/model/compress/snapshots.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using files::TestFolder;
using ::testing::HasSubstr;

Snapshots example() {
  Snapshots snapshots;
  snapshots.axes = two_axes();
  snapshots.time = {0.0, 1.0, 2.0};
  snapshots.mesh = small_mesh();
  snapshots.dofs = dofs_on(*snapshots.mesh);
  const std::size_t dofs = snapshots.dofs.components.size();
  snapshots.values = normal_values(30 * 3 * dofs, 1);
  snapshots.lift = normal_values(3 * dofs, 2);
  snapshots.outputs = {{"force", {"N", "reaction force"}, normal_values(30 * 3, 3)}};
  return snapshots;
}

TEST(Snapshots, RoundTripToTheBit) {
  const TestFolder folder;
  const Snapshots written = example();
  write_snapshots(written, folder.file("s.h5"));
  const Snapshots read = read_snapshots(folder.file("s.h5"));
  EXPECT_EQ(read.values, written.values);
  EXPECT_EQ(read.time, written.time);
  EXPECT_EQ(read.lift, written.lift);
  EXPECT_EQ(read.axes[1].name, "Ad");
  EXPECT_EQ(read.axes[1].nodes, written.axes[1].nodes);
  EXPECT_EQ(read.axes[0].reference, 216.0);
  EXPECT_EQ(read.axes[0].long_name, "onset energy");
  EXPECT_EQ(read.dofs.points, written.dofs.points);
  EXPECT_EQ(read.dofs.components, written.dofs.components);
  EXPECT_EQ(read.mesh->cells, written.mesh->cells);
  EXPECT_EQ(read.mesh->type, "VTK_HEXAHEDRON");
  EXPECT_EQ(read.outputs[0].values, written.outputs[0].values);
  EXPECT_EQ(read.outputs[0].labels.units, "N");
  EXPECT_EQ(read.parameters_at(7), (std::vector<double>{0.7, 0.8}));
  EXPECT_EQ(read.solution(7)[5], written.values[7 * 3 * 36 + 5]);
}

TEST(Snapshots, SinglePrecisionOnDisk) {
  const TestFolder folder;
  const Snapshots written = example();
  write_snapshots(written, folder.file("s.h5"), true);
  const Snapshots read = read_snapshots(folder.file("s.h5"));
  for (std::size_t i = 0; i < read.values.size(); ++i) {
    EXPECT_EQ(read.values[i], static_cast<double>(static_cast<float>(written.values[i])));
  }
}

/// Writes a file with the raw writer, changed by `change`, and returns what reading says of it.
std::string complaint(const std::function<void(Snapshots&)>& change) {
  Snapshots snapshots = example();
  change(snapshots);
  return message_of<DataError>([&] { validate(snapshots, "s.h5"); });
}

TEST(Snapshots, MistakesAreNamed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(complaint([](Snapshots&) {}), "");
  EXPECT_THAT(complaint([&](Snapshots& s) { s.values[((3 * 6 + 2) * 3 + 1) * 36 + 35] = nan; }),
              HasSubstr("s.h5: snapshots[3,2,1,35] is NaN"));
  EXPECT_THAT(complaint([](Snapshots& s) { std::swap(s.axes[0].nodes[1], s.axes[0].nodes[2]); }),
              HasSubstr("/parameters/Y0 is not strictly increasing: /parameters/Y0[2] = 0.7 after 0.9"));
  EXPECT_THAT(complaint([](Snapshots& s) { s.time[2] = 1.0; }),
              HasSubstr("/time is not strictly increasing"));
  EXPECT_THAT(complaint([](Snapshots& s) { s.values.pop_back(); }), HasSubstr("snapshots has 3239 entries"));
  EXPECT_THAT(complaint([](Snapshots& s) { s.dofs.components.pop_back(); }),
              HasSubstr("/dofs/component has 35 entries, the field has 36 dofs"));
  EXPECT_THAT(complaint([](Snapshots& s) { s.dofs.components[4] = 3; }),
              HasSubstr("/dofs/component[4] is 3"));
  EXPECT_THAT(complaint([](Snapshots& s) { s.mesh->cells[9] = 12; }), HasSubstr("/mesh/cells[1,1] is 12"));
  EXPECT_THAT(complaint([](Snapshots& s) { s.lift.pop_back(); }), HasSubstr("lift has 107 entries"));
  EXPECT_THAT(complaint([](Snapshots& s) { s.axes[1].name = "Y0"; }),
              HasSubstr("parameter Y0 is named twice"));
  EXPECT_THAT(complaint([&](Snapshots& s) { s.outputs[0].values[7] = nan; }),
              HasSubstr("/outputs/force[0,2,1] is NaN"));
}

/// A file of another solver with some parts left out or of another shape.
void write_foreign(const std::string& path, bool attribute, const files::Shape& shape, bool increasing = true,
                   const files::Labels& time = {}) {
  files::Hdf5Writer file(path);
  file.write("/snapshots", std::vector<double>(2 * 3 * 4, 1.0), shape, {});
  file.write("/parameters/a", std::vector<double>{0.0, increasing ? 1.0 : 0.0}, {2}, {});
  file.write("/time", std::vector<double>{0.0, 1.0, 2.0}, {3}, time);
  if (attribute) file.texts_attribute("/", "parameters", std::vector<std::string>{"a"});
  file.close();
}

TEST(Snapshots, ForeignFilesNeedNoExtras) {
  const TestFolder folder;
  write_foreign(folder.file("a.h5"), true, {2, 3, 4});
  const Snapshots snapshots = read_snapshots(folder.file("a.h5"));
  EXPECT_EQ(snapshots.dof_count(), 4U);
  EXPECT_EQ(snapshots.field.units, "m");
  EXPECT_TRUE(snapshots.dofs.empty());
  EXPECT_FALSE(snapshots.mesh.has_value());
}

/// Kept through a file of ours; "s" of one that an earlier version wrote means nothing.
TEST(Snapshots, TheUnitOfTimeIsTheSolvers) {
  const TestFolder folder;
  const auto units = [&](const files::Labels& time) {
    write_foreign(folder.file("a.h5"), true, {2, 3, 4}, true, time);
    const Snapshots read = read_snapshots(folder.file("a.h5"));
    write_snapshots(read, folder.file("b.h5"));
    const Snapshots again = read_snapshots(folder.file("b.h5"));
    EXPECT_EQ(again.time, read.time);
    EXPECT_EQ(again.time_units, read.time_units);
    return fmt::format("{} {}", read.time[1], read.time_units);
  };
  EXPECT_EQ(units({"min", ""}), "60 s");
  EXPECT_EQ(units({"mm", "opening"}), "1 mm");
  EXPECT_EQ(units({"1", ""}), "1 ");
  EXPECT_EQ(units({"", ""}), "1 ");
  EXPECT_EQ(units({"s", "time"}), "1 ");
}

TEST(Snapshots, ForeignFilesWithMistakesAreRefused) {
  const TestFolder folder;
  const auto read = [&](bool attribute, const files::Shape& shape, bool increasing = true) {
    write_foreign(folder.file("a.h5"), attribute, shape, increasing);
    return message_of<DataError>([&] { (void)read_snapshots(folder.file("a.h5")); });
  };
  EXPECT_THAT(read(false, {2, 3, 4}), HasSubstr("attribute parameters of / is missing"));
  EXPECT_THAT(read(true, {3, 2, 4}), HasSubstr("extent 3 in dimension 0, but /parameters/a has 2 nodes"));
  EXPECT_THAT(read(true, {2, 4, 3}), HasSubstr("extent 4 in dimension 1, but /time has 3 entries"));
  EXPECT_THAT(read(true, {2, 12}), HasSubstr("/snapshots has 2 dimensions, expected 3"));
  EXPECT_THAT(read(true, {2, 3, 4}, false), HasSubstr("/parameters/a is not strictly increasing"));
}

}  // namespace
}  // namespace knothe::model
