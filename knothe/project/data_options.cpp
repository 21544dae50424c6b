#include "knothe/project/data_options.hpp"

#include <fmt/format.h>

#include <array>

#include "knothe/base/error.hpp"
#include "knothe/project/project_values.hpp"

namespace knothe::project {
namespace {

std::array<double, 3> read_point(Values& values, const std::string& path, const std::string& sensor) {
  const std::vector<double> point = values.numbers(path);
  if (point.size() == 3) return {point[0], point[1], point[2]};
  values.complain(path,
                  fmt::format("[{}] needs \"{}\" = [x, y, z], m", sensor, path.substr(path.rfind('.') + 1)));
  return {};
}

reduction::ScalarObservation read_combination(Values& values, const std::string& path) {
  reduction::ScalarObservation sensor;
  const auto points = values.matrix(path + ".points");
  const auto components = values.texts(path + ".components");
  sensor.coefficients = values.numbers(path + ".coefficients");
  if (points.empty() || components.size() != points.size() || sensor.coefficients.size() != points.size()) {
    values.complain(path, fmt::format("[{}]: a combination needs as many \"points\" as \"components\" and "
                                      "\"coefficients\", here {}, {} and {}",
                                      path, points.size(), components.size(), sensor.coefficients.size()));
    return sensor;
  }
  for (const auto& point : points) {
    if (point.size() != 3)
      values.complain(path + ".points", fmt::format("[{}]: a point is [x, y, z], m", path));
    sensor.points.insert(sensor.points.end(), point.begin(), point.end());
  }
  for (const std::string& c : components) {
    if (c != "x" && c != "y" && c != "z") {
      values.complain(path + ".components",
                      fmt::format("a component is \"x\", \"y\" or \"z\", not \"{}\"", c));
    }
    sensor.components.push_back(c.empty() ? 0 : c[0] - 'x');
  }
  return sensor;
}

}  // namespace

reduction::ScalarObservation read_sensor(Values& values, const std::string& name) {
  const std::string path = "data.sensors." + name, kind = values.text(path + ".kind", "");
  if (kind == "combination") {
    reduction::ScalarObservation sensor = read_combination(values, path);
    sensor.name = name;
    return sensor;
  }
  const auto from = read_point(values, path + ".from", path), to = read_point(values, path + ".to", path);
  try {
    return reduction::ScalarObservation::elongation(name, from, to, kind == "strain");
  } catch (const UsageError& error) {
    values.complain(path, fmt::format("[{}]: {}", path, error.what()));
    return {};
  }
}

}  // namespace knothe::project
