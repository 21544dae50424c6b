#include "knothe/assimilation/measurements.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/assimilation/measurements_csv.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/hdf5.hpp"

namespace knothe::assimilation {
namespace {

using files::Hdf5Reader;
using files::Shape;

NoiseModel read_precision(const Hdf5Reader& file, std::size_t n_obs) {
  const std::string group = "/noise/precision";
  if (file.has_attribute(group, "shared_reference")) {
    throw DataError(
        file.path() +
        ": noise/precision has the attribute shared_reference (errors shared through the reference picture): "
        "not supported by this version; remove it to treat pictures as independent");
  }
  const std::vector<double> data = file.read(group + "/data");
  const std::vector<std::int64_t> indices = file.read_integers(group + "/indices");
  const std::vector<std::int64_t> rows = file.read_integers(group + "/indptr");
  if (rows.size() != n_obs + 1 || rows.back() != static_cast<std::int64_t>(data.size()) ||
      indices.size() != data.size()) {
    throw DataError(
        fmt::format("{}: noise/precision is not a CSR matrix of {} rows: indptr has {} entries, indices {}, "
                    "data {}",
                    file.path(), n_obs, rows.size(), indices.size(), data.size()));
  }
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(data.size());
  for (std::size_t i = 0; i < n_obs; ++i) {
    for (std::int64_t k = rows[i]; k < rows[i + 1]; ++k) {
      if (k < 0 || k >= rows.back() || indices[k] < 0 || indices[k] >= static_cast<std::int64_t>(n_obs)) {
        throw DataError(fmt::format("{}: noise/precision/indices: entry {} of row {} is out of range",
                                    file.path(), k, i));
      }
      entries.emplace_back(static_cast<int>(i), static_cast<int>(indices[k]), data[k]);
    }
  }
  Eigen::SparseMatrix<double> precision(static_cast<Eigen::Index>(n_obs), static_cast<Eigen::Index>(n_obs));
  precision.setFromTriplets(entries.begin(), entries.end());
  return NoiseModel::correlated(precision);
}

NoiseModel read_noise(const Hdf5Reader& file, std::size_t n_obs) {
  try {
    if (file.has("/noise/std")) {
      const std::vector<double> std = file.read("/noise/std", Shape{n_obs});
      return NoiseModel::independent(
          Eigen::Map<const Eigen::VectorXd>(std.data(), static_cast<Eigen::Index>(n_obs)));
    }
    if (file.has("/noise/precision")) return read_precision(file, n_obs);
  } catch (const DataError& error) {
    const std::string text = error.what();
    throw DataError(text.starts_with(file.path()) ? text : file.path() + ": " + text);
  }
  throw DataError(file.path() +
                  ": neither noise/std nor noise/precision: the noise of the measurements must be given");
}

void check_times(const std::vector<double>& time, const std::string& path) {
  if (time.empty()) throw DataError(path + ": time is empty: there is nothing to assimilate");
  for (std::size_t i = 1; i < time.size(); ++i) {
    if (!(time[i] > time[i - 1])) {
      throw DataError(fmt::format("{}: time[{}] = {} is not greater than time[{}] = {}: times must increase",
                                  path, i, time[i], i - 1, time[i - 1]));
    }
  }
}

Measurements read_hdf5(const std::string& path) {
  const Hdf5Reader file(path);
  Measurements m;
  m.time = file.read("/time");
  check_times(m.time, path);
  const Shape shape = file.shape("/values");
  if (shape.size() != 2 || shape[0] != m.time.size()) {
    throw DataError(
        fmt::format("{}: values must have the shape [n_t, n_obs] with n_t = {}", path, m.time.size()));
  }
  const std::size_t n_t = shape[0], n_obs = shape[1];
  const std::vector<double> values = file.read("/values", true);
  m.values.resize(static_cast<Eigen::Index>(n_obs), static_cast<Eigen::Index>(n_t));
  for (std::size_t t = 0; t < n_t; ++t) {
    for (std::size_t j = 0; j < n_obs; ++j) {
      const double value = values[t * n_obs + j];
      if (std::isinf(value)) {
        throw DataError(
            fmt::format("{}: values[{},{}] is infinite: give NaN for a missing value", path, t, j));
      }
      m.values(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(t)) = value;
    }
  }
  const std::vector<double> points = file.read("/dofs/points", Shape{n_obs, 3});
  m.points = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>>(
      points.data(), static_cast<Eigen::Index>(n_obs), 3);
  const std::vector<std::int64_t> components = file.read_integers("/dofs/component");
  if (components.size() != n_obs) {
    throw DataError(fmt::format("{}: dofs/component has {} entries, values has {} columns", path,
                                components.size(), n_obs));
  }
  for (std::size_t j = 0; j < n_obs; ++j) {
    if (components[j] < 0 || components[j] > 2) {
      throw DataError(fmt::format("{}: dofs/component[{}] = {}: 0 is x, 1 y, 2 z", path, j, components[j]));
    }
    m.components.push_back(static_cast<int>(components[j]));
  }
  m.noise = read_noise(file, n_obs);
  if (file.has("/truth")) {
    for (const std::string& name : file.members("/truth"))
      m.truth[name] = file.read("/truth/" + name, Shape{1})[0];
  }
  return m;
}

}  // namespace

Measurements read_measurements(const std::string& path) {
  if (path.ends_with(".csv")) {
    Measurements m = read_measurements_csv(path);
    check_times(m.time, path);
    return m;
  }
  return read_hdf5(path);
}

void write_measurements(const std::string& path, const Measurements& m, const std::string& project,
                        std::uint64_t seed) {
  const auto n_obs = static_cast<std::size_t>(m.values.rows()), n_t = m.time.size();
  std::vector<double> points;
  std::vector<std::int64_t> components(m.components.begin(), m.components.end());
  for (Eigen::Index j = 0; j < m.points.rows(); ++j) {
    for (Eigen::Index c = 0; c < 3; ++c) points.push_back(m.points(j, c));
  }
  const Eigen::VectorXd std = m.noise.standard_deviations();
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    file.write("/time", m.time, {n_t}, {"1", "model time"});
    // Column-major n_obs × n_t is the C order of [n_t, n_obs].
    file.write("/values", {m.values.data(), n_obs * n_t}, {n_t, n_obs}, {"m", "measured displacement"});
    file.write("/dofs/points", points, {n_obs, 3}, {"m", "measurement points"});
    file.write_integers("/dofs/component", components, {n_obs},
                        {"1", "displacement component: 0 x, 1 y, 2 z"});
    file.write("/noise/std", {std.data(), n_obs}, {n_obs}, {"m", "standard deviation of the noise"});
    for (const auto& [name, value] : m.truth)
      file.write("/truth/" + name, {&value, 1}, {1}, {"1", "true value"});
    file.text_attribute("/", "created_by", k_created_by);
    file.text_attribute("/", "project", project);
    file.number_attribute("/", "seed", static_cast<double>(seed));
    file.close();
  });
}

}  // namespace knothe::assimilation
