#include "knothe/model/reduced/field_file.hpp"

#include <fmt/format.h>

#include <array>
#include <cassert>
#include <cmath>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::model {
namespace {

/// A point to the nanometre: the key under which dofs and mesh points meet.
std::array<long long, 3> key_of(const double* point) {
  return {std::llround(point[0] * 1e9), std::llround(point[1] * 1e9), std::llround(point[2] * 1e9)};
}

}  // namespace

FieldOnMesh::FieldOnMesh(const ModelContents& contents, const std::string& where) : contents_(contents) {
  if (!contents.mesh) throw DataError(where + ": the model has no mesh: there is no field to write");
  std::map<std::array<long long, 3>, std::size_t> points;
  for (std::size_t i = 0; i < contents.mesh->point_count(); ++i)
    points[key_of(&contents.mesh->points[3 * i])] = i;
  for (Index i = 0; i < std::ssize(contents.dofs.components); ++i) {
    const double* at = &contents.dofs.points[3 * i];
    const auto it = points.find(key_of(at));
    if (it == points.end()) {
      throw DataError(fmt::format("{}: dofs/points[{}] = ({:g}, {:g}, {:g}) is no point of the mesh", where,
                                  i, at[0], at[1], at[2]));
    }
    position_.push_back(3 * it->second + contents.dofs.components[i]);
  }
}

files::VtuField FieldOnMesh::vectors(const std::string& name, std::span<const double> values) const {
  assert(values.size() == position_.size());
  files::VtuField field{name, 3, std::vector<double>(contents_.mesh->points.size(), 0.0),
                        contents_.field.units};
  for (Index i = 0; i < std::ssize(values); ++i) field.values[position_[i]] = values[i];
  return field;
}

void FieldOnMesh::write(std::vector<files::VtuField> fields, const std::string& path,
                        std::optional<double> time) const {
  const Mesh& mesh = *contents_.mesh;
  files::write_vtu({mesh.points, mesh.cells, mesh.nodes_per_cell, mesh.type, std::move(fields), {}, time},
                   path);
}

void write_field(const ModelContents& contents, std::span<const double> values, double time,
                 const std::string& path) {
  const FieldOnMesh mesh(contents, path);
  const std::string& name = contents.field.long_name;
  mesh.write({mesh.vectors(name.empty() ? "displacement" : name, values)}, path, time);
}

}  // namespace knothe::model
