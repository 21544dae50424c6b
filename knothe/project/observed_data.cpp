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

/// What a series is measured of: an output of the model, else one of the sensors.
model::ScalarObservation sensor_of(std::span<const model::ScalarObservation> sensors,
                                   const model::SeparatedModel& model, const std::string& name,
                                   const std::string& source) {
  for (const model::SnapshotOutput& output : model.contents().outputs)
    if (output.name == name) return {name, name, {}, {}, {}, output.labels.units};
  std::vector<std::string> known = model.output_names();
  for (const model::ScalarObservation& sensor : sensors) {
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

/// What happens to the observations, n × n_t, per unit of time by which a clock is ahead. `by_clock`: what a
/// shift of the model's time does, where one of its series tells that time; then it does nothing to the other
/// series of that clock. Else empty. `expected`: the model's own rates, for series that are still to come.
Eigen::MatrixXd effect_of_clock(const likelihood::Measurements& m, std::size_t clock,
                                const Eigen::MatrixXd& by_clock, const Eigen::MatrixXd& expected) {
  Eigen::MatrixXd effect = by_clock;
  if (effect.size() == 0) effect.setZero(m.values.rows(), m.values.cols());
  const Eigen::Index displacements = m.values.rows() - std::ssize(m.sensors.scalars);
  for (std::size_t k = 0; k < m.sensors.scalars.size(); ++k) {
    const MeasuredSeries& series = m.series.at(m.sensors.scalars[k]);
    if (series.clock != clock) continue;
    auto row = effect.row(displacements + k);
    row.setZero();
    if (by_clock.size() > 0) continue;
    for (std::size_t t = 0; t < m.time.size(); ++t) {
      const bool is_missing = std::isnan(series.rate[t]);
      if (!is_missing || expected.size() > 0)
        row[t] = is_missing ? -expected(displacements + k, t) : -series.rate[t];
    }
  }
  return effect;
}

/// The noise with the errors that all data share: beside those it has, what the values of a series have in
/// common, and what clocks are ahead by. `clock`: the one that tells the model's time, `by_clock` and
/// `expected` as in `effect_of_clock`.
likelihood::NoiseModel with_shared_errors(const Project& project, const model::SeparatedModel& model,
                                          const likelihood::Measurements& m, std::optional<std::size_t> clock,
                                          const Eigen::MatrixXd& by_clock, const Eigen::MatrixXd& expected) {
  const std::vector<std::string>& names = m.sensors.scalars;
  const Eigen::Index displacements = m.values.rows() - std::ssize(names);
  auto [errors, factors] = m.noise.lasting();
  if (factors.empty()) factors.assign(m.time.size(), Eigen::MatrixXd(m.values.rows(), 0));
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
  // Of the data's own clock the first time; of the model's one that does not depend on what has come.
  const std::vector<double>& times = project.clock.empty() ? model.contents().time : m.time;
  const double start = times.empty() ? 0 : times.front();
  for (std::size_t c = 0; c < m.clocks.size(); ++c) {
    const likelihood::SeriesClock& of_source = m.clocks[c];
    const std::string whose = of_source.name.empty() ? "" : of_source.name + ".";
    const Eigen::MatrixXd effect = effect_of_clock(m, c, clock == c ? by_clock : Eigen::MatrixXd(), expected);
    const auto add_error = [&](const char* what, double std, const auto& ahead) {
      if (std == 0) return;
      errors.push_back({whose + what, std});
      for (std::size_t t = 0; t < factors.size(); ++t)
        add_column(factors[t]) = std * ahead(t) * effect.col(t);
    };
    add_error("time_offset", of_source.offset_std, [](std::size_t) { return 1.0; });
    add_error("time_drift", of_source.drift_std, [&](std::size_t t) { return m.time[t] - start; });
  }
  return factors.empty() || factors.front().cols() == 0
             ? m.noise
             : m.noise.with_lasting_errors({std::move(errors), std::move(factors)});
}

/// Rows for the series that are observed.
void add_series(const Project& project, const model::SeparatedModel& model, const std::string& source,
                ObservedData& data) {
  likelihood::Measurements& m = data.measurements;
  const std::vector<model::ScalarObservation> all = sensors_of(project, m);
  for (const model::ScalarObservation& sensor : all) {
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
      settle_units(sensor_of(all, model, name, source), source, series);
    if (name == project.clock || is_known) continue;
    const model::ScalarObservation sensor = sensor_of(all, model, name, source);
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
  std::optional<std::size_t> clock;  ///< whose error that is
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
  Placed placed{model::at_times(whole, clock.time), {}, series.clock};
  if (series.std) placed.errors.push_back({model::rates_at_times(whole, clock.time), clock.std});
  if (series.clock) {
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

/// What an error of the clock that lasts does.
struct ClockEffect {
  std::optional<std::size_t> clock;  ///< of `Measurements::clocks`
  Eigen::MatrixXd rate;              ///< n × n_t, per unit of time; empty: nothing
};

/// The model at the times of the data, with what is known given.
ClockEffect place(const Project& project, const model::SeparatedModel& model,
                  const std::vector<posterior::Prior>& priors, const std::string& source,
                  ObservedData& data) {
  likelihood::Measurements& m = data.measurements;
  Placed placed = project.clock.empty()
                      ? Placed{model::at_steps(*data.observed,
                                               likelihood::match_times(m.time, data.observed->time, source)),
                               {},
                               {}}
                      : place_by_clock(project, model, source, m, *data.observed);
  std::span<const model::Axis> axes = model.contents().axes;
  data.known.resize(std::ssize(m.time), std::ssize(project.known));
  for (Eigen::Index k = data.known.cols(); k-- > 0; axes = axes.first(axes.size() - 1)) {
    const std::string& name = project.known[k].name;
    give_last(name, axes, m, source, placed);
    data.known.col(k) = Eigen::Map<const Eigen::VectorXd>(m.series.at(name).values.data(), data.known.rows());
  }
  const auto transform = likelihood::truncated_to_box(placed.model, priors);
  ClockEffect lasting{placed.clock, {}};
  for (const Placed::Error& error : placed.errors) {
    if (error.lasts)
      lasting.rate = likelihood::mean_rates(error.rate, *transform) *
                     Eigen::Map<const Eigen::VectorXd>(error.std.data(), std::ssize(error.std)).asDiagonal();
    else
      m.noise = likelihood::with_clock_error(m.noise, error.rate, *transform, error.std);
  }
  data.time_indices.resize(placed.model.time.size());
  std::iota(data.time_indices.begin(), data.time_indices.end(), std::size_t{0});
  data.observed = std::make_shared<const model::ObservedModel>(std::move(placed.model));
  return lasting;
}

std::string files_of(const Project& project) {
  std::vector<std::string> files;
  if (project.pictures.folder.empty()) files.push_back(project.data);
  for (const DataSource& source : project.sources) files.push_back(source.file);
  return fmt::format("{}", fmt::join(files, " and "));
}

/// The standard deviations of the project for the series of its data files.
void set_series_std(const Project& project, likelihood::Measurements& recorded) {
  for (const auto& [name, std] : project.series_std) {
    const auto found = recorded.series.find(name);
    if (found == recorded.series.end()) {
      std::vector<std::string> names;
      for (const auto& [other, series] : recorded.series) names.push_back(other);
      throw project.error_at("data.std." + name,
                             fmt::format("{} has no series \"{}\"{}; it has {}", files_of(project), name,
                                         did_you_mean(name, names),
                                         names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
    }
    found->second.std = std;
  }
}

/// The displacements of a source as series, each of a sensor of its own: what is wrong with the camera, its
/// scale or its reference picture, is not wrong with them.
void make_series_of_displacements(const DataSource& source, likelihood::Measurements& recorded) {
  if (!recorded.noise.measurement().is_independent() || likelihood::lasting_count(recorded.noise) > 0)
    throw DataError(source.file +
                    ": its displacements have correlated noise; beside other data only independent ones are "
                    "read: assimilate them alone, or leave out noise/precision and noise/shared_errors");
  const Eigen::VectorXd std = recorded.noise.measurement().standard_deviations();
  const model::Sensors& sensors = recorded.sensors;
  for (std::size_t i = 0; i < sensors.displacement_count(); ++i) {
    const std::string label = (source.name.empty() ? "file" : source.name) + "." + sensors.label(i);
    const Eigen::VectorXd row = recorded.values.row(i);
    recorded.series[label] = {{row.begin(), row.end()}, std[i], {}, "m", {}, {}};
    const auto point = sensors.point(i);
    recorded.gauges.push_back({label, "", {point.begin(), point.end()}, {sensors.components[i]}, {1}, "m"});
  }
}

/// What a source recorded, at the times of `measured`.
void add_source(const Project& project, const DataSource& source, likelihood::Measurements& measured) {
  likelihood::Measurements recorded = likelihood::read_measurements(source.file);
  make_series_of_displacements(source, recorded);
  const std::optional<std::size_t> clock = add_clock(source, measured);
  measured.gauges.insert(measured.gauges.end(), recorded.gauges.begin(), recorded.gauges.end());
  const double span = recorded.time.empty() ? 0 : recorded.time.back() - recorded.time.front();
  const double window = source.time_offset_std + source.time_drift_std * span;
  bool overlaps = false;
  for (const auto& [name, series] : recorded.series) {
    if (measured.series.contains(name))
      throw DataError(fmt::format("{}: its series \"{}\" is in another file of [data] too: leave one out",
                                  source.file, name));
    MeasuredSeries& here = measured.series[name] =
        likelihood::interpolate_series(series, recorded.time, measured.time, window);
    here.clock = clock;
    overlaps = overlaps || std::any_of(here.values.begin(), here.values.end(),
                                       [](double value) { return !std::isnan(value); });
  }
  const char* const what = !project.fields.files.empty()     ? "fields"
                           : project.pictures.folder.empty() ? "data file"
                                                             : "pictures";
  if (!overlaps && !recorded.time.empty() && !measured.time.empty())
    throw DataError(
        fmt::format("{}: its times, {} to {}, and those of the {}, {} to {}, have none in common: both "
                    "must be read from one clock (\"time_offset_std\" is for what is left between two)",
                    source.file, recorded.time.front(), recorded.time.back(), what, measured.time.front(),
                    measured.time.back()));
}

}  // namespace

likelihood::Measurements read_recorded(const Project& project, const model::ModelContents& model) {
  return project.fields.files.empty() ? likelihood::read_measurements(project.data)
                                      : measure_fields(project, model).measurements;
}

std::vector<model::ScalarObservation> sensors_of(const Project& project,
                                                 const likelihood::Measurements& measured) {
  std::vector<model::ScalarObservation> sensors = project.sensors;
  sensors.insert(sensors.end(), measured.gauges.begin(), measured.gauges.end());
  return sensors;
}

std::optional<std::size_t> add_clock(const DataSource& source, likelihood::Measurements& measured) {
  if (source.time_offset_std == 0 && source.time_drift_std == 0) return std::nullopt;
  measured.clocks.push_back({source.name, source.time_offset_std, source.time_drift_std});
  return measured.clocks.size() - 1;
}

void add_sources(const Project& project, likelihood::Measurements& measured) {
  for (const DataSource& source : project.sources)
    if (!source.file.empty()) add_source(project, source, measured);
  set_series_std(project, measured);
}

ObservedData observe_data(const Project& project, const model::SeparatedModel& model,
                          const std::vector<posterior::Prior>& priors, likelihood::Measurements measurements,
                          const std::string& source) {
  ObservedData data;
  data.measurements = std::move(measurements);
  likelihood::Measurements& m = data.measurements;
  data.observed = std::make_shared<const model::ObservedModel>(model::observe(model, m.sensors));
  add_series(project, model, source, data);
  ClockEffect by_clock;
  if (project.clock.empty() && project.known.empty())
    data.time_indices = likelihood::match_times(
        m.time, data.observed->time, project.pictures.folder.empty() ? source : project.pictures.folder);
  else
    by_clock = place(project, model, priors, source, data);
  Eigen::MatrixXd expected;
  if (!m.clocks.empty() && project.clock.empty() && project.known.empty())
    expected = likelihood::mean_rates(model::rates_at_times(*data.observed, m.time),
                                      *likelihood::truncated_to_box(*data.observed, priors));
  m.noise = with_shared_errors(project, model, m, by_clock.clock, by_clock.rate, expected);
  m.noise = with_motion(project.fields, m);
  return data;
}

}  // namespace knothe::project
