#include "knothe/files/fields/mat_file.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <string_view>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::files {
namespace {

constexpr std::size_t k_header = 128;
constexpr std::size_t k_max_inflated = std::size_t{1} << 30;  // bytes of one variable
constexpr std::uint32_t k_matrix = 14, k_compressed = 15;

/// One piece of the file: its type and bytes ("MAT-File Format", The MathWorks, R2023a, section 1).
struct Element {
  std::uint32_t type = 0;
  std::string_view content;
};

class Pieces {
 public:
  Pieces(std::string_view bytes, const std::string& path) : rest_(bytes), path_(path) {}

  [[nodiscard]] bool done() const { return rest_.size() < 8; }
  Element next() {
    if (done()) fail();
    const std::uint32_t first = word(0);
    if (first >> 16 != 0) {  // small: type and size in one word, the content in the other
      const Element element{first & 0xFFFF, rest_.substr(4, first >> 16)};
      if (first >> 16 > 4) fail();
      rest_.remove_prefix(8);
      return element;
    }
    const std::size_t size = word(4);
    if (size > rest_.size() - 8) fail();
    const Element element{first, rest_.substr(8, size)};
    // A compressed piece is not padded.
    const std::size_t padded = first == k_compressed ? size : (size + 7) / 8 * 8;
    rest_.remove_prefix(std::min(8 + padded, rest_.size()));
    return element;
  }

 private:
  [[noreturn]] void fail() const { throw DataError(path_ + ": the .mat file is damaged or ends early"); }
  [[nodiscard]] std::uint32_t word(std::size_t at) const {
    std::uint32_t value = 0;
    std::memcpy(&value, rest_.data() + at, 4);
    return value;
  }

  std::string_view rest_;
  const std::string& path_;
};

std::string inflated(std::string_view bytes, const std::string& path) {
  std::string result;
  z_stream stream{};
  if (inflateInit(&stream) != Z_OK) throw DataError(path + ": zlib does not start");
  std::string input(bytes);
  stream.next_in = reinterpret_cast<Bytef*>(input.data());
  stream.avail_in = input.size();
  std::string part(std::size_t{1} << 18, '\0');
  int state = Z_OK;
  while (state == Z_OK && result.size() < k_max_inflated) {
    stream.next_out = reinterpret_cast<Bytef*>(part.data());
    stream.avail_out = part.size();
    state = inflate(&stream, Z_NO_FLUSH);
    result.append(part, 0, part.size() - stream.avail_out);
  }
  inflateEnd(&stream);
  if (state != Z_STREAM_END)
    throw DataError(path + ": a variable cannot be unpacked: the .mat file is damaged");
  return result;
}

template <class T>
std::vector<double> numbers_as(std::string_view bytes) {
  std::vector<double> values(bytes.size() / sizeof(T));
  for (std::size_t i = 0; i < values.size(); ++i) {
    T value{};
    std::memcpy(&value, bytes.data() + i * sizeof(T), sizeof(T));
    values[i] = value;
  }
  return values;
}

/// MATLAB stores doubles as the smallest integers that hold them.
std::vector<double> numbers_of(const Element& element, const std::string& path) {
  switch (element.type) {
    case 1:
      return numbers_as<std::int8_t>(element.content);
    case 2:
      return numbers_as<std::uint8_t>(element.content);
    case 3:
      return numbers_as<std::int16_t>(element.content);
    case 4:
      return numbers_as<std::uint16_t>(element.content);
    case 5:
      return numbers_as<std::int32_t>(element.content);
    case 6:
      return numbers_as<std::uint32_t>(element.content);
    case 7:
      return numbers_as<float>(element.content);
    case 9:
      return numbers_as<double>(element.content);
    default:
      throw DataError(fmt::format("{}: numbers of type {} are not read", path, element.type));
  }
}

/// A variable: flags, dimensions, name, real part.
void add_array(std::string_view content, const std::string& path,
               std::map<std::string, std::vector<double>>& arrays) {
  Pieces pieces(content, path);
  const Element flags = pieces.next();
  const unsigned kind = flags.content.empty() ? 0 : static_cast<unsigned char>(flags.content[0]);
  const bool is_complex = flags.content.size() > 1 && (flags.content[1] & 0x08) != 0;
  if (kind < 6 || kind > 13 || is_complex) return;  // cells, structures, text, sparse arrays
  (void)pieces.next();
  const std::string name(pieces.next().content);
  arrays[name] = numbers_of(pieces.next(), path);
}

}  // namespace

std::map<std::string, std::vector<double>> read_mat_arrays(const std::string& path) {
  const std::string bytes = read_text(path);
  if (bytes.size() < k_header || bytes.substr(k_header - 2, 2) != "IM")
    throw DataError(path + ": not a .mat file of version 5 as a PC writes it: save it with -v7, or as CSV");
  std::map<std::string, std::vector<double>> arrays;
  for (Pieces pieces(std::string_view(bytes).substr(k_header), path); !pieces.done();) {
    const Element element = pieces.next();
    if (element.type == k_matrix) add_array(element.content, path, arrays);
    if (element.type != k_compressed) continue;
    const std::string unpacked = inflated(element.content, path);
    if (const Element inner = Pieces(unpacked, path).next(); inner.type == k_matrix)
      add_array(inner.content, path, arrays);
  }
  return arrays;
}

}  // namespace knothe::files
