#include "knothe/files/units.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::files {
namespace {

TEST(Units, OfADataSetAreHonouredOrRefused) {
  const std::string path = (std::filesystem::temp_directory_path() / "knothe_units_test.h5").string();
  {
    Hdf5Writer file(path);
    const std::vector<double> values = {1, 2};
    file.write("/none", values, {2}, {"", "no unit"});
    file.write("/millimetres", values, {2}, {"mm", "a length"});
    file.write("/force", values, {2}, {"kN", "a force"});
    file.write("/minutes", values, {2}, {"min", "times"});
    file.write("/feet", values, {2}, {"ft", "a length"});
    file.close();
  }
  const Hdf5Reader file(path);
  EXPECT_EQ(factor_to_si(file, "/none", "m"), 1);
  EXPECT_EQ(factor_to_si(file, "/millimetres", "m"), 1e-3);
  EXPECT_EQ(factor_to_si(file, "/force", "N"), 1e3);
  EXPECT_EQ(time_factor(file, "/minutes"), 60);
  EXPECT_EQ(time_factor(file, "/none"), 1);
  EXPECT_EQ(time_factor(file, "/millimetres"), 1);  // a displacement that stands for time
  const auto refusal = [&](const std::string& name) {
    try {
      (void)factor_to_si(file, name, "m");
    } catch (const DataError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(refusal("/feet"),
            path +
                ": the attribute units of feet is \"ft\": m is needed (understood are m, km, cm, "
                "mm, um, µm, μm, nm, meter, metre)");
  EXPECT_NE(refusal("/force").find("units of force is \"kN\": m is needed"), std::string::npos);
  EXPECT_FALSE(unit_of("furlong"));
  EXPECT_EQ(unit_of("1/mm2")->factor, 1e6);
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace knothe::files
