#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <optional>
#include <string_view>

#include "knothe/base/error.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/files/surface_mesh.hpp"
#include "knothe/files/text_position.hpp"

// VTK's file format: https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html

namespace knothe::files {

namespace {

static_assert(std::endian::native == std::endian::little, "VTU files are read as the memory has them");

constexpr std::size_t k_most_bytes = std::size_t{1} << 30;  // of one array
constexpr std::size_t k_best_compression = 1100;            // zlib reaches 1032 at most

struct Tag {
  std::string name;
  std::map<std::string, std::string, std::less<>> attributes;
  std::size_t begin = 0, end = 0;  ///< of the tag in the text, end behind its '>'
  bool closing = false, empty = false;

  [[nodiscard]] std::string get(std::string_view key, const char* otherwise = "") const {
    const auto found = attributes.find(key);
    return found == attributes.end() ? otherwise : found->second;
  }
};

/// As much XML as VTK writes: tags with attributes, and text between them.
class Tags {
 public:
  Tags(const std::string& text, const std::string& path) : text_(text), path_(path) {}

  /// The next tag; none at the end, or at the appended data, which are no XML.
  std::optional<Tag> next() {
    while (true) {
      const std::size_t begin = text_.find('<', position_);
      if (begin == std::string::npos) return std::nullopt;
      if (text_.compare(begin, 4, "<!--") == 0) {
        position_ = behind("-->", begin);
      } else if (text_.compare(begin, 2, "<?") == 0 || text_.compare(begin, 2, "<!") == 0) {
        position_ = behind(">", begin);
      } else {
        Tag tag = parse(begin);
        position_ = tag.end;
        return tag;
      }
    }
  }
  [[noreturn]] void fail(std::size_t at, const std::string& message) const {
    fail_at_offset(path_, text_, at, message);
  }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  [[nodiscard]] std::size_t behind(std::string_view what, std::size_t from) const {
    const std::size_t at = text_.find(what, from);
    if (at == std::string::npos) fail(from, fmt::format("no \"{}\" follows: the file is cut off", what));
    return at + what.size();
  }
  static bool is_space(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
  [[nodiscard]] Tag parse(std::size_t begin) const {
    Tag tag;
    tag.begin = begin;
    std::size_t at = begin + 1;
    const auto rest = [&] {
      while (at < text_.size() && is_space(text_[at])) ++at;
      if (at >= text_.size()) fail(begin, "a tag that is not closed: the file is cut off");
    };
    const auto name = [&] {
      const std::size_t first = at;
      while (at < text_.size() && !is_space(text_[at]) && text_[at] != '>' && text_[at] != '/' &&
             text_[at] != '=')
        ++at;
      return text_.substr(first, at - first);
    };
    if (at < text_.size() && text_[at] == '/') tag.closing = true, ++at;
    tag.name = name();
    while (true) {
      rest();
      if (text_[at] == '>') break;
      if (text_[at] == '/') {
        tag.empty = true, ++at;
        continue;
      }
      const std::size_t where = at;
      const std::string key = name();
      rest();
      if (key.empty() || text_[at] != '=') fail(where, "an attribute without a value: this is no VTU file");
      ++at;
      rest();
      const char quote = text_[at];
      const std::size_t close = quote == '"' || quote == '\'' ? text_.find(quote, at + 1) : std::string::npos;
      if (close == std::string::npos) fail(where, fmt::format("the value of {} has no quotes", key));
      tag.attributes[key] = text_.substr(at + 1, close - at - 1);
      at = close + 1;
    }
    tag.end = at + 1;
    return tag;
  }

  const std::string& text_;
  const std::string& path_;
  std::size_t position_ = 0;
};

/// The bytes of base64 text from `begin` on, up to `limit` of them or the first other character. Padding may
/// stand in the middle: VTK ends a header with it, and begins again.
std::string from_base64(std::string_view text, std::size_t limit) {
  std::string bytes;
  std::uint32_t group = 0;
  int count = 0, padding = 0;
  for (const char c : text) {
    int value = -1;
    if (c >= 'A' && c <= 'Z') value = c - 'A';
    if (c >= 'a' && c <= 'z') value = c - 'a' + 26;
    if (c >= '0' && c <= '9') value = c - '0' + 52;
    if (c == '+') value = 62;
    if (c == '/') value = 63;
    if (c == '=') value = 0, ++padding;
    if (c == ' ' || (c >= '\t' && c <= '\r')) continue;
    if (value < 0) break;
    group = (group << 6U) | static_cast<std::uint32_t>(value);
    if (++count < 4) continue;
    for (int k = 0; k < 3 - padding; ++k)
      bytes += static_cast<char>(
          static_cast<unsigned char>((group >> (16U - 8U * static_cast<unsigned>(k))) & 255U));
    group = 0, count = 0, padding = 0;
    if (bytes.size() >= limit) break;
  }
  return bytes;
}

template <class T>
T number_at(std::string_view bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

/// One <DataArray>.
struct Array {
  Tag tag;
  std::size_t begin = 0, end = 0;  ///< of what is between its tags
};

class VtuReader {
 public:
  VtuReader(const std::string& text, const std::string& path) : tags_(text, path) {}

  SurfaceMesh read() {
    find_arrays();
    const auto points = numbers<double>(points_, "points");
    const auto connectivity = numbers<std::int64_t>(cells_["connectivity"], "connectivity"),
               offsets = numbers<std::int64_t>(cells_["offsets"], "offsets"),
               types = numbers<std::int64_t>(cells_["types"], "types");
    if (points.size() % 3 != 0 || points.size() / 3 != point_count_)
      fail(points_, fmt::format("{} coordinates for {} points", points.size(), point_count_));
    if (offsets.size() != types.size())
      fail(cells_["types"], fmt::format("{} cell types for {} cells", types.size(), offsets.size()));
    for (const double x : points)
      if (!std::isfinite(x)) fail(points_, "a coordinate that is not finite");
    return collect(points, connectivity, offsets, types);
  }

 private:
  [[noreturn]] void fail(const Array& array, const std::string& message) const {
    tags_.fail(array.tag.begin, message);
  }

  void find_arrays() {
    std::string section;
    bool pieces = false, file = false;
    while (const auto tag = tags_.next()) {
      if (tag->closing) {
        if (tag->name == section) section.clear();
      } else if (tag->name == "VTKFile") {
        file = true;
        read_header(*tag);
      } else if (tag->name == "Piece") {
        if (pieces) tags_.fail(tag->begin, "a second piece: append them into one (ParaView: Merge Blocks)");
        pieces = true;
        point_count_ = static_cast<std::size_t>(std::max<std::int64_t>(0, attribute(*tag, "NumberOfPoints")));
      } else if (tag->name == "Points" || tag->name == "Cells" || tag->name == "PointData" ||
                 tag->name == "CellData" || tag->name == "FieldData") {
        if (!tag->empty) section = tag->name;
      } else if (tag->name == "DataArray") {
        Array array{*tag, tag->end, tag->end};
        if (!tag->empty) array.end = std::min(tags_.text().find("</", tag->end), tags_.text().size());
        if (section == "Points") points_ = array;
        if (section == "Cells") cells_[tag->get("Name")] = array;
      } else if (tag->name == "AppendedData") {
        base64_ = tag->get("encoding") == "base64";
        appended_ = tags_.text().find('_', tag->end);
        if (appended_ == std::string::npos) tags_.fail(tag->begin, "the appended data are cut off");
        ++appended_;
        break;
      }
    }
    if (!file || !pieces)
      tags_.fail(0, "this is no VTU file: a VTKFile of type UnstructuredGrid with a Piece is expected");
    if (points_.tag.name.empty()) tags_.fail(0, "the file has no Points");
    for (const char* name : {"connectivity", "offsets", "types"})
      if (!cells_.contains(name)) tags_.fail(0, fmt::format("the file's Cells have no {}", name));
  }

  void read_header(const Tag& tag) {
    if (tag.get("type") != "UnstructuredGrid")
      tags_.fail(tag.begin,
                 fmt::format("a VTK file of type \"{}\"; UnstructuredGrid (.vtu) is read", tag.get("type")));
    if (tag.get("byte_order", "LittleEndian") != "LittleEndian")
      tags_.fail(tag.begin, "the file is big-endian; save it again as little-endian or ASCII");
    long_header_ = tag.get("header_type", "UInt32") == "UInt64";
    const std::string compressor = tag.get("compressor");
    compressed_ = !compressor.empty();
    if (compressed_ && compressor != "vtkZLibDataCompressor")
      tags_.fail(tag.begin, fmt::format("compressed by {}; save it with zlib or not compressed", compressor));
  }

  [[nodiscard]] std::int64_t attribute(const Tag& tag, const char* name) const {
    const std::string text = tag.get(name);
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || text.empty())
      tags_.fail(tag.begin, fmt::format("{} is \"{}\": an integer is expected", name, text.substr(0, 40)));
    return value;
  }

  /// The numbers of an array, whatever their type and form in the file.
  template <class T>
  std::vector<T> numbers(const Array& array, const char* what) const {
    const std::string format = array.tag.get("format", "ascii");
    if (format == "ascii") return from_text<T>(array, what);
    if (format != "binary" && format != "appended")
      fail(array, fmt::format("{} in the format \"{}\"; ascii, binary and appended are known", what, format));
    const std::string bytes = bytes_of(array, format == "appended");
    const std::string type = array.tag.get("type");
    if (type == "Float64") return converted<double, T>(bytes);
    if (type == "Float32") return converted<float, T>(bytes);
    if (type == "Int64") return converted<std::int64_t, T>(bytes);
    if (type == "UInt64") return converted<std::int64_t, T>(bytes);  // none is so large
    if (type == "Int32") return converted<std::int32_t, T>(bytes);
    if (type == "UInt32") return converted<std::uint32_t, T>(bytes);
    if (type == "UInt8") return converted<std::uint8_t, T>(bytes);
    if (type == "Int8") return converted<std::int8_t, T>(bytes);
    fail(array, fmt::format("{} of the type \"{}\", which is not known here", what, type));
  }

  template <class From, class T>
  static std::vector<T> converted(const std::string& bytes) {
    std::vector<T> values(bytes.size() / sizeof(From));
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = static_cast<T>(number_at<From>(bytes, i * sizeof(From)));
    return values;
  }

  template <class T>
  std::vector<T> from_text(const Array& array, const char* what) const {
    std::vector<T> values;
    const std::string& text = tags_.text();
    std::size_t at = array.begin;
    constexpr std::string_view k_space = " \t\n\v\f\r";
    while ((at = std::min(text.find_first_not_of(k_space, at), array.end)) < array.end) {
      const std::size_t end = std::min(text.find_first_of(k_space, at), array.end);
      const std::string_view word = std::string_view(text).substr(at, end - at);
      const auto value = parse_number(word);
      if (!value || !(std::abs(*value) < 1e15))
        tags_.fail(at, fmt::format("\"{}\" among the {}: a number is expected", word.substr(0, 40), what));
      values.push_back(static_cast<T>(*value));
      at = end;
    }
    return values;
  }

  [[nodiscard]] std::string bytes_of(const Array& array, bool appended) const {
    std::string_view from = std::string_view(tags_.text()).substr(array.begin, array.end - array.begin);
    if (appended) {
      const std::int64_t offset = attribute(array.tag, "offset");
      if (appended_ == std::string::npos || offset < 0 ||
          static_cast<std::size_t>(offset) >= tags_.text().size() - appended_)
        fail(array, "the appended data do not reach so far: the file is cut off");
      from = std::string_view(tags_.text()).substr(appended_ + static_cast<std::size_t>(offset));
    }
    const bool coded = !appended || base64_;
    const std::size_t header = long_header_ ? 8 : 4;
    const auto read = [&](std::size_t bytes) {
      std::string result = coded ? from_base64(from, bytes) : std::string(from.substr(0, bytes));
      if (result.size() < bytes) fail(array, "the data of this array are cut off");
      return result;
    };
    const auto header_number = [&](const std::string& bytes, std::size_t k) {
      const auto value = long_header_ ? number_at<std::uint64_t>(bytes, k * header)
                                      : number_at<std::uint32_t>(bytes, k * header);
      if (value > k_most_bytes) fail(array, fmt::format("an array of {} bytes: the file is damaged", value));
      return static_cast<std::size_t>(value);
    };
    const std::size_t first = header_number(read(header), 0);
    if (!compressed_) return read(header + first).substr(header);
    // [blocks][bytes of a block][bytes of the last][compressed bytes of each]…, and the blocks.
    if (first > from.size()) fail(array, "more blocks than bytes: the file is damaged");
    const std::string sizes = read(header * (3 + first));
    std::vector<std::size_t> compressed;
    std::size_t total = 0;
    for (std::size_t k = 0; k < first; ++k)
      compressed.push_back(header_number(sizes, 3 + k)), total += compressed.back();
    const std::size_t block = header_number(sizes, 1), last = header_number(sizes, 2);
    if (total > from.size() || block * first > k_best_compression * total + block)
      fail(array, "the sizes of the compressed blocks make no sense: the file is damaged");
    const std::string all = read(sizes.size() + total);
    std::string result;
    std::size_t at = sizes.size();
    for (std::size_t k = 0; k < first; ++k, at += compressed[k - 1])
      result += inflated(array, std::string_view(all).substr(at, compressed[k]),
                         k + 1 == first && last > 0 ? last : block);
    return result;
  }

  [[nodiscard]] std::string inflated(const Array& array, std::string_view from, std::size_t size) const {
    if (size > k_best_compression * from.size() + 64)
      fail(array, "a compressed block is too small for its content: the file is damaged");
    std::string out(size, '\0');
    uLongf written = size;
    if (uncompress(reinterpret_cast<Bytef*>(out.data()), &written,
                   reinterpret_cast<const Bytef*>(from.data()), from.size()) != Z_OK ||
        written != size)
      fail(array, "a compressed block cannot be read: the file is damaged");
    return out;
  }

  SurfaceMesh collect(const std::vector<double>& points, const std::vector<std::int64_t>& connectivity,
                      const std::vector<std::int64_t>& offsets, const std::vector<std::int64_t>& types) {
    SurfaceMesh mesh;
    std::vector<std::int64_t> number(point_count_, -1);
    const auto nodes = static_cast<std::int64_t>(connectivity.size());
    for (std::size_t c = 0; c < offsets.size(); ++c) {
      const std::int64_t begin = c == 0 ? 0 : offsets[c - 1], end = offsets[c];
      if (begin < 0 || end < begin || end > nodes)
        fail(cells_["offsets"],
             fmt::format("the offset of cell {} is {}, there are {} nodes in all", c, end, nodes));
      if (types[c] == 22 || types[c] == 23 || types[c] == 28 || types[c] == 34)
        fail(cells_["types"], fmt::format("cell {} is of second order (VTK's type {}): image correlation "
                                          "takes linear triangles and quadrilaterals",
                                          c, types[c]));
      const std::size_t corners = types[c] == 5 ? 3 : types[c] == 9 ? 4 : 0;
      if (corners == 0) continue;
      if (static_cast<std::size_t>(end - begin) != corners)
        fail(cells_["offsets"],
             fmt::format("cell {} has {} nodes, its type says {}", c, end - begin, corners));
      std::array<std::int64_t, 4> cell{-1, -1, -1, -1};
      for (std::size_t a = 0; a < corners; ++a) {
        cell[a] = connectivity[static_cast<std::size_t>(begin) + a];
        if (cell[a] < 0 || cell[a] >= static_cast<std::int64_t>(point_count_))
          fail(cells_["connectivity"],
               fmt::format("cell {} has the point {}, there are {}", c, cell[a], point_count_));
        number[static_cast<std::size_t>(cell[a])] = 0;
      }
      mesh.cells.push_back(cell);
    }
    if (mesh.cells.empty())
      tags_.fail(0,
                 "the file has no triangles or quadrilaterals: save the surface (ParaView: Extract Surface)");
    std::int64_t next = 0;
    for (std::size_t i = 0; i < number.size(); ++i) {
      if (number[i] < 0) continue;
      number[i] = next++;
      mesh.points.insert(mesh.points.end(), {points[3 * i], points[3 * i + 1], points[3 * i + 2]});
    }
    for (auto& cell : mesh.cells)
      for (std::int64_t& node : cell)
        if (node >= 0) node = number[static_cast<std::size_t>(node)];
    return mesh;
  }

  Tags tags_;
  Array points_;
  std::map<std::string, Array> cells_;
  std::size_t point_count_ = 0, appended_ = std::string::npos;
  bool long_header_ = false, compressed_ = false, base64_ = false;
};

}  // namespace

SurfaceMesh parse_vtu(const std::string& text, const std::string& path) {
  return VtuReader(text, path).read();
}

}  // namespace knothe::files
