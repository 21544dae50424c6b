#include "knothe/likelihood/data/field_series.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <random>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {
namespace {

using files::ExportedField;

/// A field as settle_field leaves it; rows of x, y, u, v and, if wanted, a number.
ExportedField field(const std::string& path, const std::vector<std::vector<double>>& rows) {
  ExportedField f;
  f.path = path;
  for (const auto& row : rows) {
    f.x.push_back(row[0]), f.y.push_back(row[1]), f.u.push_back(row[2]), f.v.push_back(row[3]);
    if (row.size() > 4) f.id.push_back({row[4], 0});
  }
  return f;
}

std::string complaint(const std::vector<ExportedField>& fields) {
  try {
    (void)join_fields(fields);
  } catch (const DataError& error) {
    return error.what();
  }
  return "joined";
}

TEST(FieldSeries, PointsAreFoundByPlaceInAnyOrderAndALostOneIsAbsent) {
  const double lost = NAN;
  const FieldSeries series =
      join_fields({field("a", {{0, 0, 1, 2}, {10, 0, 3, 4}, {0, 10, lost, lost}}),
                   field("b", {{10.02, 0, 5, 6}, {10, 10, lost, lost}, {0, -0.03, 7, 8}}),
                   field("c", {{99, 99, lost, lost}, {0, 10, 9, 10}})});
  ASSERT_EQ(series.points.size(), 3u);  // what is lost in all files is not there at all
  EXPECT_EQ(series.points[2], (std::array<double, 2>{0, 10}));
  EXPECT_EQ(series.u(0, 0), 1);
  EXPECT_EQ(series.u(0, 1), 7);
  EXPECT_EQ(series.v(1, 1), 6);
  EXPECT_EQ(series.v(2, 2), 10);
  EXPECT_TRUE(std::isnan(series.u(2, 0)) && std::isnan(series.u(2, 1)) && std::isnan(series.v(0, 2)));
}

TEST(FieldSeries, NumbersGoBeforePlaces) {
  // Positions of the loaded state less displacements that were rounded: off by more than a tenth.
  const FieldSeries series = join_fields({field("a", {{0, 0, 1, 0, 7}, {10, 0, 2, 0, 8}, {0, 10, 3, 0, 9}}),
                                          field("b", {{8, 0, 5, 0, 8}, {2, 0, 4, 0, 7}})});
  ASSERT_EQ(series.points.size(), 3u);
  EXPECT_EQ(series.u(1, 1), 5);
  EXPECT_EQ(series.u(0, 1), 4);
  EXPECT_EQ(complaint({field("a", {{0, 0, 1, 0, 7}, {10, 0, 2, 0, 8}, {0, 10, 3, 0, 9}}),
                       field("b", {{30, 0, 5, 0, 7}})}),
            "b: the point 7 is at (30, 0), in another file at (0, 0): its number does not stay with it, or "
            "positions "
            "are not those of the reference (data.fields.columns.id, data.fields.positions)");
}

TEST(FieldSeries, TwoPointsInOnePlaceAreRefused) {
  EXPECT_EQ(complaint({field("a", {{0, 0, 1, 0}, {10, 10, 2, 0}, {0, 0.01, 3, 0}})}),
            "a: two points at (0, 0.01): leave one of them out of the export");
}

TEST(FieldSeries, PointsCloserThanTheSubsetAreLeftOut) {
  std::vector<std::vector<double>> rows;
  for (int i = 0; i < 21; ++i)
    for (int j = 0; j < 21; ++j) rows.push_back({double(i), double(j), double(i), 0});
  const FieldSeries series = thinned(join_fields({field("a", rows)}), 4);
  EXPECT_EQ(series.points.size(), 36u);  // 0, 4, … 20 in both directions
  for (std::size_t a = 0; a < series.points.size(); ++a)
    for (std::size_t b = 0; b < a; ++b)
      EXPECT_GE(
          std::hypot(series.points[a][0] - series.points[b][0], series.points[a][1] - series.points[b][1]),
          4);
  EXPECT_EQ(series.u(1, 0), series.points[1][0]);
}

/// A stretch with noise of 1 % of the displacement from point to point, and three points that are wrong, two
/// of them beside each other at the edge, one wrong in v alone, by a multiple of the noise.
TEST(FieldSeries, ValuesThatStandOutFromTheirNeighboursAreLost) {
  std::vector<std::vector<double>> rows;
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 0.01);
  for (int i = 0; i < 30; ++i)
    for (int j = 0; j < 20; ++j)
      rows.push_back({double(i), double(j), double(i) + noise(random), -0.3 * double(j) + noise(random)});
  FieldSeries right = join_fields({field("a", rows)});
  EXPECT_EQ(lose_outliers(5, right), 0);
  rows[100][2] += 6, rows[101][2] -= 5, rows[317][3] += 3;
  FieldSeries series = join_fields({field("a", rows), field("b", rows)});
  EXPECT_EQ(lose_outliers(5, series), 6);
  for (Index t = 0; t < 2; ++t)
    for (const Index lost : {100, 101, 317})
      EXPECT_TRUE(std::isnan(series.u(lost, t)) && std::isnan(series.v(lost, t)));
  const FieldSeries rest = thinned(series, 0);
  EXPECT_EQ(std::ssize(rest.points), 597);  // what is lost in all fields is not there
  EXPECT_FALSE(rest.u.array().isNaN().any());
}

TEST(FieldSeries, NoiseOfFieldsAtRest) {
  EXPECT_DOUBLE_EQ(static_std({field("a", {{0, 0, 3, 4}, {1, 0, NAN, NAN}}), field("b", {{0, 0, 0, 0}})}),
                   2.5);
  EXPECT_THROW((void)static_std({field("a", {{0, 0, 0, 0}})}), DataError);
  EXPECT_THROW((void)static_std({field("a", {{0, 0, NAN, NAN}})}), DataError);
}

}  // namespace
}  // namespace knothe::likelihood
