#include "knothe/files/netcdf.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hdf5_hl.h>

#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::files {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Names = std::vector<std::string>;

void write_example(const std::string& path) {
  NetcdfWriter file(path);
  file.add_attribute("", "Conventions", "arviz");
  file.add_dimension("posterior", "chain", 1);
  file.add_dimension("posterior", "draw", std::vector<double>{0, 1, 2}, {"1", "draw"});
  file.add_variable("posterior", "Y0", Names{"chain", "draw"}, std::vector<double>{0.9, 1.0, 1.1},
                    {"1", "Y0"});
  file.add_dimension("observed_data", "time", std::vector<double>{0.5, 1.0}, {"s", "time"});
  file.add_variable("observed_data", "u", Names{"time"},
                    std::vector<double>{std::numeric_limits<double>::quiet_NaN(), 2.0},
                    {"m", "displacement"});
  file.close();
}

TEST(Netcdf, ScalesAreAttachedAndNamedAsTheLibraryExpects) {
  const TestFolder folder;
  write_example(folder.file("a.nc"));
  const Hdf5Reader file(folder.file("a.nc"));
  EXPECT_THAT(file.members("/"), ElementsAre("observed_data", "posterior"));
  EXPECT_THAT(file.read("/posterior/Y0", {1, 3}), ElementsAre(0.9, 1.0, 1.1));
  EXPECT_TRUE(std::isnan(file.read("/observed_data/u", true)[0]));
  EXPECT_EQ(file.text_attribute("/posterior/draw", "NAME"), "draw");
  EXPECT_EQ(file.text_attribute("/posterior/chain", "NAME"),
            "This is a netCDF dimension but not a netCDF variable.         1");
  EXPECT_EQ(file.text_attribute("/posterior/chain", "CLASS"), "DIMENSION_SCALE");
  EXPECT_EQ(file.number_attribute("/observed_data/time", "_Netcdf4Dimid"), 2.0);
  EXPECT_EQ(file.text_attribute("/", "Conventions"), "arviz");
}

TEST(Netcdf, CoordinatesMayBeIntegersAndTexts) {
  const TestFolder folder;
  {
    NetcdfWriter file(folder.file("a.nc"));
    file.add_dimension("g", "draw", std::vector<std::int64_t>{0, 10, 20}, {"", "draw"});
    file.add_dimension("g", "sensor", Names{"x0", "ü1"}, {"", "sensor"});
    file.add_variable("g", "u", Names{"draw", "sensor"},
                      SinglePrecision{std::vector<double>{1, 2, 3, 4, 5, 6}}, {"m", "u"});
    file.add_number("g", "u", "reference", 216);
    file.add_text("g", "u", "reference_units", "J/m3");
    EXPECT_THAT(
        [&] {
          file.add_variable("g", "names", Names{"draw", "sensor"}, Names(6), {});
        },
        ::testing::ThrowsMessage<UsageError>(HasSubstr("texts have one dimension")));
    file.close();
  }
  const Hdf5Reader file(folder.file("a.nc"));
  EXPECT_THAT(file.read_integers("/g/draw"), ElementsAre(0, 10, 20));
  EXPECT_THAT(file.read("/g/u", {3, 2}), ElementsAre(1, 2, 3, 4, 5, 6));
  EXPECT_EQ(file.number_attribute("/g/u", "reference"), 216);
  EXPECT_EQ(file.text_attribute("/g/u", "reference_units"), "J/m3");
  EXPECT_EQ(file.shape("/g/sensor"), Shape{2});
}

TEST(Netcdf, AttachedScalesAreSeenByTheHdf5Library) {
  const TestFolder folder;
  write_example(folder.file("a.nc"));
  const hid_t file = H5Fopen(folder.file("a.nc").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t variable = H5Dopen2(file, "/posterior/Y0", H5P_DEFAULT);
  const hid_t draw = H5Dopen2(file, "/posterior/draw", H5P_DEFAULT);
  const hid_t chain = H5Dopen2(file, "/posterior/chain", H5P_DEFAULT);
  EXPECT_EQ(H5DSget_num_scales(variable, 0), 1);
  EXPECT_EQ(H5DSget_num_scales(variable, 1), 1);
  EXPECT_GT(H5DSis_attached(variable, chain, 0), 0);
  EXPECT_GT(H5DSis_attached(variable, draw, 1), 0);
  EXPECT_EQ(H5DSis_attached(variable, draw, 0), 0);
  for (const hid_t id : {chain, draw, variable}) H5Dclose(id);
  H5Fclose(file);
}

TEST(Netcdf, VariablesMustFitTheirDimensions) {
  const TestFolder folder;
  NetcdfWriter file(folder.file("a.nc"));
  file.add_dimension("posterior", "draw", 3);
  const std::vector<double> three(3, 1.0), two(2, 1.0);
  EXPECT_THAT(message_of<UsageError>([&] { file.add_variable("posterior", "a", Names{"chain"}, three, {}); }),
              HasSubstr("variable /posterior/a needs dimension chain"));
  EXPECT_THAT(message_of<UsageError>([&] { file.add_variable("posterior", "a", Names{"draw"}, two, {}); }),
              HasSubstr("has 2 values, its dimensions (draw) need 3"));
  file.close();
}

}  // namespace
}  // namespace knothe::files
