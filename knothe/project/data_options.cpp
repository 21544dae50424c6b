#include "knothe/project/data_options.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/error.hpp"
#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

using posterior::Prior;

struct SensorOptions {
  enum class Kind { strain, opening, strain_in_window, combination } kind = Kind::strain;
  std::vector<double> from, to, at;
  std::string strain;
  double window = 0;
  std::vector<std::vector<double>> points;
  std::vector<int> components;
  std::vector<double> coefficients;
};

constexpr auto names_of(SensorOptions::Kind /*kind*/) {
  using Kind = SensorOptions::Kind;
  return std::to_array<Named<Kind>>({{Kind::strain, "strain"},
                                     {Kind::opening, "opening"},
                                     {Kind::strain_in_window, "strain-in-window"},
                                     {Kind::combination, "combination"}});
}

const Section<SensorOptions>& sensor_section() {
  using S = SensorOptions;
  static const Section<S> k_section("data.sensors.*", "A sensor of that name.", [](Section<S>& s) {
    s.add("kind", &S::kind,
          "Relative displacement of two points along the line between them, divided by their distance "
          "(`strain`) or in metres (`opening`); the strain that image correlation states at a point "
          "(`strain-in-window`); or a weighted sum of displacements (`combination`).",
          required);
    s.add("from", &S::from, "First point of a strain gauge or an opening, [x, y, z], m.");
    s.add("to", &S::to, "Second point of it.");
    s.add("at", &S::at, "Point of a strain in a window, [x, y, z], m.");
    s.add("strain", &S::strain,
          "Which strain in a window: `xx`, `yy`, `zz`, `xy`, `xz` or `yz` (of a shear half the angle).",
          no_default);
    s.add("window", &S::window,
          "Width of the square that the strain is fitted over, m: of image correlation the virtual strain "
          "gauge.",
          positive, no_default);
    s.add("points", &S::points, "Points of a combination, [[x, y, z], …], m.");
    s.add("components", &S::components, "Component at each of these points, `x`, `y` or `z`.",
          of_shape(k_component_words));
    s.add("coefficients", &S::coefficients, "Factor of each of these displacements.");
  });
  return k_section;
}

void add_clock(Section<DataSource>& s) {
  s.add("time_offset_std", &DataSource::time_offset_std,
        "Standard deviation of the offset, constant but unknown, of the file's clock against that of the "
        "pictures, fields or first data file, in their unit of time.",
        non_negative);
  s.add("time_drift_std", &DataSource::time_drift_std,
        "Standard deviation of how much faster the file's clock runs, constant but unknown, as a share.",
        non_negative);
}

const Section<DataSource>& source_section() {
  using S = DataSource;
  static const Section<S> k_section(
      "data.sources.*", "What another device recorded in the same test, by a clock of its own.",
      [](Section<S>& s) {
        s.add("file", &S::file,
              "Its series and displacements, HDF5 or CSV, at any rate: they are observed at the times of the "
              "pictures, fields or `data.file`, linear between the values on either side.",
              file, required);
        add_clock(s);
      });
  return k_section;
}

struct ParameterOptions {
  enum class Kind { normal, uniform, lognormal, posterior, known } kind = Kind::normal;
  std::optional<double> value;
  std::string of, of_name;
  double mean = 0, std = 1;
  double lower = 0, upper = 1;
  double mu = 0, sigma = 1;
};

constexpr auto names_of(ParameterOptions::Kind /*kind*/) {
  using Kind = ParameterOptions::Kind;
  return std::to_array<Named<Kind>>({{Kind::normal, "normal"},
                                     {Kind::uniform, "uniform"},
                                     {Kind::lognormal, "lognormal"},
                                     {Kind::posterior, "posterior"},
                                     {Kind::known, "known"}});
}

const Section<ParameterOptions>& parameter_section() {
  using P = ParameterOptions;
  static const Section<P> k_section(
      "parameters.*", "Prior of the parameter of that name.", [](Section<P>& s) {
        s.add("prior", &P::kind,
              "Family of the prior; or `posterior`: what an earlier test has found; or `known`: a parameter "
              "that is not inferred, for example a temperature, whose value at each time is the series of "
              "its name in the data file (`knothe assimilate`).",
              required);
        s.add("of", &P::of,
              "Results of that test, a folder or its `posterior.nc` or `samples.nc`. Parameters of one test "
              "keep their correlations and the shape of their posterior.",
              file, no_default);
        s.add("of_name", &P::of_name, "Name of the parameter in these results; without it, the same.",
              no_default);
        s.add("value", &P::value,
              "Known parameter: its value for forecasts and fields, and with `knothe serve` for the data; "
              "without it, "
              "the last one measured.");
        s.add("mean", &P::mean, "Mean of a normal prior, before truncation to the model's box.", no_default);
        s.add("std", &P::std, "Standard deviation of a normal prior, before truncation.", positive,
              no_default);
        s.add("lower", &P::lower, "Lower end of a uniform prior.", no_default);
        s.add("upper", &P::upper, "Upper end of a uniform prior.", no_default);
        s.add("mu", &P::mu, "Mean of the logarithm, lognormal prior.", no_default);
        s.add("sigma", &P::sigma, "Standard deviation of the logarithm, lognormal prior.", positive,
              no_default);
      });
  return k_section;
}

std::array<double, 3> point_of(Values& values, const std::vector<double>& point, const std::string& sensor,
                               const char* key) {
  if (point.size() == 3) return {point[0], point[1], point[2]};
  values.complain(sensor + "." + key, fmt::format("[{}] needs \"{}\" = [x, y, z], m", sensor, key));
  return {};
}

model::ScalarObservation combination(Values& values, const SensorOptions& o, const std::string& path) {
  model::ScalarObservation sensor;
  const std::size_t components = values.get<std::vector<std::string>>(path + ".components").size();
  if (o.points.empty() || components != o.points.size() || o.coefficients.size() != o.points.size()) {
    values.complain(path, fmt::format("[{}]: a combination needs as many \"points\" as \"components\" and "
                                      "\"coefficients\", here {}, {} and {}",
                                      path, o.points.size(), components, o.coefficients.size()));
    return sensor;
  }
  for (const auto& point : o.points) {
    if (point.size() != 3)
      values.complain(path + ".points", fmt::format("[{}]: a point is [x, y, z], m", path));
    sensor.points.insert(sensor.points.end(), point.begin(), point.end());
  }
  sensor.components.assign(o.components.begin(), o.components.end());
  sensor.coefficients = o.coefficients;
  return sensor;
}

model::ScalarObservation strain_in_window(Values& values, const SensorOptions& o, const std::string& path) {
  const auto at = point_of(values, o.at, path, "at");
  static const std::string k_axes = "xyz";
  const auto axis = [&](std::size_t i) { return k_axes.find(o.strain[i]); };
  if (o.strain.size() != 2 || axis(0) > axis(1) || axis(1) == std::string::npos) {
    values.complain(path + ".strain", fmt::format("[{}] needs \"strain\", one of \"xx\", \"yy\", \"zz\", "
                                                  "\"xy\", \"xz\", \"yz\"",
                                                  path));
    return {};
  }
  if (!(o.window > 0)) {
    values.complain(path, fmt::format("[{}] needs \"window\", its width in m", path));
    return {};
  }
  return model::ScalarObservation::strain_in_window(path, at, o.window, {int(axis(0)), int(axis(1))});
}

model::ScalarObservation read_sensor(Values& values, const std::string& name) {
  const std::string path = "data.sensors." + name;
  const SensorOptions o = sensor_section().read(values, name);
  model::ScalarObservation sensor;
  if (o.kind == SensorOptions::Kind::combination) {
    sensor = combination(values, o, path);
  } else if (o.kind == SensorOptions::Kind::strain_in_window) {
    sensor = strain_in_window(values, o, path);
  } else {
    const auto from = point_of(values, o.from, path, "from"), to = point_of(values, o.to, path, "to");
    try {
      sensor = model::ScalarObservation::elongation(name, from, to, o.kind == SensorOptions::Kind::strain);
    } catch (const UsageError& error) {
      values.complain(path, fmt::format("[{}]: {}", path, error.what()));
    }
  }
  sensor.name = name;
  return sensor;
}

/// The keys that belong to a kind beside `prior`.
std::vector<std::string> keys_of(ParameterOptions::Kind kind) {
  switch (kind) {
    case ParameterOptions::Kind::normal:
      return {"mean", "std"};
    case ParameterOptions::Kind::uniform:
      return {"lower", "upper"};
    case ParameterOptions::Kind::lognormal:
      return {"mu", "sigma"};
    case ParameterOptions::Kind::posterior:
      return {"of"};
    case ParameterOptions::Kind::known:
      break;
  }
  return {};
}

/// Complains of keys that are not among those `taken`, or are missing from those `needed`.
void check_keys(Values& values, const std::string& path, const std::string& what,
                const std::vector<std::string>& taken, const std::vector<std::string>& needed) {
  const std::vector<std::string> given = values.children_of(path);
  for (const std::string& key : needed) {
    if (std::find(given.begin(), given.end(), key) == given.end())
      values.complain(path, fmt::format("[{}]: a {} needs \"{}\"", path, what, key));
  }
  for (const std::string& key : given) {
    if (key != "prior" && std::find(taken.begin(), taken.end(), key) == taken.end())
      values.complain(path + "." + key, fmt::format("\"{}\" does not belong to a {}, which takes {}", key,
                                                    what, fmt::join(taken, " and ")));
  }
}

Prior prior_of(Values& values, const ParameterOptions& o, const std::string& path) {
  using Kind = ParameterOptions::Kind;
  const std::vector<std::string> keys = keys_of(o.kind);
  std::vector<std::string> taken = keys;
  if (o.kind == Kind::posterior) taken.emplace_back("of_name");
  check_keys(values, path, values.get<std::string>(path + ".prior") + " prior", taken, keys);
  if (o.kind == Kind::posterior) return Prior::normal(0, 1);  // until its file is read
  if (o.kind == Kind::normal) return Prior::normal(o.mean, o.std);
  if (o.kind == Kind::lognormal) return Prior::lognormal(o.mu, o.sigma);
  if (o.upper > o.lower) return Prior::uniform(o.lower, o.upper);
  values.complain(path + ".upper", fmt::format("[{}]: \"upper\" must be greater than \"lower\"", path));
  return Prior::uniform(0, 1);
}

}  // namespace

std::vector<Option> data_option_table() {
  return joined(
      Section<SensorOptions>("data.sensors",
                             "Sensors that are combinations of displacements; the data file has their values "
                             "as a series of the same name."),
      sensor_section(), Section<DataSource>("data", "", add_clock),
      Section<DataSource>("data.sources", "Further files of the same test, one table each."),
      source_section(),
      Section<ParameterOptions>("parameters",
                                "One table per parameter of the model; their order is the order everywhere."),
      parameter_section());
}

std::vector<model::ScalarObservation> read_sensors(Values& values) {
  std::vector<model::ScalarObservation> sensors;
  for (const std::string& name : values.children_of("data.sensors"))
    sensors.push_back(read_sensor(values, name));
  return sensors;
}

void read_sources(Values& values, Project& project) {
  const bool fields = !project.fields.files.empty();
  // Beside pictures that are still to come, series that are too.
  const bool to_come = project.data.empty() && !project.series_std.empty() && project.serve.takes_pictures();
  const bool is_beside = to_come || (!project.data.empty() && (fields || !project.pictures.folder.empty()));
  DataSource first = Section<DataSource>("data", "", add_clock).read(values);
  first.file = project.data;
  if (is_beside) project.sources.push_back(first);
  if (fields) project.data = project.fields.files;
  for (const char* key : {"data.time_offset_std", "data.time_drift_std"})
    if (values.has(key) && !is_beside)
      values.complain(key, fmt::format("\"{}\" is that of \"data.file\" against \"data.pictures\" or "
                                       "[data.fields]: it needs both (of other files: [data.sources])",
                                       key));
  for (const std::string& name : values.children_of("data.sources")) {
    project.sources.push_back(source_section().read(values, name));
    project.sources.back().name = name;
  }
}

void read_parameters(Values& values, Project& project) {
  for (const std::string& name : values.children_of("parameters")) {
    const std::string path = "parameters." + name;
    const ParameterOptions o = parameter_section().read(values, name);
    if (!values.has(path + ".prior")) continue;  // which is complained of already
    if (o.kind != ParameterOptions::Kind::known) {
      project.parameters.push_back({name, prior_of(values, o, path), o.of, o.of_name});
    } else {
      check_keys(values, path, "known parameter", {"value"}, {});
      project.known.push_back({name, o.value});
    }
  }
}

}  // namespace knothe::project
