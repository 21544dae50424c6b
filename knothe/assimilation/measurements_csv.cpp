#include "knothe/assimilation/measurements_csv.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "knothe/files/csv.hpp"

namespace knothe::assimilation {
namespace {

/// One observed dof: where it is and how well it is measured.
struct Sensor {
  Eigen::Index index;
  double x, y, z, std;
};

int component_of(const files::CsvTable& table, std::size_t row, const std::string& text) {
  static constexpr const char* k_letters[] = {"x", "y", "z"};
  for (int c = 0; c < 3; ++c) {
    if (text == k_letters[c] || text == std::to_string(c)) return c;
  }
  table.fail(row, "component", "a component is x, y, z or 0, 1, 2, not \"" + text + "\"");
}

}  // namespace

Measurements read_measurements_csv(const std::string& path) {
  const files::CsvTable table = files::CsvTable::read(path);
  const std::vector<double> time = table.numbers("time"), x = table.numbers("x"), y = table.numbers("y"),
                            z = table.numbers("z"), value = table.numbers("value", true),
                            std = table.numbers("std");
  const std::vector<std::string> name = table.texts("sensor"), component = table.texts("component");
  std::vector<double> times = time;
  std::sort(times.begin(), times.end());
  times.erase(std::unique(times.begin(), times.end()), times.end());

  std::map<std::pair<std::string, int>, Sensor> sensors;
  std::vector<std::pair<const Sensor*, int>> of_row;
  std::vector<std::pair<const Sensor*, int>> in_order;
  for (std::size_t row = 0; row < table.row_count(); ++row) {
    const int c = component_of(table, row, component[row]);
    if (!(std[row] > 0)) table.fail(row, "std", "a standard deviation is positive");
    const auto [it, is_new] = sensors.try_emplace(
        {name[row], c}, Sensor{static_cast<Eigen::Index>(sensors.size()), x[row], y[row], z[row], std[row]});
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
  const auto n_obs = static_cast<Eigen::Index>(sensors.size());
  m.values.setConstant(n_obs, static_cast<Eigen::Index>(times.size()),
                       std::numeric_limits<double>::quiet_NaN());
  Eigen::MatrixXi lines = Eigen::MatrixXi::Zero(n_obs, m.values.cols());
  for (std::size_t row = 0; row < table.row_count(); ++row) {
    const Eigen::Index i = of_row[row].first->index;
    const Eigen::Index t = std::lower_bound(times.begin(), times.end(), time[row]) - times.begin();
    if (lines(i, t)++ > 0)
      table.fail(row, "time", "a second value of sensor \"" + name[row] + "\" at this time");
    m.values(i, t) = value[row];
  }
  m.points.resize(n_obs, 3);
  Eigen::VectorXd deviations(n_obs);
  for (const auto& [sensor, c] : in_order) {
    m.points.row(sensor->index) << sensor->x, sensor->y, sensor->z;
    m.components.push_back(c);
    deviations[sensor->index] = sensor->std;
  }
  m.noise = NoiseModel::independent(deviations);
  return m;
}

}  // namespace knothe::assimilation
