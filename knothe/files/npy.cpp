#include "knothe/files/npy.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cstdint>
#include <cstring>
#include <string_view>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::files {
namespace {

constexpr std::size_t k_max_values = std::size_t{1} << 31;

/// What stands behind 'key': in the header, a Python dictionary.
std::string_view entry(const std::string& header, const std::string& key, const std::string& path) {
  const std::size_t at = header.find("'" + key + "':");
  if (at == std::string::npos)
    throw DataError(fmt::format("{}: the header of this .npy file has no {}", path, key));
  std::string_view rest = std::string_view(header).substr(at + key.size() + 3);
  rest.remove_prefix(std::min(rest.find_first_not_of(' '), rest.size()));
  return rest;
}

std::vector<std::size_t> shape_of(std::string_view text, const std::string& path) {
  std::vector<std::size_t> shape;
  for (std::size_t at = 1; at < text.size() && text[at] != ')';) {
    std::size_t extent = 0;
    const auto [end, error] = std::from_chars(text.data() + at, text.data() + text.size(), extent);
    if (error != std::errc()) throw DataError(path + ": the shape of this .npy file cannot be read");
    shape.push_back(extent);
    at = static_cast<std::size_t>(end - text.data());
    while (at < text.size() && (text[at] == ',' || text[at] == ' ')) ++at;
  }
  return shape;
}

template <class T>
void convert(std::string_view bytes, std::vector<double>& values) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    T value;
    std::memcpy(&value, bytes.data() + i * sizeof(T), sizeof(T));
    values[i] = static_cast<double>(value);
  }
}

/// From Fortran order: the first index runs fastest.
std::vector<double> in_c_order(const std::vector<double>& values, const std::vector<std::size_t>& shape) {
  std::vector<double> result(values.size());
  std::vector<std::size_t> index(shape.size(), 0);
  for (const double value : values) {
    std::size_t at = 0;
    for (std::size_t k = 0; k < shape.size(); ++k) at = at * shape[k] + index[k];
    result[at] = value;
    for (std::size_t k = 0; k < shape.size() && ++index[k] == shape[k]; ++k) index[k] = 0;
  }
  return result;
}

}  // namespace

NpyArray read_npy(const std::string& path) {
  const std::string text = read_text(path);
  if (text.size() < 12 || !text.starts_with("\x93NUMPY"))
    throw DataError(path + ": this is no file of numpy.save (.npy)");
  const bool is_long = text[6] >= 2;
  std::uint32_t length = 0;
  std::memcpy(&length, text.data() + 8, is_long ? 4 : 2);
  const std::size_t begin = is_long ? 12 : 10;
  if (length > text.size() - begin) throw DataError(path + ": the header is cut off");
  const std::string header = text.substr(begin, length);
  NpyArray array;
  array.shape = shape_of(entry(header, "shape", path), path);
  std::size_t count = 1;
  for (const std::size_t extent : array.shape) {
    if (extent != 0 && count > k_max_values / extent) throw DataError(path + ": the array is too large");
    count *= extent;
  }
  const std::string type(entry(header, "descr", path).substr(0, 5));
  const std::string_view bytes = std::string_view(text).substr(begin + length);
  const std::size_t size = type == "'<f8'" || type == "'<i8'"   ? 8
                           : type == "'<f4'" || type == "'<i4'" ? 4
                                                                : 0;
  if (size == 0)
    throw DataError(
        fmt::format("{}: an array of the type {}: save it as numbers, array.astype(float)", path, type));
  if (bytes.size() < count * size) throw DataError(path + ": the array is cut off");
  array.values.resize(count);
  if (type == "'<f8'") convert<double>(bytes, array.values);
  if (type == "'<f4'") convert<float>(bytes, array.values);
  if (type == "'<i8'") convert<std::int64_t>(bytes, array.values);
  if (type == "'<i4'") convert<std::int32_t>(bytes, array.values);
  if (entry(header, "fortran_order", path).starts_with("True"))
    array.values = in_c_order(array.values, array.shape);
  return array;
}

}  // namespace knothe::files
