#pragma once
/// @file Fields of several steps as one series: the same points at all times.
#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/files/fields/exported_field.hpp"

namespace knothe::likelihood {

struct FieldSeries {
  std::vector<std::array<double, 2>> points;  ///< n, of the reference, in the fields' unit, y down
  Eigen::MatrixXd u, v;                       ///< n × steps; NaN where a point is lost
};

/// The points that are measured in at least one of the fields (`files::settle_field` has been called): by
/// their ids where all fields have them, else by place, to a tenth of their distance. Errors: DataError for
/// two points of a field in one place, and for an id that is elsewhere in another file.
[[nodiscard]] FieldSeries join_fields(const std::vector<files::ExportedField>& fields);

/// Loses the points whose displacement stands out from that of their neighbours, those within three mean
/// distances: |u − plane through them| > factor · (their median distance from it + the usual one), again
/// until none does. The normalised median test (J. Westerweel, F. Scarano, Exp. Fluids 39, 2005) with a
/// plane, by least absolute deviations, in place of the median, so that a strain is no deviation. Gives the
/// number of points lost, each step's.
Index lose_outliers(double factor, FieldSeries& series);

/// Without the points that are lost in all steps, and without those closer than `min_distance` to an earlier
/// one.
[[nodiscard]] FieldSeries thinned(const FieldSeries& series, double min_distance);

/// Standard deviation of what fields of a body at rest show, u and v together; their mean counts as an error
/// too. DataError where nothing is measured, or all is exactly 0: the reference itself.
[[nodiscard]] double static_std(const std::vector<files::ExportedField>& fields);

}  // namespace knothe::likelihood
