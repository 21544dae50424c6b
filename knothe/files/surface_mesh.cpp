#include "knothe/files/surface_mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>
#include <unordered_map>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/files/text_position.hpp"

namespace knothe::files {

void fail_at_offset(const std::string& path, const std::string& text, std::size_t offset,
                    const std::string& message) {
  offset = std::min(offset, text.size());
  const auto end = text.begin() + static_cast<std::ptrdiff_t>(offset);
  const auto line = 1 + std::count(text.begin(), end, '\n');
  const std::size_t start = offset == 0 ? std::string::npos : text.rfind('\n', offset - 1);
  throw DataError(fmt::format("{}:{}:{}: error: {}", path, line,
                              start == std::string::npos ? offset + 1 : offset - start, message));
}

namespace {

constexpr const char* k_linear =
    "image correlation takes linear triangles and quadrilaterals: mesh with order 1";

/// A file's words, one after the other.
class Words {
 public:
  Words(const std::string& text, const std::string& path) : text_(text), path_(path) {}

  [[nodiscard]] bool at_end() {
    skip_space();
    return position_ == text_.size();
  }
  std::string_view word(const char* what) {
    skip_space();
    last_ = position_;
    if (position_ == text_.size()) fail(fmt::format("the file ends where {} should be: it is cut off", what));
    while (position_ < text_.size() && !is_space(text_[position_])) ++position_;
    return std::string_view(text_).substr(last_, position_ - last_);
  }
  std::int64_t integer(const char* what, std::int64_t least) {
    const std::string_view w = word(what);
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(w.data(), w.data() + w.size(), value);
    if (error != std::errc() || end != w.data() + w.size())
      fail(fmt::format("\"{}\" is not an integer; {} is expected here", shortened(w), what));
    if (value < least) fail(fmt::format("{} is {}; it is at least {}", what, value, least));
    return value;
  }
  double number(const char* what) {
    const std::string_view w = word(what);
    const auto value = parse_number(w);
    if (!value || !std::isfinite(*value))
      fail(fmt::format("\"{}\" is not a finite number; {} is expected here", shortened(w), what));
    return *value;
  }
  void expect(std::string_view expected) {
    const std::string_view w = word(std::string(expected).c_str());
    if (w != expected) fail(fmt::format("\"{}\", where {} is expected", shortened(w), expected));
  }
  /// Past the next `end`, a section's last word.
  void skip_to(const std::string& end) {
    const std::size_t at = text_.find(end, position_);
    if (at == std::string::npos) fail(fmt::format("the section has no {}: the file is cut off", end));
    position_ = at + end.size();
  }
  /// At the last word.
  [[noreturn]] void fail(const std::string& message) const { fail_at_offset(path_, text_, last_, message); }

 private:
  static bool is_space(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
  static std::string shortened(std::string_view w) {
    return std::string(w.substr(0, 40)) + (w.size() > 40 ? "…" : "");
  }
  void skip_space() {
    while (position_ < text_.size() && is_space(text_[position_])) ++position_;
  }

  const std::string& text_;
  const std::string& path_;
  std::size_t position_ = 0, last_ = 0;
};

/// What a Gmsh file has said so far.
struct GmshMesh {
  SurfaceMesh mesh;
  std::vector<double> points;                              ///< of all nodes of the file
  std::unordered_map<std::int64_t, std::int64_t> numbers;  ///< node tag → index in points

  void add_node(Words& words, std::int64_t tag) {
    if (!numbers.try_emplace(tag, static_cast<std::int64_t>(points.size() / 3)).second)
      words.fail(fmt::format("node {} is there twice", tag));
  }
  void read_point(Words& words) {
    for (const char* what : {"a node's x", "a node's y", "a node's z"}) points.push_back(words.number(what));
  }
  void read_element(Words& words, int corners) {
    std::array<std::int64_t, 4> cell{-1, -1, -1, -1};
    for (std::size_t a = 0; a < static_cast<std::size_t>(corners); ++a) {
      const std::int64_t tag = words.integer("a node of an element", 0);
      const auto found = numbers.find(tag);
      if (found == numbers.end())
        words.fail(fmt::format("node {} of an element is not among the nodes of the file", tag));
      cell[a] = found->second;
    }
    mesh.cells.push_back(cell);
  }
};

/// Nodes of Gmsh's element types that are not wanted here but may stand between those that are.
int nodes_of_other(std::int64_t type) {
  switch (type) {
    case 1:
      return 2;  // line
    case 4:
      return 4;  // tetrahedron
    case 5:
      return 8;  // hexahedron
    case 6:
      return 6;  // prism
    case 7:
      return 5;  // pyramid
    case 15:
      return 1;  // point
    default:
      return 0;
  }
}

void read_element_of_type(Words& words, GmshMesh& gmsh, std::int64_t type) {
  if (type == 2 || type == 3) return gmsh.read_element(words, type == 2 ? 3 : 4);
  for (int a = 0; a < nodes_of_other(type); ++a) (void)words.integer("a node of an element", 0);
}

void require_known_type(Words& words, std::int64_t type) {
  if (type != 2 && type != 3 && nodes_of_other(type) == 0)
    words.fail(fmt::format("elements of Gmsh's type {}; {} (Mesh.ElementOrder = 1)", type, k_linear));
}

void read_gmsh_2(Words& words, GmshMesh& gmsh, std::string_view section) {
  if (section == "$Nodes") {
    for (std::int64_t n = words.integer("the number of nodes", 0); n > 0; --n) {
      gmsh.add_node(words, words.integer("a node's number", 0));
      gmsh.read_point(words);
    }
    words.expect("$EndNodes");
    return;
  }
  for (std::int64_t n = words.integer("the number of elements", 0); n > 0; --n) {
    (void)words.integer("an element's number", 0);
    const std::int64_t type = words.integer("an element's type", 1);
    require_known_type(words, type);
    for (std::int64_t tags = words.integer("the number of an element's tags", 0); tags > 0; --tags)
      (void)words.word("an element's tag");
    read_element_of_type(words, gmsh, type);
  }
  words.expect("$EndElements");
}

void read_gmsh_4(Words& words, GmshMesh& gmsh, std::string_view section) {
  const bool nodes = section == "$Nodes";
  const std::int64_t blocks = words.integer("the number of blocks", 0);
  for (const char* what : {"how many there are", "the smallest tag", "the largest tag"})
    (void)words.integer(what, 0);
  for (std::int64_t block = 0; block < blocks; ++block) {
    const std::int64_t dimension = words.integer("a block's dimension", 0);
    (void)words.integer("a block's tag", std::numeric_limits<std::int64_t>::min());
    const std::int64_t kind =
        words.integer(nodes ? "whether nodes have parameters" : "a block's element type", 0);
    if (!nodes) require_known_type(words, kind);
    const std::int64_t count = words.integer("the number of a block's entries", 0);
    if (!nodes) {
      for (std::int64_t k = 0; k < count; ++k) {
        (void)words.integer("an element's tag", 0);
        read_element_of_type(words, gmsh, kind);
      }
      continue;
    }
    for (std::int64_t k = 0; k < count; ++k) {
      const std::int64_t tag = words.integer("a node's tag", 0);
      if (!gmsh.numbers.try_emplace(tag, static_cast<std::int64_t>(gmsh.points.size() / 3) + k).second)
        words.fail(fmt::format("node {} is there twice", tag));
    }
    for (std::int64_t k = 0; k < count; ++k) {
      gmsh.read_point(words);
      for (std::int64_t p = 0; kind != 0 && p < dimension; ++p) (void)words.number("a node's parameter");
    }
  }
  words.expect(nodes ? "$EndNodes" : "$EndElements");
}

}  // namespace

/// Keeps the nodes that are used, in the order of the file.
static SurfaceMesh with_used_points(const std::vector<double>& points, SurfaceMesh mesh) {
  std::vector<std::int64_t> number(points.size() / 3, -1);
  for (const auto& cell : mesh.cells)
    for (const std::int64_t node : cell)
      if (node >= 0) number[static_cast<std::size_t>(node)] = 0;
  std::int64_t next = 0;
  for (std::size_t i = 0; i < number.size(); ++i) {
    if (number[i] < 0) continue;
    number[i] = next++;
    for (std::size_t k = 0; k < 3; ++k) mesh.points.push_back(points[3 * i + k]);
  }
  for (auto& cell : mesh.cells)
    for (std::int64_t& node : cell)
      if (node >= 0) node = number[static_cast<std::size_t>(node)];
  return mesh;
}

SurfaceMesh parse_gmsh(const std::string& text, const std::string& path) {
  Words words(text, path);
  words.expect("$MeshFormat");
  const double version = words.number("the format's version");
  if (version != 2.2 && version != 4.1)
    words.fail(fmt::format("Gmsh format {}; 4.1 and 2.2 are read: save with Mesh.MshFileVersion = 4.1",
                           format_number(version)));
  if (words.integer("the file type", 0) != 0)
    words.fail("a binary Gmsh file; save as ASCII (Mesh.Binary = 0)");
  (void)words.integer("the size of a number", 1);
  words.expect("$EndMeshFormat");
  GmshMesh gmsh;
  while (!words.at_end()) {
    const std::string section(words.word("a section"));
    if (section.size() < 2 || section[0] != '$')
      words.fail(
          fmt::format("\"{}\", where a section ($Nodes, $Elements, …) is expected", section.substr(0, 40)));
    if (section == "$Nodes" || section == "$Elements")
      (version == 2.2 ? read_gmsh_2 : read_gmsh_4)(words, gmsh, section);
    else
      words.skip_to("$End" + section.substr(1));
  }
  if (gmsh.mesh.cells.empty())
    words.fail(
        "the file has no triangles or quadrilaterals: save the surface's mesh too (Mesh.SaveAll = 1, or make "
        "it a physical surface)");
  return with_used_points(gmsh.points, std::move(gmsh.mesh));
}

SurfaceMesh read_surface_mesh(const std::string& path) {
  const bool vtu = path.ends_with(".vtu");
  if (!vtu && !path.ends_with(".msh"))
    throw DataError(fmt::format("{}: error: a mesh is read from Gmsh (.msh) and VTK (.vtu) files", path));
  std::string text;
  try {
    text = read_text(path);
  } catch (const IoError& error) {
    throw DataError(error.what());
  }
  return vtu ? parse_vtu(text, path) : parse_gmsh(text, path);
}

}  // namespace knothe::files
