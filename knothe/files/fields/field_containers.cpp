#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/fields/field_formats.hpp"
#include "knothe/files/fields/mat_file.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/units.hpp"

namespace knothe::files {
namespace {

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

void lose_unless(bool valid, std::size_t point, ExportedField& field) {
  if (!valid) field.u[point] = field.v[point] = k_nan;
}

}  // namespace

ExportedField read_vic_mat(const std::string& path) {
  auto arrays = read_mat_arrays(path);
  const bool metric = arrays.contains("X");
  ExportedField field;
  field.path = path, field.format = "vic-mat", field.is_current = false, field.is_up = metric;
  field.lost_by = "sigma < 0";
  if (!metric) field.position_unit = field.displacement_unit = "px";
  for (const char* const name :
       metric ? std::array{"X", "Y", "U", "V", "sigma"} : std::array{"x", "y", "u", "v", "sigma"})
    if (!arrays.contains(name) || arrays[name].size() != arrays["sigma"].size())
      throw DataError(
          fmt::format("{}: no array {} of as many numbers as sigma: export VIC's fields x, y, u, v, sigma "
                      "(or X, Y, U, V), or as CSV",
                      path, name));
  field.x = arrays[metric ? "X" : "x"], field.y = arrays[metric ? "Y" : "y"];
  field.u = arrays[metric ? "U" : "u"], field.v = arrays[metric ? "V" : "v"];
  const std::vector<double>& sigma = arrays["sigma"];
  const bool has_pixels = metric && arrays["x"].size() == sigma.size() && arrays["y"].size() == sigma.size();
  for (std::size_t i = 0; i < sigma.size(); ++i) {
    lose_unless(sigma[i] >= 0, i, field);
    if (has_pixels) field.id.push_back({arrays["x"][i], arrays["y"][i]});
  }
  return field;
}

ExportedField read_pyvale_binary(const std::string& path) {
  constexpr std::size_t k_row =
      61;  // int32 x y, double u v magnitude, uint8 converged, double cost ftol xtol, int32
  const std::string bytes = read_text(path);
  if (bytes.empty() || bytes.size() % k_row != 0)
    throw DataError(fmt::format("{}: {} bytes, no multiple of {}: not of pyvale, or cut off; export CSV",
                                path, bytes.size(), k_row));
  ExportedField field;
  field.path = path, field.format = "pyvale-binary", field.is_current = false, field.is_up = false;
  field.position_unit = field.displacement_unit = "px", field.lost_by = "converged = 0";
  for (std::size_t at = 0; at < bytes.size(); at += k_row) {
    std::int32_t place[2];
    double displacement[2];
    std::memcpy(place, &bytes[at], 8), std::memcpy(displacement, &bytes[at + 8], 16);
    const unsigned converged = static_cast<unsigned char>(bytes[at + 32]);
    if (converged > 1)
      throw DataError(
          fmt::format("{}: row {}: byte 33, converged, is {}: the columns are in another order; export CSV",
                      path, at / k_row, converged));
    field.x.push_back(place[0]), field.y.push_back(place[1]);
    field.u.push_back(displacement[0]), field.v.push_back(displacement[1]);
    lose_unless(converged == 1 && std::isfinite(displacement[0] + displacement[1]), field.u.size() - 1,
                field);
  }
  return field;
}

ExportedField read_istra(const std::string& path) {
  const Hdf5Reader file(path);
  ExportedField field;
  field.path = path, field.format = "istra4d", field.is_current = true, field.is_up = true,
  field.lost_by = "mask = 0";
  // Of one camera there are only pixels.
  if (!file.has("/coordinates/coordinate_z")) field.position_unit = field.displacement_unit = "px";
  const Shape shape = file.shape("/displacements/displacement_x");
  field.x = file.read("/coordinates/coordinate_x", shape, true),
  field.y = file.read("/coordinates/coordinate_y", shape, true);
  field.u = file.read("/displacements/displacement_x", shape, true);
  field.v = file.read("/displacements/displacement_y", shape, true);
  for (std::size_t i = 0; i < field.x.size(); ++i) field.id.push_back({double(i), 0});
  for (const char* const mask : {"/coordinates/mask", "/displacements/mask"}) {
    const std::vector<double> valid = file.read(mask, shape);
    for (std::size_t i = 0; i < valid.size(); ++i) lose_unless(valid[i] == 1, i, field);
  }
  const std::string analog = "/add_data/analog_channels";
  if (!file.has(analog)) return field;
  const std::vector<double> values = file.read(analog, true);
  for (std::size_t k = 0; k < values.size(); ++k) {
    const std::string channel = fmt::format("channel{}", k);
    if (!file.has_attribute(analog, channel + "quantity") || std::isnan(values[k])) continue;
    // Whether a factor has been applied is not said.
    const bool plain = !file.has_attribute(analog, channel + "factor") ||
                       file.number_attribute(analog, channel + "factor") == 1;
    if (!plain) continue;
    const auto unit = file.has_attribute(analog, channel + "unit")
                          ? unit_of(file.text_attribute(analog, channel + "unit"))
                          : std::nullopt;
    field.scalars[file.text_attribute(analog, channel + "quantity")] = values[k] * (unit ? unit->factor : 1);
  }
  return field;
}

std::vector<ExportedField> read_dic_exchange(const std::string& path) {
  const Hdf5Reader file(path);
  const Shape shape = file.shape("/vector/coordinates");
  if (shape.size() != 3 || shape[2] != 3 || shape[0] == 0)
    throw DataError(path + ": vector/coordinates must have the shape [times, points, 3]");
  const std::vector<double> coordinates = file.read("/vector/coordinates", true);
  const std::vector<double> time =
      file.has("/scalar/time") ? file.read("/scalar/time", Shape{shape[0]}) : std::vector<double>();
  std::vector<ExportedField> fields(shape[0]);
  for (std::size_t t = 0; t < shape[0]; ++t) {
    ExportedField& field = fields[t];
    field.path = path, field.format = "dic-exchange", field.is_current = false, field.is_up = true;
    field.lost_by = "nan";
    if (!time.empty()) field.time = time[t];
    for (std::size_t i = 0; i < shape[1]; ++i) {
      const double *first = &coordinates[3 * i], *now = &coordinates[3 * (t * shape[1] + i)];
      field.x.push_back(first[0]), field.y.push_back(first[1]);
      field.u.push_back(now[0] - first[0]), field.v.push_back(now[1] - first[1]);
      field.id.push_back({double(i), 0});
    }
    for (const std::string& name : file.members("/scalar")) {
      if (name == "time" || file.shape("/scalar/" + name) != Shape{shape[0]}) continue;
      const double value = file.read("/scalar/" + name, true)[t];
      if (!std::isnan(value)) field.scalars[name] = value;
    }
  }
  return fields;
}

}  // namespace knothe::files
