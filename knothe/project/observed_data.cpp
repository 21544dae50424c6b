#include "knothe/project/observed_data.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/units.hpp"
#include "knothe/likelihood/data/clock.hpp"
#include "knothe/likelihood/data/series_interpolation.hpp"
#include "knothe/likelihood/data/time_matching.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/model/observe/scalar_observations.hpp"
#include "knothe/model/reduced/known_parameter.hpp"
#include "knothe/model/reduced/time_interpolation.hpp"
#include "knothe/project/field_measurements.hpp"

namespace knothe::project {
namespace {

using likelihood::MeasuredSeries;

/// What a series is measured of: a sensor of the project, else an output of the model.
model::ScalarObservation sensor_of(const Project& project, const model::SeparatedModel& model,
                                   const std::string& name, const std::string& source) {
  for (const model::SnapshotOutput& output : model.contents().outputs)
    if (output.name == name) return {name, name, {}, {}, {}, output.labels.units};
  std::vector<std::string> known = model.output_names();
  for (const model::ScalarObservation& sensor : project.sensors) {
    if (sensor.name == name) return sensor;
    known.push_back(sensor.name);
  }
  throw DataError(
      fmt::format("{}: \"{}\" is measured, but it is neither an output of {} nor a table [data.sensors.{}]{}",
                  source, name, model.where(), name, did_you_mean(name, known)));
}

/// Puts a series into the unit of its sensor, which it has if it says none. A force is no displacement:
/// DataError.
void settle_units(const model::ScalarObservation& sensor, const std::string& source, MeasuredSeries& series) {
  const auto measured = files::unit_of(series.units), modelled = files::unit_of(sensor.units);
  if (measured && modelled) {
    if (measured->si != modelled->si)
      throw DataError(fmt::format("{}: \"{}\" is in {}, in the model in {}", source, sensor.name,
                                  series.units, sensor.units));
    const double factor = measured->factor / modelled->factor;
    for (std::vector<double>* values : {&series.values, &series.shared_std, &series.rate})
      for (double& value : *values) value *= factor;
    if (series.std) *series.std *= factor;
    series.units = sensor.units;
  }
  if (series.units.empty() || series.units == "1") series.units = sensor.units;
  if (!measured && modelled && series.units != sensor.units)
    throw DataError(fmt::format("{}: the unit \"{}\" of \"{}\" is not known; in the model it is in {}",
                                source, series.units, sensor.name, sensor.units));
}

/// The noise with the errors that observed series have at all times: what is shared by the values of one, and
/// that their clock is ahead by. `by_clock`: what the latter does to displacements, n × n_t, m per unit of
/// time, where the series tell the time of the data; then it does nothing to the series themselves. Else
/// empty.
likelihood::NoiseModel with_shared_errors(const likelihood::Measurements& m,
                                          const Eigen::MatrixXd& by_clock) {
  const std::vector<std::string>& names = m.sensors.scalars;
  const Eigen::Index displacements = m.values.rows() - std::ssize(names);
  std::vector<Eigen::MatrixXd> factors(m.time.size(), Eigen::MatrixXd(m.values.rows(), 0));
  std::vector<likelihood::LastingError> errors;
  const auto add_column = [](Eigen::MatrixXd& factor) {
    factor.conservativeResize(Eigen::NoChange, factor.cols() + 1);
    factor.rightCols<1>().setZero();
    return factor.rightCols<1>();
  };
  for (std::size_t k = 0; k < names.size(); ++k) {
    const std::vector<double>& std = m.series.at(names[k]).shared_std;
    if (!std.empty()) errors.push_back({names[k], 1});
    for (std::size_t t = 0; t < std.size(); ++t) add_column(factors[t])(displacements + k) = std[t];
  }
  if (m.series_time_std > 0) errors.push_back({"time_offset", m.series_time_std});
  for (std::size_t t = 0; m.series_time_std > 0 && t < factors.size(); ++t) {
    auto column = add_column(factors[t]);
    if (by_clock.size() > 0)
      column.head(displacements) = m.series_time_std * by_clock.col(t).head(displacements);
    for (std::size_t k = 0; by_clock.size() == 0 && k < names.size(); ++k) {
      const double rate = m.series.at(names[k]).rate[t];
      if (!std::isnan(rate)) column(displacements + k) = -m.series_time_std * rate;
    }
  }
  return factors.empty() || factors.front().cols() == 0
             ? m.noise
             : m.noise.with_lasting_errors({std::move(errors), std::move(factors)});
}

/// Rows for the series that are observed.
void add_series(const Project& project, const model::SeparatedModel& model, const std::string& source,
                ObservedData& data) {
  likelihood::Measurements& m = data.measurements;
  for (const model::ScalarObservation& sensor : project.sensors) {
    if (!m.series.contains(sensor.name)) {
      throw project.error_at(
          "data.sensors." + sensor.name,
          fmt::format("{} has no series \"{}\": the values of this sensor", source, sensor.name));
    }
  }
  const std::vector<std::string> outputs = model.output_names();
  std::vector<model::ScalarObservation> sensors;
  std::vector<double> std;
  for (auto& [name, series] : m.series) {
    const bool is_known = std::any_of(project.known.begin(), project.known.end(),
                                      [&](const KnownParameter& known) { return known.name == name; });
    if (name == project.clock && std::find(outputs.begin(), outputs.end(), name) != outputs.end())
      settle_units(sensor_of(project, model, name, source), source, series);
    if (name == project.clock || is_known) continue;
    const model::ScalarObservation sensor = sensor_of(project, model, name, source);
    settle_units(sensor, source, series);
    if (!series.std) {
      data.unused.push_back(name);
      continue;
    }
    sensors.push_back(sensor);
    std.push_back(*series.std);
    m.sensors.scalars.push_back(name);
  }
  if (sensors.empty()) return;
  const Eigen::Index n = m.values.rows(), count = std::ssize(sensors);
  m.values.conservativeResize(n + count, Eigen::NoChange);
  for (Eigen::Index i = 0; i < count; ++i) {
    const std::vector<double>& values = m.series.at(m.sensors.scalars[i]).values;
    m.values.row(n + i) = Eigen::Map<const Eigen::RowVectorXd>(values.data(), m.values.cols());
  }
  m.noise = m.noise.with_scalars(Eigen::Map<const Eigen::VectorXd>(std.data(), count));
  data.observed =
      std::make_shared<const model::ObservedModel>(model::with_scalars(*data.observed, model, sensors));
}

/// A model at the times of the data, and what its errors come from: rates of change by something that was
/// measured, with the standard deviation of that measurement.
struct Placed {
  model::ObservedModel model;
  struct Error {
    model::ObservedModel rate;
    std::vector<double> std;  ///< per datum
    bool lasts = false;       ///< one error for all data, by which the clock's time is off
  };
  std::vector<Error> errors;
};

const MeasuredSeries& series_of(const likelihood::Measurements& m, const std::string& name,
                                const std::string& wanted_by, const std::string& source) {
  const auto series = m.series.find(name);
  if (series != m.series.end()) return series->second;
  throw DataError(
      fmt::format("{}: {}, but there is no series of that name: HDF5 has it as /outputs/{}, CSV in rows "
                  "whose component is {}",
                  source, wanted_by, name, name));
}

Placed place_by_clock(const Project& project, const model::SeparatedModel& model, const std::string& source,
                      const likelihood::Measurements& m, const model::ObservedModel& whole) {
  const MeasuredSeries& series =
      series_of(m, project.clock, fmt::format("data.clock = \"{}\"", project.clock), source);
  const likelihood::ClockReading clock = likelihood::read_clock(model, project.clock, series, source);
  Placed placed{model::at_times(whole, clock.time), {}};
  if (series.std) placed.errors.push_back({model::rates_at_times(whole, clock.time), clock.std});
  if (m.series_time_std > 0) {
    std::vector<double> per_time = clock.rate;
    for (std::size_t i = 0; i < per_time.size(); ++i) per_time[i] *= series.rate[i];
    placed.errors.push_back({model::rates_at_times(whole, clock.time), std::move(per_time), true});
  }
  return placed;
}

/// Takes the last of the parameters as known. `axes`: those that the model still has.
void give_last(const std::string& name, std::span<const model::Axis> axes, const likelihood::Measurements& m,
               const std::string& source, Placed& placed) {
  const MeasuredSeries& series = series_of(m, name, fmt::format("the parameter {} is known", name), source);
  const std::vector<double>& nodes = axes.back().nodes;
  for (std::size_t i = 0; i < series.values.size(); ++i) {
    const double value = series.values[i];
    if (std::isnan(value)) {
      throw DataError(fmt::format(
          "{}: outputs/{}[{}] is missing: the parameter is known, so its value is needed at each time",
          source, name, i));
    }
    if (!(value >= nodes.front() && value <= nodes.back())) {
      throw DataError(fmt::format("{}: outputs/{}[{}] = {} is outside the model's axis, {} to {}", source,
                                  name, i, value, nodes.front(), nodes.back()));
    }
  }
  if (series.std) {
    placed.errors.push_back({model::with_last_given(placed.model, axes, series.values, 1),
                             std::vector<double>(series.values.size(), *series.std)});
  }
  const std::size_t others = placed.errors.size() - (series.std ? 1 : 0);
  for (std::size_t k = 0; k < others; ++k)
    placed.errors[k].rate = model::with_last_given(placed.errors[k].rate, axes, series.values);
  placed.model = model::with_last_given(placed.model, axes, series.values);
}

/// The model at the times of the data, with what is known given. What an error of the clock that lasts does
/// to each observation, n × n_t per unit of time; empty where there is none.
Eigen::MatrixXd place(const Project& project, const model::SeparatedModel& model,
                      const std::vector<posterior::Prior>& priors, const std::string& source,
                      ObservedData& data) {
  likelihood::Measurements& m = data.measurements;
  Placed placed = project.clock.empty()
                      ? Placed{model::at_steps(*data.observed,
                                               likelihood::match_times(m.time, data.observed->time, source)),
                               {}}
                      : place_by_clock(project, model, source, m, *data.observed);
  std::span<const model::Axis> axes = model.contents().axes;
  for (std::size_t k = project.known.size(); k-- > 0; axes = axes.first(axes.size() - 1)) {
    give_last(project.known[k].name, axes, m, source, placed);
    data.known.insert(data.known.begin(), m.series.at(project.known[k].name).values.back());
  }
  const auto transform = likelihood::truncated_to_box(placed.model, priors);
  Eigen::MatrixXd lasting;
  for (const Placed::Error& error : placed.errors) {
    if (error.lasts)
      lasting = likelihood::mean_rates(error.rate, *transform) *
                Eigen::Map<const Eigen::VectorXd>(error.std.data(), std::ssize(error.std)).asDiagonal();
    else
      m.noise = likelihood::with_clock_error(m.noise, error.rate, *transform, error.std);
  }
  data.time_indices.resize(placed.model.time.size());
  std::iota(data.time_indices.begin(), data.time_indices.end(), std::size_t{0});
  data.observed = std::make_shared<const model::ObservedModel>(std::move(placed.model));
  return lasting;
}

/// The standard deviations of the project for the series of its data file.
void set_series_std(const Project& project, likelihood::Measurements& recorded) {
  for (const auto& [name, std] : project.series_std) {
    const auto found = recorded.series.find(name);
    if (found == recorded.series.end()) {
      std::vector<std::string> names;
      for (const auto& [other, series] : recorded.series) names.push_back(other);
      throw project.error_at(
          "data.std." + name,
          fmt::format("{} has no series \"{}\"{}; it has {}", project.data, name, did_you_mean(name, names),
                      names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
    }
    found->second.std = std;
  }
}

}  // namespace

likelihood::Measurements read_recorded(const Project& project, const model::ModelContents& model) {
  const bool fields = !project.fields.files.empty();
  likelihood::Measurements recorded =
      fields ? measure_fields(project, model).measurements : likelihood::read_measurements(project.data);
  if (project.fields.beside.empty())
    set_series_std(project, recorded);
  else
    add_series_beside(project, project.fields.beside, recorded);
  return recorded;
}

void add_series_beside(const Project& project, const std::string& path, likelihood::Measurements& measured) {
  const char* const what = project.fields.files.empty() ? "pictures" : "fields";
  likelihood::Measurements recorded = likelihood::read_measurements(path);
  if (recorded.values.rows() > 0)
    throw DataError(fmt::format(
        "{}: it holds displacements, but beside [data] {} only its series are read: leave them out, or "
        "give a gauge as a series with a table [data.sensors]",
        path, what));
  bool overlaps = false;
  for (const auto& [name, series] : recorded.series) {
    MeasuredSeries& here = measured.series[name] =
        likelihood::interpolate_series(series, recorded.time, measured.time);
    overlaps = overlaps || std::any_of(here.values.begin(), here.values.end(),
                                       [](double value) { return !std::isnan(value); });
  }
  set_series_std(project, measured);
  if (!overlaps && !recorded.time.empty() && !measured.time.empty())
    throw DataError(
        fmt::format("{}: its times, {} to {}, and those of the {}, {} to {}, have none in common: both "
                    "must be read "
                    "from one clock ([data] time_offset_std is for what is left between two)",
                    path, recorded.time.front(), recorded.time.back(), what, measured.time.front(),
                    measured.time.back()));
  measured.series_time_std = project.time_offset_std;
}

ObservedData observe_data(const Project& project, const model::SeparatedModel& model,
                          const std::vector<posterior::Prior>& priors, likelihood::Measurements measurements,
                          const std::string& source) {
  ObservedData data;
  data.measurements = std::move(measurements);
  likelihood::Measurements& m = data.measurements;
  data.observed = std::make_shared<const model::ObservedModel>(model::observe(model, m.sensors));
  add_series(project, model, source, data);
  Eigen::MatrixXd by_clock;
  if (project.clock.empty() && project.known.empty())
    data.time_indices = likelihood::match_times(
        m.time, data.observed->time, project.pictures.folder.empty() ? source : project.pictures.folder);
  else
    by_clock = place(project, model, priors, source, data);
  m.noise = with_shared_errors(m, by_clock);
  m.noise = with_motion(project.fields, m);
  return data;
}

}  // namespace knothe::project
