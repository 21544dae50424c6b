#include "knothe/likelihood/data/measurements_csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/likelihood/data/time_matching.hpp"

namespace knothe::likelihood {
namespace {

/// One observed dof: where it is and how well it is measured.
struct Sensor {
  Eigen::Index index;
  double x, y, z, std;
};

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

/// The name of a series rather than a direction: it has a letter, and is not x, y or z.
bool is_series(const std::string& component) {
  return component != "x" && component != "y" && component != "z" &&
         std::any_of(component.begin(), component.end(), [](char c) { return std::isalpha(c) != 0; });
}

int component_of(const files::CsvTable& table, std::size_t row, const std::string& text) {
  static constexpr const char* k_letters[] = {"x", "y", "z"};
  for (int c = 0; c < 3; ++c) {
    if (text == k_letters[c] || text == std::to_string(c)) return c;
  }
  table.fail(row, "component",
             "a component is x, y, z or 0, 1, 2, or the name of a series, not \"" + text + "\"");
}

/// A row of a series: its value joins those before it.
void add_to_series(const files::CsvTable& table, std::size_t row, Eigen::Index t, double value, double std,
                   double shared_std, const std::string& name, bool has_place, std::vector<bool>& filled,
                   MeasuredSeries& series, bool is_new) {
  if (filled[t])
    table.fail(row, has_place ? "component" : "time",
               has_place
                   ? fmt::format("component {}: x, y or z, or a series of the model; of a series there is "
                                 "one value at a time, and this is the second",
                                 name)
                   : "a second value of this series at this time");
  filled[t] = true;
  series.values[t] = value;
  if (!std::isnan(shared_std)) {
    if (!(shared_std >= 0)) table.fail(row, "shared_std", "a standard deviation is not negative");
    series.shared_std.resize(series.values.size(), 0.0);
    series.shared_std[t] = shared_std;
  }
  if (!std::isnan(std) && !(std > 0)) table.fail(row, "std", "a standard deviation is positive");
  const std::optional<double> given = std::isnan(std) ? std::nullopt : std::optional(std);
  if (is_new) series.std = given;
  if (series.std != given) table.fail(row, "std", "this series had another std before: one per series");
}

/// By index; a sensor of several components has one name for each. Empty where all are numbers, "7" or "s7".
std::vector<std::string> names_of(const std::map<std::pair<std::string, int>, Sensor>& sensors) {
  std::map<std::string, int> components;
  bool are_numbers = true;
  for (const auto& [key, sensor] : sensors) {
    ++components[key.first];
    const std::string number = key.first.substr(key.first.starts_with('s') ? 1 : 0);
    are_numbers =
        are_numbers && !number.empty() && number.find_first_not_of("0123456789") == std::string::npos;
  }
  std::vector<std::string> names(are_numbers ? 0 : sensors.size());
  for (const auto& [key, sensor] : sensors)
    if (!are_numbers)
      names[sensor.index] =
          components[key.first] == 1 ? key.first : fmt::format("{} {}", key.first, "xyz"[key.second]);
  return names;
}

/// "force [N]" or "force (N)": name and unit.
std::pair<std::string, std::string> name_and_unit(const std::string& heading) {
  static constexpr std::pair<char, char> k_brackets[] = {{'[', ']'}, {'(', ')'}};
  for (const auto& [open, close] : k_brackets) {
    const std::size_t at = heading.rfind(open);
    if (at == std::string::npos || at == 0 || heading.back() != close) continue;
    return {heading.substr(0, heading.find_last_not_of(' ', at - 1) + 1),
            heading.substr(at + 1, heading.size() - at - 2)};
  }
  return {heading, ""};
}

/// One row a time: a column `time`, and one of each series.
Measurements series_of_columns(const files::CsvTable& table) {
  Measurements m;
  std::string of_time;
  for (const std::string& heading : table.header())
    if (name_and_unit(heading).first == "time") of_time = heading;
  m.time = table.numbers(of_time.empty() ? "time" : of_time);
  for (std::size_t row = 1; row < m.time.size(); ++row)
    if (!(m.time[row] > m.time[row - 1])) table.fail(row, of_time, "the times of a table of series increase");
  for (const std::string& heading : table.header()) {
    if (heading == of_time) continue;
    const auto [name, unit] = name_and_unit(heading);
    MeasuredSeries series;
    series.values = table.numbers(heading, true);
    series.units = unit;
    if (!m.series.emplace(name, std::move(series)).second)
      table.fail(0, heading, "a second column of the series \"" + name + "\"");
  }
  m.values.resize(0, std::ssize(m.time));
  m.noise = NoiseModel::independent(Eigen::VectorXd());
  return m;
}

}  // namespace

Measurements read_measurements_csv(const std::string& path) {
  return read_measurements_csv(files::CsvTable::read(path));
}

Measurements read_measurements_csv(const files::CsvTable& table) {
  if (!table.has("component") && !table.has("value") && !table.has("sensor")) return series_of_columns(table);
  const std::vector<double> time = table.numbers("time"), x = table.numbers("x", true),
                            y = table.numbers("y", true), z = table.numbers("z", true),
                            value = table.numbers("value", true), std = table.numbers("std", true);
  const std::vector<double> shared = table.has("shared_std") ? table.numbers("shared_std", true)
                                                             : std::vector<double>(table.row_count(), k_nan);
  const std::vector<std::string> name = table.texts("sensor"), component = table.texts("component");
  const std::vector<double> times = distinct_times(time);
  const auto place_of = [&](double at) {  // the nearest
    const auto after = std::lower_bound(times.begin(), times.end(), at);
    const bool before = after == times.end() || (after != times.begin() && at - after[-1] < *after - at);
    return after - times.begin() - (before ? 1 : 0);
  };

  std::map<std::pair<std::string, int>, Sensor> sensors;
  std::vector<std::pair<const Sensor*, int>> of_row;
  std::vector<std::pair<const Sensor*, int>> in_order;
  std::map<std::string, MeasuredSeries> series;
  std::map<std::string, std::vector<bool>> filled;
  for (std::size_t row = 0; row < table.row_count(); ++row) {
    if (is_series(component[row])) {
      const bool has_place = !std::isnan(x[row]) && !std::isnan(y[row]) && !std::isnan(z[row]);
      if (has_place && (component[row] == "X" || component[row] == "Y" || component[row] == "Z"))
        table.fail(row, "component",
                   fmt::format("component {}: x, y or z, or a series of the model (did you mean {}?)",
                               component[row],
                               component[row] == "X"   ? "x"
                               : component[row] == "Y" ? "y"
                                                       : "z"));
      const auto [it, is_new] = series.try_emplace(component[row]);
      if (is_new) {
        it->second.values.assign(times.size(), k_nan);
        filled[component[row]].assign(times.size(), false);
      }
      const Index t = place_of(time[row]);
      add_to_series(table, row, t, value[row], std[row], shared[row], component[row], has_place,
                    filled[component[row]], it->second, is_new);
      of_row.emplace_back(nullptr, 0);
      continue;
    }
    if (!std::isnan(shared[row]))
      table.fail(row, "shared_std", "an error that is shared is one of a series, not of displacements");
    const int c = component_of(table, row, component[row]);
    for (const auto& [column, coordinate] : {std::pair("x", x[row]), {"y", y[row]}, {"z", z[row]}}) {
      if (std::isnan(coordinate)) table.fail(row, column, "a number is needed here");
    }
    if (!(std[row] > 0)) table.fail(row, "std", "a standard deviation is positive");
    const auto [it, is_new] =
        sensors.try_emplace({name[row], c}, Sensor{std::ssize(sensors), x[row], y[row], z[row], std[row]});
    const Sensor& sensor = it->second;
    if (is_new) in_order.emplace_back(&sensor, c);
    if (sensor.x != x[row] || sensor.y != y[row] || sensor.z != z[row]) {
      table.fail(row, "x", "sensor \"" + name[row] + "\" was elsewhere before: one point per sensor");
    }
    if (sensor.std != std[row]) {
      table.fail(row, "std",
                 "sensor \"" + name[row] + "\" had another std before: one per sensor and component");
    }
    of_row.emplace_back(&sensor, c);
  }

  Measurements m;
  m.time = times;
  m.series = std::move(series);
  const auto n_obs = std::ssize(sensors);
  m.values.setConstant(n_obs, std::ssize(times), k_nan);
  Eigen::MatrixXi lines = Eigen::MatrixXi::Zero(n_obs, m.values.cols());
  for (std::size_t row = 0; row < table.row_count(); ++row) {
    if (of_row[row].first == nullptr) continue;
    const Eigen::Index i = of_row[row].first->index;
    const Index t = place_of(time[row]);
    if (lines(i, t)++ > 0)
      table.fail(row, "time", "a second value of sensor \"" + name[row] + "\" at this time");
    m.values(i, t) = value[row];
  }
  Eigen::VectorXd deviations(n_obs);
  for (const auto& [sensor, c] : in_order) {
    m.sensors.add(std::array{sensor->x, sensor->y, sensor->z}, c);
    deviations[sensor->index] = sensor->std;
  }
  m.noise = NoiseModel::independent(deviations);
  m.sensors.names = names_of(sensors);
  return m;
}

void write_measurements_csv(const std::string& path, const Measurements& m) {
  const std::size_t rows = m.values.rows();
  if (rows > 0 && !m.noise.measurement().is_independent())
    throw UsageError(path + ": a CSV file holds a std for each value, no correlated noise: write HDF5");
  const Eigen::VectorXd std = rows > 0 ? m.noise.measurement().standard_deviations() : Eigen::VectorXd();
  const auto number = [](double value) { return std::isnan(value) ? "" : files::format_number(value); };
  const bool shared = std::any_of(m.series.begin(), m.series.end(),
                                  [](const auto& series) { return !series.second.shared_std.empty(); });
  std::string text = shared ? "time,sensor,x,y,z,component,value,std,shared_std\n"
                            : "time,sensor,x,y,z,component,value,std\n";
  for (std::size_t t = 0; t < m.time.size(); ++t) {
    const std::string time = number(m.time[t]);
    for (std::size_t i = 0; i < rows; ++i) {
      const auto at = m.sensors.point(i);
      const Eigen::Index row = i;
      text += fmt::format("{},s{},{},{},{},{},{},{}{}\n", time, i, number(at[0]), number(at[1]),
                          number(at[2]), "xyz"[m.sensors.components[i]], number(m.values(row, t)),
                          number(std[row]), shared ? "," : "");
    }
    for (const auto& [name, series] : m.series) {
      text += fmt::format("{0},{1},,,,{1},{2},{3}", time, name, number(series.values[t]),
                          series.std ? number(*series.std) : "");
      if (shared) text += "," + (series.shared_std.empty() ? "" : number(series.shared_std[t]));
      text += "\n";
    }
  }
  files::write_text_atomically(path, text);
}

}  // namespace knothe::likelihood
