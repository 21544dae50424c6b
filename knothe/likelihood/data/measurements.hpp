#pragma once
/// @file Recorded measurements: displacement components at points over time, with their noise.
#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/model/observe/scalar_observations.hpp"
#include "knothe/model/observe/sensors.hpp"

namespace knothe::likelihood {

/// A number measured beside the displacements: a force, a strain, an opening, a clock, a temperature.
struct MeasuredSeries {
  std::vector<double> values;  ///< n_t, in the unit of what is measured; NaN where missing
  std::optional<double> std;   ///< standard deviation of its noise
  /// n_t, or empty: standard deviation of an error besides that is one standard normal number, the same at
  /// all times, times this: the scatter of specimens about the curve, a calibration.
  std::vector<double> shared_std;
  std::string units;         ///< of the values; empty: not said
  std::vector<double> rate;  ///< n_t, change per unit of time, where values are interpolated; else empty
  /// Of `Measurements::clocks`, where it was timed by another clock than the displacements.
  std::optional<std::size_t> clock;
};

/// A clock beside that of the displacements: it is ahead of that by a + b (t − t₀), t₀ the model's first time
/// (or, of data that tell the time by another series, their first), with a and b unknown.
struct SeriesClock {
  std::string name;       ///< of the source; empty: there is but one
  double offset_std = 0;  ///< of a, in units of the time; 0: exact
  double drift_std = 0;   ///< of b
};

/// What a data file holds (docs/interfaces of the project, section 4). SI units.
struct Measurements {
  std::vector<double> time;  ///< n_t, strictly increasing, model time
  Eigen::MatrixXd values;    ///< n_obs × n_t, m; NaN where a value is missing
  model::Sensors sensors;    ///< rows of the values; scalars are in `series` until they are observed
  NoiseModel noise;
  std::map<std::string, MeasuredSeries> series;  ///< `/outputs/NAME`
  std::vector<SeriesClock> clocks;               ///< of series; their `rate` says what an error of one does
  std::vector<model::ScalarObservation> gauges;  ///< what series measure, where their file says it
  std::map<std::string, double>
      truth;  ///< true parameters of synthetic data, `/truth/NAME`; empty for real data

  [[nodiscard]] Eigen::Index observation_count() const { return values.rows(); }
};

/// Reads `.csv` as CSV (columns time, sensor, x, y, z, component, value, std, and shared_std if
/// wanted; or a column `time` and one of each series), anything else as HDF5. A
/// series is `/outputs/NAME` [n_t] with an attribute `std`, `/shared_std/NAME` [n_t] if wanted, in CSV rows
/// whose component is NAME (x, y, z and a std of 0 or none are then not looked at). Errors: DataError with
/// file, data set and index, or file:line:column.
[[nodiscard]] Measurements read_measurements(const std::string& path);

/// Writes (atomically) `.csv` as CSV, anything else as HDF5, which alone holds `project` (the text of the
/// project file), `seed` and the truth. Not the noise of single steps, nor errors that all share.
void write_measurements(const std::string& path, const Measurements& measurements, const std::string& project,
                        std::uint64_t seed);

}  // namespace knothe::likelihood
