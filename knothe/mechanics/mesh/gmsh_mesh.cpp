#include "knothe/mechanics/mesh/gmsh_mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "knothe/base/error.hpp"

namespace knothe::mechanics {
namespace {

using Entity = std::pair<int, int>;  ///< dimension and tag

struct Element {
  std::int64_t name;
  int type;
  std::vector<std::int64_t> nodes;  ///< tags
  std::vector<int> groups;          ///< physical tags
};

struct ElementType {
  const char* name;
  int dimension, nodes;
};
const std::map<int, ElementType> k_types = {
    {1, {"line", 1, 2}},       {2, {"triangle", 2, 3}}, {3, {"quadrangle", 2, 4}}, {4, {"tetrahedron", 3, 4}},
    {5, {"hexahedron", 3, 8}}, {6, {"prism", 3, 6}},    {7, {"pyramid", 3, 5}},    {15, {"point", 0, 1}}};
constexpr int k_hexahedron = 5;

/// The numbers of a file, section by section.
class Reader {
 public:
  explicit Reader(const std::string& path) : path_(path), stream_(path) {
    if (!stream_) throw DataError(fmt::format("{}: {}", path, std::strerror(errno)));
    parse();
  }

  std::map<Entity, std::string> group_names;  ///< by (dimension, physical tag)
  std::map<std::int64_t, std::array<double, 3>> nodes;
  std::vector<Element> elements;

 private:
  [[noreturn]] void refuse(const std::string& why) const {
    throw DataError(fmt::format("{}: {}", path_, why));
  }

  template <class T>
  T read(const char* what) {
    T value{};
    if (!(stream_ >> value))
      refuse(fmt::format("cannot read {} in section {}; is the file truncated?", what, section_));
    return value;
  }
  std::size_t read_count(const char* what) {
    const auto count = read<std::int64_t>(what);
    if (count < 0 || count > 500'000'000)
      refuse(fmt::format("{} is {} in section {}", what, count, section_));
    return static_cast<std::size_t>(count);
  }

  void parse() {
    std::string word;
    while (stream_ >> word) {
      if (word.empty() || word[0] != '$')
        refuse(fmt::format("expected a section such as $Nodes, found '{}'", word.substr(0, 40)));
      section_ = word;
      if (word == "$MeshFormat")
        read_format();
      else if (version_ == 0)
        refuse("the file does not start with $MeshFormat; it is not a Gmsh mesh");
      else if (word == "$PhysicalNames")
        read_names();
      else if (word == "$Entities")
        read_entities();
      else if (word == "$Nodes")
        version_ == 2 ? read_nodes_2() : read_nodes_4();
      else if (word == "$Elements")
        version_ == 2 ? read_elements_2() : read_elements_4();
      skip_to_end("$End" + word.substr(1));
    }
    if (version_ == 0) refuse("the file is empty; it is not a Gmsh mesh");
  }

  void skip_to_end(const std::string& end) {
    std::string word;
    while (stream_ >> word)
      if (word == end) return;
    refuse(fmt::format("section {} has no {}; the file is truncated", section_, end));
  }

  void read_format() {
    const auto version = read<double>("the version");
    if (read<int>("the file type") != 0)
      refuse("binary meshes are not read; save it in ASCII (Mesh.Binary = 0)");
    if (std::abs(version - 2.2) < 0.01)
      version_ = 2;
    else if (std::abs(version - 4.1) < 0.01)
      version_ = 4;
    else
      refuse(fmt::format("mesh format {} is not read; save it as 2.2 or 4.1 (Mesh.MshFileVersion)", version));
  }

  void read_names() {
    const std::size_t count = read_count("the number of names");
    for (std::size_t i = 0; i < count; ++i) {
      const int dimension = read<int>("a dimension"), tag = read<int>("a tag");
      std::string line;
      std::getline(stream_, line);
      const auto from = line.find('"'), to = line.rfind('"');
      if (from == std::string::npos || to <= from) refuse("a physical name is not between quotation marks");
      group_names[{dimension, tag}] = line.substr(from + 1, to - from - 1);
    }
  }

  void read_entities() {
    std::array<std::size_t, 4> counts;
    for (auto& count : counts) count = read_count("the number of entities");
    for (int dimension = 0; dimension < 4; ++dimension)
      for (std::size_t i = 0; i < counts[dimension]; ++i) {
        const int tag = read<int>("an entity's tag");
        for (int k = 0; k < (dimension == 0 ? 3 : 6); ++k) read<double>("an entity's position");
        auto& groups = entity_groups_[{dimension, tag}];
        for (std::size_t k = read_count("the number of groups"); k > 0; --k)
          groups.push_back(read<int>("a group"));
        if (dimension == 0) continue;
        for (std::size_t k = read_count("the number of borders"); k > 0; --k) read<int>("a border");
      }
  }

  void read_node(std::int64_t tag) {
    auto& point = nodes[tag];
    for (auto& coordinate : point) {
      coordinate = read<double>("a coordinate");
      if (!std::isfinite(coordinate)) refuse(fmt::format("node {} has a coordinate that is not finite", tag));
    }
  }

  void read_nodes_2() {
    for (std::size_t i = read_count("the number of nodes"); i > 0; --i)
      read_node(read<std::int64_t>("a node's number"));
  }

  void read_nodes_4() {
    std::size_t blocks = read_count("the number of blocks");
    for (int k = 0; k < 3; ++k) read<std::int64_t>("the numbers of nodes");
    for (; blocks > 0; --blocks) {
      const int dimension = read<int>("a block's dimension");
      read<int>("a block's entity");
      const bool parametric = read<int>("whether a block is parametric") != 0;
      std::vector<std::int64_t> tags(read_count("the nodes of a block"));
      for (auto& tag : tags) tag = read<std::int64_t>("a node's number");
      for (const auto tag : tags) {
        read_node(tag);
        for (int k = 0; parametric && k < dimension; ++k) read<double>("a parametric coordinate");
      }
    }
  }

  const ElementType& type_of(int type, std::int64_t element) const {
    const auto found = k_types.find(type);
    if (found == k_types.end())
      refuse(fmt::format(
          "element {} has Gmsh's type {}; only first-order elements are read (Mesh.ElementOrder = 1)",
          element, type));
    return found->second;
  }

  void read_element(std::int64_t name, int type, std::vector<int> groups) {
    Element element{name, type, std::vector<std::int64_t>(type_of(type, name).nodes), std::move(groups)};
    for (auto& node : element.nodes) {
      node = read<std::int64_t>("an element's node");
      if (!nodes.contains(node))
        refuse(fmt::format("element {} uses node {}, which the file does not have", name, node));
    }
    elements.push_back(std::move(element));
  }

  void read_elements_2() {
    for (std::size_t i = read_count("the number of elements"); i > 0; --i) {
      const auto name = read<std::int64_t>("an element's number");
      const int type = read<int>("an element's type");
      std::vector<int> tags(read_count("the number of tags"));
      for (auto& tag : tags) tag = read<int>("a tag");
      tags.resize(std::min<std::size_t>(tags.size(), 1));  // the first is the physical group
      read_element(name, type, tags);
    }
  }

  void read_elements_4() {
    std::size_t blocks = read_count("the number of blocks");
    for (int k = 0; k < 3; ++k) read<std::int64_t>("the numbers of elements");
    for (; blocks > 0; --blocks) {
      const int dimension = read<int>("a block's dimension"), tag = read<int>("a block's entity");
      const int type = read<int>("a block's element type");
      for (std::size_t i = read_count("the elements of a block"); i > 0; --i)
        read_element(read<std::int64_t>("an element's number"), type, entity_groups_[{dimension, tag}]);
    }
  }

  std::string path_, section_ = "$MeshFormat";
  std::ifstream stream_;
  int version_ = 0;
  std::map<Entity, std::vector<int>> entity_groups_;
};

/// Turns what was read into cells and node sets.
class Builder {
 public:
  Builder(const std::string& path, const Reader& reader) : path_(path), reader_(reader) {}

  HexahedronMesh build(LeftSupport left_support) {
    for (const auto& element : reader_.elements) add_cell(element);
    if (mesh_.cell_count() == 0) throw DataError(path_ + ": the mesh has no hexahedra");
    if (!found_.contains("elastic"))
      refuse_group("elastic",
                   "a volume of cells that cannot be damaged (those under the load and at the supports)");
    mesh_.left_support = left_support;
    mesh_.support_left = group("support_left", true);
    mesh_.support_right = group("support_right", true);
    mesh_.load = group("load", true);
    mesh_.symmetry = group("symmetry", true);
    mesh_.left_face = group("left_face", left_support == LeftSupport::left_face);
    find_crack_mouth(mesh_);
    mechanics::validate(mesh_, path_);
    return std::move(mesh_);
  }

 private:
  [[noreturn]] void refuse_group(const std::string& name, const std::string& meaning) const {
    std::string there;
    for (const auto& [entity, other] : reader_.group_names) there += (there.empty() ? "" : ", ") + other;
    throw DataError(fmt::format("{}: the physical group \"{}\" is missing: {}; the mesh has {}", path_, name,
                                meaning, there.empty() ? "no named groups" : there));
  }

  bool in_group(const Element& element, const std::string& name) const {
    const int dimension = k_types.at(element.type).dimension;
    return std::any_of(element.groups.begin(), element.groups.end(), [&](int tag) {
      const auto found = reader_.group_names.find({dimension, tag});
      return found != reader_.group_names.end() && found->second == name;
    });
  }

  void add_cell(const Element& element) {
    const auto& type = k_types.at(element.type);
    if (type.dimension < 3) return;
    if (element.type != k_hexahedron)
      throw DataError(fmt::format(
          "{}: element {} is a {}; only hexahedra are used (transfinite or recombined and extruded meshes)",
          path_, element.name, type.name));
    const bool elastic = in_group(element, "elastic");
    if (elastic) found_.insert("elastic");
    // Format 2.2 repeats an element for each of its groups.
    std::vector<std::int64_t> key = element.nodes;
    std::sort(key.begin(), key.end());
    const auto [known, fresh] = cell_of_.try_emplace(key, mesh_.cell_count());
    if (!fresh) {
      if (elastic) mesh_.elastic[known->second] = 1;
      return;
    }
    for (const auto tag : element.nodes) {
      const auto [node, is_new] = node_of_.try_emplace(tag, mesh_.node_count());
      if (is_new) {
        const auto& point = reader_.nodes.at(tag);
        mesh_.points.insert(mesh_.points.end(), point.begin(), point.end());
      }
      mesh_.cells.push_back(node->second);
    }
    mesh_.elastic.push_back(elastic ? 1 : 0);
    mesh_.names.push_back(element.name);
  }

  NodeSet group(const std::string& name, bool needed) const {
    std::set<std::int64_t> nodes;
    for (const auto& element : reader_.elements) {
      if (k_types.at(element.type).dimension == 3 || !in_group(element, name)) continue;
      for (const auto tag : element.nodes)
        if (const auto found = node_of_.find(tag); found != node_of_.end()) nodes.insert(found->second);
    }
    if (nodes.empty() && needed) refuse_group(name, "points, lines or surfaces of the mesh");
    return {nodes.begin(), nodes.end()};
  }

  std::string path_;
  const Reader& reader_;
  HexahedronMesh mesh_;
  std::map<std::int64_t, std::int64_t> node_of_;
  std::map<std::vector<std::int64_t>, std::int64_t> cell_of_;
  std::set<std::string> found_;
};

}  // namespace

HexahedronMesh read_gmsh_mesh(const std::string& path, LeftSupport left_support) {
  const Reader reader(path);
  return Builder(path, reader).build(left_support);
}

}  // namespace knothe::mechanics
