#include "knothe/files/gmsh_file.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>
#include <unordered_map>

#include "knothe/base/index.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/files/text_position.hpp"

namespace knothe::files {

namespace {

struct TypeFacts {
  const char* name;
  int dimension, nodes;
};

/// No nodes: not an element of first order.
TypeFacts facts_of(std::int64_t type) {
  static constexpr std::array<TypeFacts, 8> k_types = {{{},
                                                        {"line", 1, 2},
                                                        {"triangle", 2, 3},
                                                        {"quadrangle", 2, 4},
                                                        {"tetrahedron", 3, 4},
                                                        {"hexahedron", 3, 8},
                                                        {"prism", 3, 6},
                                                        {"pyramid", 3, 5}}};
  if (type == 15) return {"point", 0, 1};
  return type > 0 && type < 8 ? k_types[type] : TypeFacts{};
}

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
  std::int64_t integer(const char* what, std::int64_t minimum = std::numeric_limits<std::int64_t>::min()) {
    const std::string_view w = word(what);
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(w.data(), w.data() + w.size(), value);
    if (error != std::errc() || end != w.data() + w.size())
      fail(fmt::format("\"{}\" is not an integer; {} is expected here", shortened(w), what));
    if (value < minimum) fail(fmt::format("{} is {}; it is at least {}", what, value, minimum));
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
  /// What stands between the quotation marks that follow.
  std::string quoted(const char* what) {
    skip_space();
    last_ = position_;
    const std::size_t close = position_ < text_.size() && text_[position_] == '"'
                                  ? text_.find_first_of("\"\n", position_ + 1)
                                  : std::string::npos;
    if (close == std::string::npos || text_[close] != '"')
      fail(fmt::format("{} is not in quotation marks", what));
    position_ = close + 1;
    return text_.substr(last_ + 1, close - last_ - 1);
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

class GmshReader {
 public:
  GmshReader(const std::string& text, const std::string& path, const char* purpose)
      : words_(text, path), purpose_(purpose) {}

  GmshFile read() {
    if (words_.at_end()) words_.fail("the file is empty: it is no Gmsh mesh");
    read_format();
    while (!words_.at_end()) {
      const std::string section(words_.word("a section"));
      if (section.size() < 2 || section[0] != '$')
        words_.fail(
            fmt::format("\"{}\", where a section ($Nodes, $Elements, …) is expected", section.substr(0, 40)));
      if (section == "$PhysicalNames")
        read_names();
      else if (section == "$Entities" && !is_old_)
        read_entities();
      else if (section == "$Nodes")
        is_old_ ? read_nodes_2() : read_nodes_4();
      else if (section == "$Elements")
        is_old_ ? read_elements_2() : read_elements_4();
      const std::string end = "$End" + section.substr(1);
      section == "$Nodes" || section == "$Elements" ? words_.expect(end) : words_.skip_to(end);
    }
    return std::move(file_);
  }

 private:
  void read_format() {
    words_.expect("$MeshFormat");
    const double version = words_.number("the format's version");
    if (version != 2.2 && version != 4.1)
      words_.fail(fmt::format("Gmsh format {}; 4.1 and 2.2 are read: save with Mesh.MshFileVersion = 4.1",
                              format_number(version)));
    is_old_ = version == 2.2;
    if (words_.integer("the file type", 0) != 0)
      words_.fail("a binary Gmsh file; save as ASCII (Mesh.Binary = 0)");
    (void)words_.integer("the size of a number", 1);
    words_.expect("$EndMeshFormat");
  }

  void read_names() {
    for (std::int64_t n = words_.integer("the number of names", 0); n > 0; --n) {
      const int dimension = words_.integer("a group's dimension", 0), tag = words_.integer("a group's tag");
      file_.group_names[{dimension, tag}] = words_.quoted("the name of a physical group");
    }
  }

  void read_entities() {
    std::array<std::int64_t, 4> counts{};
    for (auto& count : counts) count = words_.integer("the number of entities", 0);
    for (int dimension = 0; dimension < 4; ++dimension)
      for (std::int64_t i = counts[dimension]; i > 0; --i) {
        const int tag = words_.integer("an entity's tag");
        for (int k = dimension == 0 ? 3 : 6; k > 0; --k) (void)words_.number("an entity's position");
        auto& groups = entity_groups_[{dimension, tag}];
        for (std::int64_t k = words_.integer("the number of groups", 0); k > 0; --k)
          groups.push_back(words_.integer("a group"));
        for (std::int64_t k = dimension == 0 ? 0 : words_.integer("the number of borders", 0); k > 0; --k)
          (void)words_.integer("a border");
      }
  }

  void add_node(std::int64_t tag) {
    if (!node_of_tag_.try_emplace(tag, std::ssize(node_of_tag_)).second)
      words_.fail(fmt::format("node {} is there twice", tag));
  }
  void read_point() {
    for (const char* what : {"a node's x", "a node's y", "a node's z"})
      file_.points.push_back(words_.number(what));
  }

  void read_nodes_2() {
    for (std::int64_t n = words_.integer("the number of nodes", 0); n > 0; --n) {
      add_node(words_.integer("a node's number", 0));
      read_point();
    }
  }

  std::int64_t blocks() {
    const std::int64_t count = words_.integer("the number of blocks", 0);
    for (const char* what : {"how many there are", "the smallest tag", "the largest tag"})
      (void)words_.integer(what, 0);
    return count;
  }

  void read_nodes_4() {
    for (std::int64_t block = blocks(); block > 0; --block) {
      const std::int64_t dimension = words_.integer("a block's dimension", 0);
      (void)words_.integer("a block's tag");
      const bool parametric = words_.integer("whether nodes have parameters", 0) != 0;
      const std::int64_t count = words_.integer("the number of a block's entries", 0);
      for (std::int64_t k = 0; k < count; ++k) add_node(words_.integer("a node's tag", 0));
      for (std::int64_t k = 0; k < count; ++k) {
        read_point();
        for (std::int64_t p = 0; parametric && p < dimension; ++p) (void)words_.number("a node's parameter");
      }
    }
  }

  std::int64_t read_type() {
    const std::int64_t type = words_.integer("an element's type", 0);
    if (facts_of(type).nodes == 0)
      words_.fail(fmt::format("elements of Gmsh's type {}; {}: mesh with order 1 (Mesh.ElementOrder = 1)",
                              type, purpose_));
    return type;
  }

  void read_element(std::int64_t tag, std::int64_t type, std::vector<int> groups) {
    GmshElement element{tag, static_cast<GmshType>(type), {}, std::move(groups)};
    element.nodes.fill(-1);
    for (Index a = 0; a < facts_of(type).nodes; ++a) {
      const std::int64_t node = words_.integer("a node of an element", 0);
      const auto found = node_of_tag_.find(node);
      if (found == node_of_tag_.end())
        words_.fail(
            fmt::format("element {} uses node {}, which is not among the nodes of the file", tag, node));
      element.nodes[a] = found->second;
    }
    file_.elements.push_back(std::move(element));
  }

  void read_elements_2() {
    for (std::int64_t n = words_.integer("the number of elements", 0); n > 0; --n) {
      const std::int64_t tag = words_.integer("an element's number", 0), type = read_type();
      std::vector<int> groups;
      for (std::int64_t tags = words_.integer("the number of an element's tags", 0); tags > 0; --tags) {
        const int value = words_.integer("an element's tag");
        if (groups.empty()) groups.push_back(value);  // the first is the physical group
      }
      read_element(tag, type, std::move(groups));
    }
  }

  void read_elements_4() {
    for (std::int64_t block = blocks(); block > 0; --block) {
      const int dimension = words_.integer("a block's dimension", 0),
                entity = words_.integer("a block's tag");
      const std::int64_t type = read_type();
      for (std::int64_t k = words_.integer("the number of a block's entries", 0); k > 0; --k)
        read_element(words_.integer("an element's tag", 0), type, entity_groups_[{dimension, entity}]);
    }
  }

  Words words_;
  const char* purpose_;
  bool is_old_ = false;  ///< format 2.2
  GmshFile file_;
  std::unordered_map<std::int64_t, std::int64_t> node_of_tag_;
  std::map<std::pair<int, int>, std::vector<int>> entity_groups_;  ///< by (dimension, tag)
};

}  // namespace

int GmshElement::dimension() const {
  return facts_of(static_cast<std::int64_t>(type)).dimension;
}

const char* GmshElement::type_name() const {
  return facts_of(static_cast<std::int64_t>(type)).name;
}

GmshFile parse_gmsh_file(const std::string& text, const std::string& path, const char* purpose) {
  return GmshReader(text, path, purpose).read();
}

}  // namespace knothe::files
