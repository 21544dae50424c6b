#include "knothe/files/npy.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdint>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::files {
namespace {

constexpr std::size_t k_max_values = std::size_t{1} << 31, k_max_dimensions = 64;

/// What stands behind 'key': in the header, a Python dictionary.
std::string_view entry(std::string_view header, const std::string& key, const std::string& name) {
  const std::size_t at = header.find("'" + key + "'");
  if (at == std::string::npos)
    throw DataError(fmt::format("{}: the header of this .npy file has no {}", name, key));
  const std::string_view rest = header.substr(at + key.size() + 2);
  return rest.substr(std::min(rest.find_first_not_of(" :"), rest.size()));
}

std::vector<std::size_t> shape_of(std::string_view text, const std::string& name) {
  std::vector<std::size_t> shape;
  std::size_t at = 1;
  while (at < text.size() && text[at] != ')' && shape.size() < k_max_dimensions) {
    std::size_t extent = 0;
    const auto [end, error] = std::from_chars(text.data() + at, text.data() + text.size(), extent);
    if (error != std::errc()) break;
    shape.push_back(extent);
    at = end - text.data();
    while (at < text.size() && (text[at] == ',' || text[at] == ' ')) ++at;
  }
  if (!text.starts_with('(') || at >= text.size() || text[at] != ')')
    throw DataError(name + ": the shape of this .npy file cannot be read");
  return shape;
}

template <class T>
void convert(std::string_view bytes, bool is_big_endian, std::vector<double>& values) {
  for (Index i = 0; i < std::ssize(values); ++i) {
    std::array<char, sizeof(T)> number;
    std::copy_n(bytes.begin() + i * sizeof(T), sizeof(T), number.begin());
    if (is_big_endian) std::reverse(number.begin(), number.end());
    values[i] = static_cast<double>(std::bit_cast<T>(number));
  }
}

/// From Fortran order: the first index runs fastest.
std::vector<double> in_c_order(const std::vector<double>& values, const std::vector<std::size_t>& shape) {
  std::vector<double> result(values.size());
  std::vector<std::size_t> index(shape.size(), 0);
  for (const double value : values) {
    std::size_t at = 0;
    for (Index k = 0; k < std::ssize(shape); ++k) at = at * shape[k] + index[k];
    result[at] = value;
    for (std::size_t k = 0; k < shape.size() && ++index[k] == shape[k]; ++k) index[k] = 0;
  }
  return result;
}

}  // namespace

NpyArray parse_npy(std::string_view text, const std::string& name) {
  if (text.size() < 12 || !text.starts_with("\x93NUMPY"))
    throw DataError(name + ": this is no file of numpy.save (.npy)");
  if (text[6] < 1 || text[6] > 3) throw DataError(name + ": unknown version of the .npy format");
  const std::size_t begin = text[6] > 1 ? 12 : 10;
  std::size_t length = 0;
  for (std::size_t k = begin - 1; k >= 8; --k) length = length << 8 | static_cast<unsigned char>(text[k]);
  if (length > text.size() - begin) throw DataError(name + ": the header is cut off");
  const std::string_view header = text.substr(begin, length), bytes = text.substr(begin + length);
  NpyArray array;
  array.shape = shape_of(entry(header, "shape", name), name);
  std::size_t count = 1;
  for (const std::size_t extent : array.shape) {
    if (extent != 0 && count > k_max_values / extent) throw DataError(name + ": the array is too large");
    count *= extent;
  }
  const std::string type(entry(header, "descr", name).substr(0, 5));
  const std::string_view kind = std::string_view(type).substr(std::min<std::size_t>(2, type.size()));
  array.is_float = kind.starts_with('f');
  const bool is_long = kind == "f8'" || kind == "i8'", is_big_endian = type.starts_with("'>");
  if (!(is_long || kind == "f4'" || kind == "i4'") ||
      !(is_big_endian || type.starts_with("'<") || type.starts_with("'=")))
    throw DataError(
        fmt::format("{}: an array of the type {}: save it as numbers, array.astype(float)", name, type));
  const std::size_t filled = count * (is_long ? 8 : 4);
  if (bytes.size() < filled) throw DataError(name + ": the array is cut off");
  array.unused_bytes = bytes.size() - filled;
  array.values.resize(count);
  const auto convert_to_double = array.is_float ? (is_long ? convert<double> : convert<float>)
                                                : (is_long ? convert<std::int64_t> : convert<std::int32_t>);
  convert_to_double(bytes, is_big_endian, array.values);
  if (entry(header, "fortran_order", name).starts_with("True"))
    array.values = in_c_order(array.values, array.shape);
  return array;
}

NpyArray read_npy(const std::string& path) {
  return parse_npy(read_text(path), path);
}

}  // namespace knothe::files
