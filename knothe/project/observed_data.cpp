#include "knothe/project/observed_data.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "knothe/assimilation/clock.hpp"
#include "knothe/assimilation/prior_of_model.hpp"
#include "knothe/assimilation/time_matching.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/reduction/scalar_observations.hpp"
#include "knothe/reduction/time_interpolation.hpp"

namespace knothe::project {
namespace {

using assimilation::MeasuredSeries;

/// What a series is measured of: a sensor of the project, else an output of the model.
reduction::ScalarObservation sensor_of(const Project& project, const reduction::SeparatedModel& model,
                                       const std::string& name, const std::string& source) {
  std::vector<std::string> known = model.output_names();
  if (std::find(known.begin(), known.end(), name) != known.end()) return {name, name, {}, {}, {}};
  for (const reduction::ScalarObservation& sensor : project.sensors) {
    if (sensor.name == name) return sensor;
    known.push_back(sensor.name);
  }
  throw DataError(
      fmt::format("{}: \"{}\" is measured, but it is neither an output of {} nor a table [data.sensors.{}]{}",
                  source, name, model.where(), name, did_you_mean(name, known)));
}

/// Rows for the series that are observed.
void add_series(const Project& project, const reduction::SeparatedModel& model, const std::string& source,
                ObservedData& data) {
  assimilation::Measurements& m = data.measurements;
  for (const reduction::ScalarObservation& sensor : project.sensors) {
    if (!m.series.contains(sensor.name)) {
      throw project.error_at(
          "data.sensors." + sensor.name,
          fmt::format("{} has no series \"{}\": the values of this sensor", source, sensor.name));
    }
  }
  std::vector<reduction::ScalarObservation> sensors;
  std::vector<double> std;
  for (const auto& [name, series] : m.series) {
    if (name == project.clock) continue;
    const reduction::ScalarObservation sensor = sensor_of(project, model, name, source);
    if (!series.std) {
      data.unused.push_back(name);
      continue;
    }
    sensors.push_back(sensor);
    std.push_back(*series.std);
    data.scalars.push_back(name);
  }
  if (sensors.empty()) return;
  const Eigen::Index n = m.values.rows(), count = static_cast<Eigen::Index>(sensors.size());
  m.values.conservativeResize(n + count, Eigen::NoChange);
  for (Eigen::Index i = 0; i < count; ++i) {
    const std::vector<double>& values = m.series.at(data.scalars[static_cast<std::size_t>(i)]).values;
    m.values.row(n + i) = Eigen::Map<const Eigen::RowVectorXd>(values.data(), m.values.cols());
  }
  m.noise = m.noise.with_scalars(Eigen::Map<const Eigen::VectorXd>(std.data(), count));
  data.observed = std::make_shared<const reduction::ObservedModel>(
      reduction::with_scalars(*data.observed, model, sensors));
}

void place_by_clock(const Project& project, const reduction::SeparatedModel& model,
                    const std::vector<assimilation::Prior>& priors, const std::string& source,
                    ObservedData& data) {
  assimilation::Measurements& m = data.measurements;
  const auto series = m.series.find(project.clock);
  if (series == m.series.end()) {
    throw DataError(
        fmt::format("{}: data.clock = \"{}\", but there is no series of that name: HDF5 has it as "
                    "/outputs/{}, CSV in rows whose component is {}",
                    source, project.clock, project.clock, project.clock));
  }
  const assimilation::ClockReading clock =
      assimilation::read_clock(model, project.clock, series->second, source);
  const reduction::ObservedModel& whole = *data.observed;
  if (series->second.std) {
    m.noise = assimilation::with_clock_error(m.noise, reduction::rates_at_times(whole, clock.time),
                                             *assimilation::truncated_to_box(whole, priors), clock.std);
  }
  data.observed = std::make_shared<const reduction::ObservedModel>(reduction::at_times(whole, clock.time));
  data.time_indices.resize(clock.time.size());
  std::iota(data.time_indices.begin(), data.time_indices.end(), std::size_t{0});
}

}  // namespace

ObservedData observe_data(const Project& project, const reduction::SeparatedModel& model,
                          const std::vector<assimilation::Prior>& priors,
                          assimilation::Measurements measurements, const std::string& source) {
  ObservedData data;
  data.measurements = std::move(measurements);
  const assimilation::Measurements& m = data.measurements;
  for (Eigen::Index j = 0; j < m.points.rows(); ++j) {
    for (Eigen::Index c = 0; c < 3; ++c) data.points.push_back(m.points(j, c));
  }
  data.components.assign(m.components.begin(), m.components.end());
  data.observed = std::make_shared<const reduction::ObservedModel>(
      reduction::observe(model, data.points, data.components));
  add_series(project, model, source, data);
  if (project.clock.empty()) {
    data.time_indices = assimilation::match_times(m.time, data.observed->time, source);
  } else {
    place_by_clock(project, model, priors, source, data);
  }
  return data;
}

}  // namespace knothe::project
