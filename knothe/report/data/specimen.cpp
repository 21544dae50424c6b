#include "knothe/report/data/specimen.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/record/number_text.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::ordered_json;

/// The six faces of a hexahedron in VTK's vertex order.
constexpr std::array<std::array<int, 4>, 6> k_faces = {
    {{0, 1, 2, 3}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}}};

constexpr std::size_t k_max_modes = 4;
constexpr std::size_t k_max_field_numbers = 60000;  ///< of all fields that are written

/// The outer face with the dofs that move its nodes.
struct FaceDofs {
  OuterFace face;
  std::vector<std::ptrdiff_t> x, y;
};

FaceDofs face_of(const model::SeparatedModel& model) {
  const auto& contents = model.contents();
  FaceDofs result{outer_face(*contents.mesh), {}, {}};
  result.x = dofs_of_face(result.face, contents.dofs, 0);
  result.y = dofs_of_face(result.face, contents.dofs, 1);
  return result;
}

Json field_record(const std::string& title, const FaceDofs& f, std::span<const double> field,
                  double scale = 1) {
  const auto at = [&](std::ptrdiff_t dof) { return dof < 0 ? 0.0 : scale * field[dof]; };
  Json x = Json::array(), y = Json::array();
  for (const std::ptrdiff_t dof : f.x) x.push_back(at(dof));
  for (const std::ptrdiff_t dof : f.y) y.push_back(at(dof));
  return {{"title", title}, {"x", std::move(x)}, {"y", std::move(y)}};
}

/// A mode of a model, scaled such that its largest horizontal component is 1.
Json mode_record(const std::string& title, const FaceDofs& face, std::span<const double> mode) {
  double largest = 0;
  for (const std::ptrdiff_t dof : face.x)
    if (dof >= 0) largest = std::max(largest, std::abs(mode[dof]));
  return field_record(title, face, mode, largest > 0 ? 1 / largest : 1);
}

Json crack_records(const model::SeparatedModel& model, const FaceDofs& face) {
  Json records = Json::array();
  const auto& crack = model.contents().crack;
  if (crack.empty()) return records;
  const std::size_t n = model.dof_count(), modes = crack.modes.size() / n;
  std::size_t last = crack.length.size();
  for (const double wanted : {0.0, 0.025, 0.05, 0.075}) {
    std::size_t best = 0;
    for (std::size_t i = 0; i < crack.length.size(); ++i)
      if (std::abs(crack.length[i] - wanted) < std::abs(crack.length[best] - wanted)) best = i;
    if (best == last) continue;  // there is none nearer to this length
    last = best;
    std::vector<double> field(n, 0.0);
    for (std::size_t k = 0; k < modes; ++k)
      for (std::size_t j = 0; j < n; ++j)
        field[j] += crack.coefficients[best * modes + k] * crack.modes[k * n + j];
    records.push_back(field_record(
        fmt::format("Elastic beam, crack of {} mm", record::plain(1e3 * crack.length[best])), face, field));
  }
  return records;
}

}  // namespace

OuterFace outer_face(const model::Mesh& mesh) {
  if (mesh.nodes_per_cell != 8)
    throw DataError(fmt::format("mesh/cells: {} nodes per cell; the picture of a mesh needs hexahedra of 8",
                                mesh.nodes_per_cell));
  double top = -INFINITY, extent = 0.0;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    top = std::max(top, mesh.points[3 * i + 2]);
    for (int c = 0; c < 3; ++c) extent = std::max(extent, std::abs(mesh.points[3 * i + c]));
  }
  OuterFace face;
  std::map<std::size_t, std::size_t> own_number;
  for (std::size_t cell = 0; cell < mesh.cell_count(); ++cell) {
    for (const auto& corners : k_faces) {
      std::array<std::size_t, 4> nodes{};
      bool outside = true;
      for (std::size_t k = 0; k < 4; ++k) {
        const std::int64_t node = mesh.cells[8 * cell + corners[k]], points = mesh.point_count();
        if (node < 0 || node >= points)
          throw DataError(fmt::format("mesh/cells[{},{}] = {}: no such point", cell, corners[k], node));
        nodes[k] = node;
        outside = outside && mesh.points[3 * nodes[k] + 2] >= top - 1e-6 * extent;
      }
      if (!outside) continue;
      std::array<std::size_t, 4> own{};
      for (std::size_t k = 0; k < 4; ++k) {
        const auto [entry, is_new] = own_number.try_emplace(nodes[k], face.nodes.size());
        if (is_new) {
          face.nodes.push_back(nodes[k]);
          face.points.push_back({mesh.points[3 * nodes[k]], mesh.points[3 * nodes[k] + 1]});
        }
        own[k] = entry->second;
      }
      face.cells.push_back(own);
    }
  }
  return face;
}

std::vector<std::ptrdiff_t> dofs_of_face(const OuterFace& face, const model::Dofs& dofs,
                                         std::int64_t component) {
  double top = -INFINITY;
  for (std::size_t i = 0; i < dofs.components.size(); ++i) top = std::max(top, dofs.points[3 * i + 2]);
  const auto key = [](double x, double y) { return std::pair(std::llround(x * 1e7), std::llround(y * 1e7)); };
  std::map<std::pair<long long, long long>, std::ptrdiff_t> index;
  for (std::size_t i = 0; i < dofs.components.size(); ++i)
    if (dofs.components[i] == component && dofs.points[3 * i + 2] >= top - 1e-7)
      index[key(dofs.points[3 * i], dofs.points[3 * i + 1])] = i;
  std::vector<std::ptrdiff_t> found;
  for (const auto& point : face.points) {
    const auto entry = index.find(key(point[0], point[1]));
    found.push_back(entry == index.end() ? -1 : entry->second);
  }
  return found;
}

bool can_be_drawn(const model::SeparatedModel& model) {
  const auto& contents = model.contents();
  return contents.mesh && contents.mesh->nodes_per_cell == 8 && !contents.dofs.empty();
}

Json face_record(const OuterFace& face) {
  return {{"points", face.points}, {"cells", face.cells}};
}

Json specimen_record(const model::SeparatedModel& model, std::span<const double> p) {
  const auto& contents = model.contents();
  const FaceDofs face = face_of(model);
  Json record = face_record(face.face);
  const std::size_t last = contents.time.size() - 1;
  const std::size_t count = std::clamp<std::size_t>(
      k_max_field_numbers / (2 * std::max<std::size_t>(1, face.face.points.size())), 2, 21);
  std::size_t previous = contents.time.size();
  record["fields"] = Json::array();
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t step = i * last / (count - 1);
    if (step == previous) continue;
    previous = step;
    Json field = field_record("Displacement", face, model.evaluate(p, step).value);
    field["time"] = contents.time[step];
    record["fields"].push_back(std::move(field));
  }
  record["modes"] = Json::array();
  for (std::size_t k = 0; k < std::min(k_max_modes, contents.space_modes); ++k) {
    const std::size_t n = contents.dof_count();
    record["modes"].push_back(mode_record(fmt::format("Space mode {}", k + 1), face,
                                          std::span<const double>(contents.space).subspan(k * n, n)));
  }
  record["crack"] = crack_records(model, face);
  return record;
}

Json load_record(const record::Results& results, const model::SeparatedModel* model) {
  constexpr std::size_t k_max_draws = 200;
  if (results.displacement.empty()) return nullptr;
  Json record = {
      {"time", results.curve_time}, {"displacement", results.displacement}, {"mean", results.force}};
  const auto has_force = [&] {
    const auto names = model->output_names();
    return std::find(names.begin(), names.end(), "reaction_force") != names.end();
  };
  if (model == nullptr || results.draws.empty() || results.draws.front().empty() || !has_force())
    return record;
  const auto& axes = model->contents().axes;
  std::vector<std::vector<double>> by_time(results.force.size());
  const std::size_t draws = results.draws.front().size(), stride = 1 + (draws - 1) / k_max_draws;
  for (std::size_t j = 0; j < draws; j += stride) {
    std::vector<double> p = drawing_point(results, *model);
    for (std::size_t k = 0; k < p.size(); ++k)
      for (std::size_t d = 0; d < results.parameters.size(); ++d)
        if (results.parameters[d].name == axes[k].name)
          p[k] = std::clamp(results.draws[d][j], axes[k].nodes.front(), axes[k].nodes.back());
    const std::vector<double> force = model->evaluate_output("reaction_force", p).value;
    if (force.size() != by_time.size()) return record;  // the model is another one by now
    for (std::size_t t = 0; t < force.size(); ++t) by_time[t].push_back(force[t]);
  }
  for (std::vector<double>& forces : by_time) {
    std::sort(forces.begin(), forces.end());
    const double last = forces.size() - 1.0;
    record["low"].push_back(forces[std::lround(0.025 * last)]);
    record["high"].push_back(forces[std::lround(0.975 * last)]);
  }
  return record;
}

std::vector<double> drawing_point(const record::Results& results, const model::SeparatedModel& model) {
  std::vector<double> p;
  for (const auto& axis : model.contents().axes) {
    double value = 0.5 * (axis.nodes.front() + axis.nodes.back());
    for (std::size_t d = 0; d < results.parameters.size(); ++d)
      if (results.parameters[d].name == axis.name) value = results.steps.back().mean[d];
    p.push_back(std::clamp(value, axis.nodes.front(), axis.nodes.back()));
  }
  return p;
}

}  // namespace knothe::report
