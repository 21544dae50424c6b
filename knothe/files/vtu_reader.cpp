#include "knothe/files/vtu_reader.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <pugixml.hpp>
#include <string_view>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/files/surface_mesh.hpp"
#include "knothe/files/text_position.hpp"

// VTK's file format: https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html

namespace knothe::files {

namespace {

static_assert(std::endian::native == std::endian::little, "VTU files are read as the memory has them");

constexpr std::size_t k_max_bytes = std::size_t{1} << 30;  // of one array
constexpr std::size_t k_best_compression = 1100;           // zlib reaches 1032 at most

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

class VtuReader {
 public:
  VtuReader(const std::string& text, const std::string& path) : text_(text), path_(path) {}

  SurfaceMesh surface() {
    const VtuContents grid = read();
    return collect(grid.points, grid.connectivity, grid.offsets, grid.types);
  }

  VtuContents contents() {
    VtuContents grid = read();
    for (auto array = piece_.child("PointData").child("DataArray"); array;
         array = array.next_sibling("DataArray")) {
      if (array.attribute("type").value() == std::string_view("String")) continue;
      VtuField field;
      field.name = array.attribute("Name").value();
      if (array.attribute("NumberOfComponents"))
        field.components = std::clamp<std::int64_t>(attribute(array, "NumberOfComponents"), 1, 9);
      field.units = array.find_child_by_attribute("InformationKey", "name", "UNITS_LABEL").text().get();
      field.values = numbers<double>(array, "values");
      if (field.values.size() != grid.points.size() / 3 * field.components)
        fail(array, fmt::format("{} has {} values for {} points of {} components", field.name,
                                field.values.size(), grid.points.size() / 3, field.components));
      grid.point_fields.push_back(std::move(field));
    }
    for (auto array = file_.child("UnstructuredGrid").child("FieldData").child("DataArray"); array;
         array = array.next_sibling("DataArray"))
      if (array.attribute("Name").value() == std::string_view("TimeValue"))
        if (const auto values = numbers<double>(array, "times"); !values.empty()) grid.time = values[0];
    check_cells(grid);
    return grid;
  }

 private:
  /// The points and cells.
  VtuContents read() {
    parse();
    const pugi::xml_node points_array = piece_.child("Points").child("DataArray"),
                         offsets_array = cells("offsets"), types_array = cells("types");
    if (!points_array) fail(0, "the file has no Points");
    const auto points = numbers<double>(points_array, "points");
    const auto connectivity = numbers<std::int64_t>(cells("connectivity"), "connectivity"),
               offsets = numbers<std::int64_t>(offsets_array, "offsets"),
               types = numbers<std::int64_t>(types_array, "types");
    const auto count = std::max<std::int64_t>(0, attribute(piece_, "NumberOfPoints"));
    if (points.size() % 3 != 0 || static_cast<std::int64_t>(points.size() / 3) != count)
      fail(points_array, fmt::format("{} coordinates for {} points", points.size(), count));
    if (offsets.size() != types.size())
      fail(types_array, fmt::format("{} cell types for {} cells", types.size(), offsets.size()));
    for (const double x : points)
      if (!std::isfinite(x)) fail(points_array, "a coordinate that is not finite");
    return {points, connectivity, offsets, types, {}, {}};
  }

  void check_cells(const VtuContents& grid) const {
    const std::int64_t nodes = std::ssize(grid.connectivity), count = grid.points.size() / 3;
    std::int64_t before = 0;
    for (const std::int64_t end : grid.offsets) {
      if (end < before || end > nodes)
        fail(cells("offsets"), fmt::format("an offset of {}, there are {} nodes in all", end, nodes));
      before = end;
    }
    for (const std::int64_t point : grid.connectivity)
      if (point < 0 || point >= count)
        fail(cells("connectivity"), fmt::format("a cell has the point {}, there are {}", point, count));
  }

  [[noreturn]] void fail(std::size_t at, const std::string& message) const {
    fail_at_offset(path_, text_, at, message);
  }
  [[noreturn]] void fail(const pugi::xml_node& node, const std::string& message) const {
    fail(node.offset_debug() - 1, message);
  }

  void parse() {
    std::string xml = text_;
    if (const std::size_t tag = text_.find("<AppendedData"); tag != std::string::npos) {
      appended_ = text_.find('_', tag);
      if (appended_ == std::string::npos) fail(tag, "the appended data are cut off");
      xml = text_.substr(0, appended_++) + "</AppendedData></VTKFile>";  // what follows is no XML
    }
    // Nothing converted, so that offsets are those of the text.
    const auto result =
        document_.load_buffer(xml.data(), xml.size(), pugi::parse_minimal, pugi::encoding_utf8);
    if (!result)
      fail(result.offset, fmt::format("{}: this is no VTU file, or it is cut off", result.description()));
    const pugi::xml_node file = file_ = document_.child("VTKFile");
    if (file) read_header(file);
    piece_ = file.child("UnstructuredGrid").child("Piece");
    if (!piece_) fail(0, "this is no VTU file: a VTKFile of type UnstructuredGrid with a Piece is expected");
    if (const auto second = piece_.next_sibling("Piece"))
      fail(second, "a second piece: append them into one (ParaView: Merge Blocks)");
    base64_ = file.child("AppendedData").attribute("encoding").value() == std::string_view("base64");
  }

  void read_header(const pugi::xml_node& file) {
    if (const std::string type = file.attribute("type").value(); type != "UnstructuredGrid")
      fail(file, fmt::format("a VTK file of type \"{}\"; UnstructuredGrid (.vtu) is read", type));
    if (file.attribute("byte_order").as_string("LittleEndian") != std::string_view("LittleEndian"))
      fail(file, "the file is big-endian; save it again as little-endian or ASCII");
    long_header_ = file.attribute("header_type").value() == std::string_view("UInt64");
    const std::string compressor = file.attribute("compressor").value();
    compressed_ = !compressor.empty();
    if (compressed_ && compressor != "vtkZLibDataCompressor")
      fail(file, fmt::format("compressed by {}; save it with zlib or not compressed", compressor));
  }

  [[nodiscard]] pugi::xml_node cells(const char* name) const {
    const auto array = piece_.child("Cells").find_child_by_attribute("DataArray", "Name", name);
    if (!array) fail(0, fmt::format("the file's Cells have no {}", name));
    return array;
  }

  [[nodiscard]] std::int64_t attribute(const pugi::xml_node& node, const char* name) const {
    const std::string text = node.attribute(name).value();
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || text.empty())
      fail(node, fmt::format("{} is \"{}\": an integer is expected", name, text.substr(0, 40)));
    return value;
  }

  /// What stands between the tags of an array, as a part of the text.
  [[nodiscard]] std::string_view content(const pugi::xml_node& array) const {
    const pugi::xml_node inside = array.text().data();
    if (!inside) return {};
    return std::string_view(text_).substr(inside.offset_debug(), std::strlen(inside.value()));
  }

  /// The numbers of an array, whatever their type and form in the file.
  template <class T>
  std::vector<T> numbers(const pugi::xml_node& array, const char* what) const {
    const std::string format = array.attribute("format").as_string("ascii");
    if (format == "ascii") return from_text<T>(array, what);
    if (format != "binary" && format != "appended")
      fail(array, fmt::format("{} in the format \"{}\"; ascii, binary and appended are known", what, format));
    const std::string bytes = bytes_of(array, format == "appended");
    const std::string type = array.attribute("type").value();
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
    for (Index i = 0; i < std::ssize(values); ++i)
      values[i] = static_cast<T>(number_at<From>(bytes, i * sizeof(From)));
    return values;
  }

  template <class T>
  std::vector<T> from_text(const pugi::xml_node& array, const char* what) const {
    std::vector<T> values;
    const std::string_view text = content(array);
    constexpr std::string_view k_space = " \t\n\v\f\r";
    for (std::size_t at = 0; (at = text.find_first_not_of(k_space, at)) != std::string_view::npos;) {
      const std::size_t end = std::min(text.find_first_of(k_space, at), text.size());
      const std::string_view word = text.substr(at, end - at);
      const auto value = parse_number(word);
      if (!value || !(std::abs(*value) < 1e15))
        fail(word.data() - text_.data(),
             fmt::format("\"{}\" among the {}: a number is expected", word.substr(0, 40), what));
      values.push_back(static_cast<T>(*value));
      at = end;
    }
    return values;
  }

  [[nodiscard]] std::string bytes_of(const pugi::xml_node& array, bool appended) const {
    std::string_view from = content(array);
    if (appended) {
      const std::int64_t offset = attribute(array, "offset");
      if (appended_ == std::string::npos || offset < 0 ||
          static_cast<std::size_t>(offset) >= text_.size() - appended_)
        fail(array, "the appended data do not reach so far: the file is cut off");
      from = std::string_view(text_).substr(appended_ + offset);
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
      if (value > k_max_bytes) fail(array, fmt::format("an array of {} bytes: the file is damaged", value));
      return value;
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

  [[nodiscard]] std::string inflated(const pugi::xml_node& array, std::string_view from,
                                     std::size_t size) const {
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
                      const std::vector<std::int64_t>& offsets,
                      const std::vector<std::int64_t>& types) const {
    const std::int64_t count = points.size() / 3;
    std::vector<std::array<std::int64_t, 4>> faces;
    const auto nodes = std::ssize(connectivity);
    for (Index c = 0; c < std::ssize(offsets); ++c) {
      const std::int64_t begin = c == 0 ? 0 : offsets[c - 1], end = offsets[c];
      if (begin < 0 || end < begin || end > nodes)
        fail(cells("offsets"),
             fmt::format("the offset of cell {} is {}, there are {} nodes in all", c, end, nodes));
      if (types[c] == 22 || types[c] == 23 || types[c] == 28 || types[c] == 34)
        fail(cells("types"), fmt::format("cell {} is of second order (VTK's type {}): image correlation "
                                         "takes linear triangles and quadrilaterals",
                                         c, types[c]));
      const std::size_t corners = types[c] == 5 ? 3 : types[c] == 9 ? 4 : 0;
      if (corners == 0) continue;
      if (static_cast<std::size_t>(end - begin) != corners)
        fail(cells("offsets"),
             fmt::format("cell {} has {} nodes, its type says {}", c, end - begin, corners));
      std::array<std::int64_t, 4> cell{-1, -1, -1, -1};
      for (std::size_t a = 0; a < corners; ++a) {
        cell[a] = connectivity[begin + a];
        if (cell[a] < 0 || cell[a] >= count)
          fail(cells("connectivity"),
               fmt::format("cell {} has the point {}, there are {}", c, cell[a], count));
      }
      faces.push_back(cell);
    }
    if (faces.empty())
      fail(0, "the file has no triangles or quadrilaterals: save the surface (ParaView: Extract Surface)");
    return with_used_points(points, std::move(faces));
  }

  const std::string& text_;
  const std::string& path_;
  pugi::xml_document document_;
  pugi::xml_node file_, piece_;
  std::size_t appended_ = std::string::npos;
  bool long_header_ = false, compressed_ = false, base64_ = false;
};

std::string text_of(const std::string& path) {
  try {
    return read_text(path);
  } catch (const IoError& error) {
    throw DataError(error.what());
  }
}

}  // namespace

SurfaceMesh parse_vtu(const std::string& text, const std::string& path) {
  return VtuReader(text, path).surface();
}

VtuContents parse_vtu_contents(const std::string& text, const std::string& path) {
  return VtuReader(text, path).contents();
}

VtuContents read_vtu(const std::string& path) {
  return parse_vtu_contents(text_of(path), path);
}

std::vector<PvdEntry> read_pvd(const std::string& path) {
  const std::string text = text_of(path);
  pugi::xml_document document;
  const auto result = document.load_buffer(text.data(), text.size());
  const pugi::xml_node collection = document.child("VTKFile").child("Collection");
  if (!result || !collection)
    throw DataError(path + ": error: this is no PVD file: a VTKFile with a Collection is expected");
  std::vector<PvdEntry> entries;
  for (auto set = collection.child("DataSet"); set; set = set.next_sibling("DataSet")) {
    const auto time = parse_number(set.attribute("timestep").value());
    const std::string file = set.attribute("file").value();
    if (!time || !std::isfinite(*time) || file.empty())
      throw DataError(path + ": error: a DataSet needs a timestep and a file");
    entries.push_back({*time, file});
  }
  std::stable_sort(entries.begin(), entries.end(),
                   [](const PvdEntry& a, const PvdEntry& b) { return a.time < b.time; });
  for (Index i = 1; i < std::ssize(entries); ++i)
    if (entries[i].time == entries[i - 1].time)
      throw DataError(fmt::format(
          "{}: error: two files for the time {}: append the parts into one (ParaView: Merge Blocks)", path,
          entries[i].time));
  if (entries.empty()) throw DataError(path + ": error: the series has no DataSet");
  return entries;
}

}  // namespace knothe::files
