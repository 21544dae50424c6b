#include "knothe/likelihood/data/series_interpolation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace knothe::likelihood {
namespace {

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

TEST(InterpolateSeries, IsLinearBetweenValuesAndMissingElsewhere) {
  const MeasuredSeries force{{1, 3, k_nan, 7, 6}, 0.1, {}, "N", {}, {}};
  const std::vector<double> from = {0, 1, 2, 3, 5},
                            to = {-0.1, 0, 0.25, 1, 1.5, 2, 2.5, 3, 3 + 1e-12, 4, 5, 5.1};
  const MeasuredSeries at = interpolate_series(force, from, to);
  const std::vector<double> expected = {k_nan, 1, 1.5, 3, k_nan, k_nan, k_nan, 7, 7, 6.5, 6, k_nan};
  ASSERT_EQ(at.values.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    if (std::isnan(expected[i]))
      EXPECT_TRUE(std::isnan(at.values[i])) << i;
    else
      EXPECT_NEAR(at.values[i], expected[i], 1e-9) << i;
  }
  EXPECT_EQ(at.units, "N");
  EXPECT_EQ(at.std, 0.1);
  EXPECT_EQ(at.rate[2], 2);
  EXPECT_EQ(at.rate[9], -0.5);
  EXPECT_TRUE(at.shared_std.empty());
}

TEST(InterpolateSeries, TheRateIsTheSlopeOfTheLineThroughAllValuesOfTheWindow) {
  std::vector<double> from, values;
  for (int i = 0; i <= 20; ++i) {
    from.push_back(1e9 + 0.25 * i);
    values.push_back(i == 7 ? k_nan : 0.0625 * i * i + (i % 2 == 0 ? 0.5 : -0.5));
  }
  const std::vector<double> to = {from[10], from[0]};
  const MeasuredSeries at = interpolate_series({values, {}, {}, "", {}, {}}, from, to, 0.5);
  EXPECT_NEAR(at.rate[0], 2 * 10 * 0.25, 1e-6);  // of t², from t = 2 s to t = 3 s; the rest cancels
  // Of 0.5, −0.4375 and 0.75 at 0, 0.25 and 0.5 s.
  EXPECT_NEAR(at.rate[1], 0.5, 1e-6);
}

TEST(MeasurementsAtTimes, AreThereWhereTheyWereMeasured) {
  Measurements m;
  m.time = {0.1, 0.2, 0.25};
  m.values = (Eigen::MatrixXd(1, 3) << 1, 2, 3).finished();
  m.series["force"] = {{10, 20, 25}, 0.1, {1, 2, 2}, "N", {}, {}};
  const Measurements at = at_times(m, std::vector<double>{0.1, 0.2 + 1e-9, 0.3});
  EXPECT_EQ(at.values.leftCols(2), m.values.leftCols(2));
  EXPECT_TRUE(std::isnan(at.values(0, 2)));
  EXPECT_NEAR(at.series.at("force").values[1], 20, 1e-6);
  EXPECT_TRUE(std::isnan(at.series.at("force").values[2]));
  EXPECT_EQ(at.time.size(), 3u);
}

TEST(InterpolateSeries, OneValueIsNoLine) {
  const MeasuredSeries at =
      interpolate_series({{4.0}, {}, {}, "", {}, {}}, std::vector<double>{1.0}, std::vector<double>{1.0});
  EXPECT_TRUE(std::isnan(at.values[0]));
}

}  // namespace
}  // namespace knothe::likelihood
