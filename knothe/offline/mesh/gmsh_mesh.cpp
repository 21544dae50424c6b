#include "knothe/offline/mesh/gmsh_mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/gmsh_file.hpp"

namespace knothe::offline {
namespace {

/// Turns what was read into cells and node sets.
class Builder {
 public:
  Builder(const std::string& path, const files::GmshFile& file) : path_(path), file_(file) {}

  HexahedronMesh build(LeftSupport left_support) {
    for (const auto& element : file_.elements) add_cell(element);
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
    find_mouth();
    validate(mesh_, path_);
    return std::move(mesh_);
  }

 private:
  [[noreturn]] void refuse_group(const std::string& name, const std::string& meaning) const {
    std::string there;
    for (const auto& [entity, other] : file_.group_names) there += (there.empty() ? "" : ", ") + other;
    throw DataError(fmt::format("{}: the physical group \"{}\" is missing: {}; the mesh has {}", path_, name,
                                meaning, there.empty() ? "no named groups" : there));
  }

  bool in_group(const files::GmshElement& element, const std::string& name) const {
    return std::any_of(element.groups.begin(), element.groups.end(), [&](int tag) {
      const auto found = file_.group_names.find({element.dimension(), tag});
      return found != file_.group_names.end() && found->second == name;
    });
  }

  void add_cell(const files::GmshElement& element) {
    if (element.dimension() < 3) return;
    if (element.type != files::GmshType::hexahedron)
      throw DataError(fmt::format(
          "{}: element {} is a {}; only hexahedra are used (transfinite or recombined and extruded meshes)",
          path_, element.tag, element.type_name()));
    const bool elastic = in_group(element, "elastic");
    if (elastic) found_.insert("elastic");
    // Format 2.2 repeats an element for each of its groups.
    auto key = element.nodes;
    std::sort(key.begin(), key.end());
    const auto [known, fresh] = cell_of_.try_emplace(key, mesh_.cell_count());
    if (!fresh) {
      if (elastic) mesh_.elastic[known->second] = 1;
      return;
    }
    for (const auto in_file : element.nodes) {
      const auto [node, is_new] = node_of_.try_emplace(in_file, mesh_.node_count());
      if (is_new) {
        const auto point = file_.points.begin() + 3 * in_file;
        mesh_.points.insert(mesh_.points.end(), point, point + 3);
      }
      mesh_.cells.push_back(node->second);
    }
    mesh_.elastic.push_back(elastic ? 1 : 0);
    mesh_.names.push_back(element.tag);
  }

  /// The two gauge points of the group "crack_mouth"; without it the notch's lower corners.
  void find_mouth() {
    const NodeSet gauge = group("crack_mouth", false);
    if (gauge.empty()) return find_crack_mouth(mesh_);
    const auto x = [&](std::int64_t node) { return mesh_.points[3 * node]; };
    if (gauge.size() != 2 || x(gauge[0]) == x(gauge[1]))
      throw DataError(fmt::format(
          "{}: the physical group \"crack_mouth\" has {} point(s) of the mesh: it takes two, one on either "
          "side of the crack, between which the opening is measured",
          path_, gauge.size()));
    const bool in_order = x(gauge[0]) < x(gauge[1]);
    mesh_.mouth_left = gauge[in_order ? 0 : 1];
    mesh_.mouth_right = gauge[in_order ? 1 : 0];
  }

  NodeSet group(const std::string& name, bool needed) const {
    std::set<std::int64_t> nodes;
    for (const auto& element : file_.elements) {
      if (element.dimension() == 3 || !in_group(element, name)) continue;
      for (const auto node : element.nodes)
        if (const auto found = node_of_.find(node); found != node_of_.end()) nodes.insert(found->second);
    }
    if (nodes.empty() && needed) refuse_group(name, "points, lines or surfaces of the mesh");
    return {nodes.begin(), nodes.end()};
  }

  std::string path_;
  const files::GmshFile& file_;
  HexahedronMesh mesh_;
  std::map<std::int64_t, std::int64_t> node_of_;
  std::map<std::array<std::int64_t, 8>, std::int64_t> cell_of_;
  std::set<std::string> found_;
};

}  // namespace

HexahedronMesh read_gmsh_mesh(const std::string& path, LeftSupport left_support) {
  std::string text;
  try {
    text = files::read_text(path);
  } catch (const IoError& error) {
    throw DataError(error.what());
  }
  const auto file = files::parse_gmsh_file(text, path, "the offline phase takes first-order hexahedra");
  return Builder(path, file).build(left_support);
}

}  // namespace knothe::offline
