#include "knothe/likelihood/data/measurements.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/extension.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/units.hpp"
#include "knothe/likelihood/data/measurements_csv.hpp"
#include "knothe/likelihood/data/time_matching.hpp"

namespace knothe::likelihood {
namespace {

using files::Hdf5Reader;
using files::Shape;

/// Values of a data set, converted as its attribute `units` asks for.
void in_si(const Hdf5Reader& file, const std::string& name, std::string_view si,
           std::vector<double>& values) {
  const double factor = files::factor_to_si(file, name, si);
  if (factor != 1)
    for (double& value : values) value *= factor;
}

Eigen::SparseMatrix<double> read_matrix(const Hdf5Reader& file, const std::string& group, std::size_t n_obs) {
  const std::string name = group.substr(1);
  std::vector<double> data = file.read(group + "/data");
  in_si(file, group + "/data", "1/m2", data);
  const std::vector<std::int64_t> indices = file.read_integers(group + "/indices");
  const std::vector<std::int64_t> rows = file.read_integers(group + "/indptr");
  if (rows.size() != n_obs + 1 || rows.back() != std::ssize(data) || indices.size() != data.size()) {
    throw DataError(
        fmt::format("{}: {} is not a CSR matrix of {} rows: indptr has {} entries, indices {}, data {}",
                    file.path(), name, n_obs, rows.size(), indices.size(), data.size()));
  }
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(data.size());
  for (std::size_t i = 0; i < n_obs; ++i) {
    for (std::int64_t k = rows[i]; k < rows[i + 1]; ++k) {
      if (k < 0 || k >= rows.back() || indices[k] < 0 || indices[k] >= static_cast<std::int64_t>(n_obs)) {
        throw DataError(
            fmt::format("{}: {}/indices: entry {} of row {} is out of range", file.path(), name, k, i));
      }
      entries.emplace_back(i, indices[k], data[k]);
    }
  }
  Eigen::SparseMatrix<double> precision(n_obs, n_obs);
  precision.setFromTriplets(entries.begin(), entries.end());
  return precision;
}

/// The attribute `shared_reference` of noise/precision or noise/std: a number of reference pictures.
NoiseModel with_shared_reference(const Hdf5Reader& file, const std::string& name, const NoiseModel& noise) {
  if (!file.has_attribute(name, "shared_reference")) return noise;
  const double pictures = file.number_attribute(name, "shared_reference");
  if (!(pictures >= 1) || pictures != std::floor(pictures) || pictures > 1e6) {
    throw DataError(fmt::format(
        "{}: the attribute shared_reference of {} is {}: it is the number of reference pictures, 1 or more",
        file.path(), name.substr(1), pictures));
  }
  return noise.with_shared_reference(pictures);
}

/// Its attribute `relative_scale_std`: how accurately the metres per pixel are known.
NoiseModel with_scale_error(const Hdf5Reader& file, const std::string& name, const NoiseModel& noise) {
  if (!file.has_attribute(name, "relative_scale_std")) return noise;
  const double std = file.number_attribute(name, "relative_scale_std");
  if (!(std >= 0 && std < 1))
    throw DataError(
        fmt::format("{}: the attribute relative_scale_std of {} is {}: it is a share of the scale, below 1",
                    file.path(), name.substr(1), std));
  return noise.with_scale_error(std);
}

/// noise/shared_errors: what errors that all data have together do to the values, by their standard
/// deviations.
NoiseModel with_shared_errors(const Hdf5Reader& file, const NoiseModel& noise, std::size_t n_obs,
                              std::size_t n_t) {
  const std::string name = "/noise/shared_errors";
  if (!file.has(name)) return noise;
  const Shape shape = file.shape(name);
  if (shape.size() != 3 || shape[0] != n_t || shape[1] != n_obs)
    throw DataError(fmt::format("noise/shared_errors must have the shape [{}, {}, q], q the number of errors",
                                n_t, n_obs));
  std::vector<double> effects = file.read(name);
  in_si(file, name, "m", effects);
  LastingErrors lasting;
  if (file.has_attribute(name, "names"))
    for (const std::string& error : file.texts_attribute(name, "names")) lasting.errors.push_back({error, 1});
  if (lasting.errors.size() != shape[2])
    throw DataError(fmt::format("the attribute names of noise/shared_errors must have {} texts", shape[2]));
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  for (std::size_t t = 0; t < n_t; ++t)
    lasting.factors.push_back(
        Eigen::Map<const RowMajor>(effects.data() + t * n_obs * shape[2], n_obs, shape[2]));
  return shape[2] == 0 ? noise : noise.with_lasting_errors(std::move(lasting));
}

/// noise/precision_steps/I, pictures with a noise of their own.
NoiseModel with_steps(const Hdf5Reader& file, NoiseModel noise, std::size_t n_obs, std::size_t n_t) {
  if (!file.has("/noise/precision_steps")) return noise;
  for (const std::string& name : file.members("/noise/precision_steps")) {
    const std::string group = "/noise/precision_steps/" + name;
    std::size_t step = n_t;
    const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), step);
    if (error != std::errc() || end != name.data() + name.size() || step >= n_t) {
      throw DataError(fmt::format("{}: noise/precision_steps/{}: the name is a step, 0 to {}", file.path(),
                                  name, n_t - 1));
    }
    try {
      noise = noise.with_step(step, GaussianNoise::correlated(read_matrix(file, group, n_obs)));
    } catch (const DataError& e) {
      const std::string text = e.what();
      if (text.starts_with(file.path())) throw;
      throw DataError(fmt::format("{}: noise/precision_steps/{}: {}", file.path(), name, text));
    }
  }
  return noise;
}

/// Beside values in another unit than m: of a noise without a unit it is not known which is meant.
void require_unit_of_noise(const Hdf5Reader& file) {
  if (files::factor_to_si(file, "/values", "m") == 1) return;
  for (const char* name : {"/noise/std", "/noise/precision/data"})
    if (file.has(name) && file.labels(name).units.empty())
      throw DataError(fmt::format("{}: values is in {}, and {} has no attribute units: say which it is in",
                                  file.path(), file.labels("/values").units, name + 1));
}

NoiseModel read_noise(const Hdf5Reader& file, std::size_t n_obs, std::size_t n_t) {
  require_unit_of_noise(file);
  try {
    if (file.has("/noise/std")) {
      std::vector<double> std = file.read("/noise/std", Shape{n_obs});
      in_si(file, "/noise/std", "m", std);
      const NoiseModel noise = NoiseModel::independent(Eigen::Map<const Eigen::VectorXd>(std.data(), n_obs));
      return with_shared_errors(file, with_shared_reference(file, "/noise/std", noise), n_obs, n_t);
    }
    if (file.has("/noise/precision")) {
      NoiseModel noise = NoiseModel::correlated(read_matrix(file, "/noise/precision", n_obs));
      noise = with_shared_reference(file, "/noise/precision", with_steps(file, noise, n_obs, n_t));
      return with_shared_errors(file, with_scale_error(file, "/noise/precision", noise), n_obs, n_t);
    }
  } catch (const DataError& error) {
    const std::string text = error.what();
    throw DataError(text.starts_with(file.path()) ? text : file.path() + ": " + text);
  }
  throw DataError(file.path() +
                  ": neither noise/std nor noise/precision: the noise of the measurements must be given");
}

/// `/outputs/NAME`.
MeasuredSeries read_series(const Hdf5Reader& file, const std::string& name, std::size_t n_t) {
  MeasuredSeries series;
  series.values = file.read(name, true);
  if (series.values.size() != n_t) {
    throw DataError(fmt::format("{}: {} must have one value per time: it has {}, time has {}", file.path(),
                                name.substr(1), series.values.size(), n_t));
  }
  for (std::size_t t = 0; t < n_t; ++t) {
    if (std::isinf(series.values[t])) {
      throw DataError(fmt::format("{}: {}[{}] is infinite: give NaN for a missing value", file.path(),
                                  name.substr(1), t));
    }
  }
  series.units = file.labels(name).units;
  const auto unit = files::unit_of(series.units);
  const double factor = unit ? unit->factor : 1;
  if (unit) series.units = unit->si;
  for (double& value : series.values) value *= factor;
  if (const std::string shared = "/shared_std/" + name.substr(std::string("/outputs/").size());
      file.has(shared)) {
    series.shared_std = file.read(shared, Shape{n_t});
    for (double& std : series.shared_std) {
      if (!(std >= 0))
        throw DataError(fmt::format("{}: {} has {}: a standard deviation is not negative", file.path(),
                                    shared.substr(1), std));
      std *= factor;
    }
  }
  if (!file.has_attribute(name, "std")) return series;
  const double std = file.number_attribute(name, "std");
  if (!(std > 0 && std::isfinite(std))) {
    throw DataError(fmt::format("{}: the attribute std of {} is {}: a standard deviation is positive",
                                file.path(), name.substr(1), std));
  }
  series.std = std * factor;
  return series;
}

void check_times(const std::vector<double>& time, const std::string& path) {
  if (time.empty()) throw DataError(path + ": time is empty: there is nothing to assimilate");
  for (std::size_t i = 1; i < time.size(); ++i) {
    if (!(time[i] > time[i - 1])) {
      throw DataError(fmt::format("{}: time[{}] = {} is not greater than time[{}] = {}: times must increase",
                                  path, i, time[i], i - 1, time[i - 1]));
    }
  }
  const std::vector<double> distinct = distinct_times(time);
  if (distinct.size() == time.size()) return;
  std::size_t first = 0;
  while (first < distinct.size() && distinct[first] == time[first]) ++first;
  const std::size_t second = std::max<std::size_t>(1, first);
  throw DataError(
      fmt::format("{}: time[{}] = {} and time[{}] = {} differ by rounding only: a datum is there "
                  "twice, leave one of them out",
                  path, second - 1, time[second - 1], second, time[second]));
}

/// What is not of the displacements.
void read_beside(const Hdf5Reader& file, Measurements& m) {
  if (file.has("/outputs")) {
    for (const std::string& name : file.members("/outputs"))
      m.series[name] = read_series(file, "/outputs/" + name, m.time.size());
  }
  if (file.has("/truth")) {
    for (const std::string& name : file.members("/truth"))
      m.truth[name] = file.read("/truth/" + name, Shape{1})[0];
  }
  if (m.values.rows() == 0) {  // quantities alone
    m.values.resize(0, std::ssize(m.time));
    m.noise = NoiseModel::independent(Eigen::VectorXd());
  }
}

Measurements read_hdf5(const std::string& path) {
  const Hdf5Reader file(path);
  Measurements m;
  m.time = file.read("/time");
  const double seconds = files::time_factor(file, "/time");
  for (double& t : m.time) t *= seconds;
  check_times(m.time, path);
  // Quantities alone; snapshots and models, which have outputs too, are no data.
  if (!file.has("/values") && file.has("/outputs") && !file.has("/parameters")) {
    read_beside(file, m);
    return m;
  }
  const Shape shape = file.shape("/values");
  if (shape.size() != 2 || shape[0] != m.time.size()) {
    throw DataError(
        fmt::format("{}: values must have the shape [n_t, n_obs] with n_t = {}", path, m.time.size()));
  }
  const std::size_t n_t = shape[0], n_obs = shape[1];
  std::vector<double> values = file.read("/values", true);
  in_si(file, "/values", "m", values);
  m.values.resize(n_obs, n_t);
  for (std::size_t t = 0; t < n_t; ++t) {
    for (std::size_t j = 0; j < n_obs; ++j) {
      const double value = values[t * n_obs + j];
      if (std::isinf(value)) {
        throw DataError(
            fmt::format("{}: values[{},{}] is infinite: give NaN for a missing value", path, t, j));
      }
      m.values(j, t) = value;
    }
  }
  m.sensors.points = file.read("/dofs/points", Shape{n_obs, 3});
  in_si(file, "/dofs/points", "m", m.sensors.points);
  const std::vector<std::int64_t>& components = m.sensors.components = file.read_integers("/dofs/component");
  if (components.size() != n_obs) {
    throw DataError(fmt::format("{}: dofs/component has {} entries, values has {} columns", path,
                                components.size(), n_obs));
  }
  for (std::size_t j = 0; j < n_obs; ++j) {
    if (components[j] < 0 || components[j] > 2) {
      throw DataError(fmt::format("{}: dofs/component[{}] = {}: 0 is x, 1 y, 2 z", path, j, components[j]));
    }
  }
  m.noise = read_noise(file, n_obs, n_t);
  read_beside(file, m);
  return m;
}

void write_noise(files::Hdf5Writer& file, const NoiseModel& noise, std::size_t n_obs) {
  std::string name = "/noise/std";
  if (noise.measurement().is_independent()) {
    const Eigen::VectorXd std = noise.measurement().standard_deviations();
    file.write(name, {std.data(), n_obs}, {n_obs}, {"m", "standard deviation of the noise"});
  } else {
    name = "/noise/precision";
    const Eigen::SparseMatrix<double> m =
        noise.measurement().precision();  // symmetric: its columns are its rows
    const std::size_t count = m.nonZeros();
    const std::vector<std::int64_t> indices(m.innerIndexPtr(), m.innerIndexPtr() + count);
    const std::vector<std::int64_t> rows(m.outerIndexPtr(), m.outerIndexPtr() + n_obs + 1);
    file.write(name + "/data", {m.valuePtr(), count}, {count}, {"1/m2", "precision of the noise, CSR"});
    file.write_integers(name + "/indices", indices, {count}, {"1", "columns"});
    file.write_integers(name + "/indptr", rows, {n_obs + 1}, {"1", "first entry of each row"});
  }
  if (noise.shared_reference() > 0)
    file.integer_attribute(name, "shared_reference", noise.shared_reference());
}

void write_displacements(files::Hdf5Writer& file, const Measurements& m) {
  const std::size_t n_obs = m.values.rows(), n_t = m.time.size();
  // Column-major n_obs × n_t is the C order of [n_t, n_obs].
  file.write("/values", {m.values.data(), n_obs * n_t}, {n_t, n_obs}, {"m", "measured displacement"});
  file.write("/dofs/points", m.sensors.points, {n_obs, 3}, {"m", "measurement points"});
  file.write_integers("/dofs/component", m.sensors.components, {n_obs},
                      {"1", "displacement component: 0 x, 1 y, 2 z"});
  write_noise(file, m.noise, n_obs);
}

}  // namespace

Measurements read_measurements(const std::string& path) {
  const std::string ending = files::extension_of(path);
  if (ending == ".csv") {
    Measurements m = read_measurements_csv(path);
    check_times(m.time, path);
    return m;
  }
  for (const char* other : {".txt", ".tsv", ".dat", ".asc", ".xls", ".xlsx", ".json"})
    if (ending == other)
      throw DataError(path + ": measurements are read from .csv and HDF5: save it as one of these");
  return read_hdf5(path);
}

void write_measurements(const std::string& path, const Measurements& m, const std::string& project,
                        std::uint64_t seed) {
  if (files::extension_of(path) == ".csv") return write_measurements_csv(path, m);
  const std::size_t n_obs = m.values.rows(), n_t = m.time.size();
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    file.write("/time", m.time, {n_t}, {"1", "model time"});
    if (n_obs > 0) write_displacements(file, m);
    for (const auto& [name, series] : m.series) {
      file.write("/outputs/" + name, series.values, {n_t}, {series.units, "measured"});
      if (series.std) file.number_attribute("/outputs/" + name, "std", *series.std);
      if (!series.shared_std.empty())
        file.write("/shared_std/" + name, series.shared_std, {n_t},
                   {series.units, "std of an error of all times"});
    }
    for (const auto& [name, value] : m.truth)
      file.write("/truth/" + name, {&value, 1}, {1}, {"1", "true value"});
    file.text_attribute("/", "created_by", k_created_by);
    file.text_attribute("/", "project", project);
    file.number_attribute("/", "seed", seed);
    file.close();
  });
}

}  // namespace knothe::likelihood
