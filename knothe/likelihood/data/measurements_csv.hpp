#pragma once
/// @file Measurements as CSV: one line per value.
#include <string>

#include "knothe/files/csv.hpp"
#include "knothe/likelihood/data/measurements.hpp"

namespace knothe::likelihood {

/// Columns time, sensor, x, y, z, component (x, y, z or 0, 1, 2), value (m; empty or nan: missing), std (m),
/// in any order; lines in any order; a sensor is known by its name and component, and stays where it is. A
/// (time, sensor) pair without a line is missing. A component of two letters or more is the name of a series
/// (`MeasuredSeries`); x, y, z may then be empty, and so may std. Errors: DataError as `file:line: error: …`.
[[nodiscard]] Measurements read_measurements_csv(const std::string& path);
[[nodiscard]] Measurements read_measurements_csv(const files::CsvTable& table);

/// The same lines: displacements, then the series of each time; an empty value where one is missing. Atomic.
/// Errors: IoError; UsageError for noise that is correlated, which a column has no place for.
void write_measurements_csv(const std::string& path, const Measurements& measurements);

}  // namespace knothe::likelihood
