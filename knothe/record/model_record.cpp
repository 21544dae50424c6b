#include "knothe/record/model_record.hpp"

#include <nlohmann/json.hpp>

#include "knothe/model/reduced/form_names.hpp"

namespace knothe::record {
namespace {

/// The model's errors, on the nodes and off them.
void add_errors(const model::ModelContents& model, nlohmann::ordered_json& record) {
  record["relative_error"] = model.relative_error;
  record["max_error_m"] = model.max_error_m;
  if (!model.off_grid) return;
  record["off_grid_relative_error"] = model.off_grid->relative_error;
  record["off_grid_max_error_m"] = model.off_grid->max_error_m;
  record["off_grid_source"] = model.off_grid->source;
}

}  // namespace

nlohmann::ordered_json model_record(const model::SeparatedModel& model) {
  const model::ModelContents& c = model.contents();
  nlohmann::ordered_json info = {{"file", model.where()},
                                 {"form", model::to_text(c.form)},
                                 {"space_modes", c.space_modes},
                                 {"parameter_modes", c.parameter_modes},
                                 {"dofs", model.dof_count()},
                                 {"steps", model.step_count()},
                                 {"time", {c.time.front(), c.time.back()}}};
  if (!c.time_units.empty()) info["time_units"] = c.time_units;
  for (const model::Axis& axis : c.axes) {
    info["parameters"].push_back({{"name", axis.name},
                                  {"lower", axis.nodes.front()},
                                  {"upper", axis.nodes.back()},
                                  {"nodes", axis.nodes.size()},
                                  {"units", axis.units},
                                  {"reference", axis.reference},
                                  {"long_name", axis.long_name}});
  }
  info["units"] = c.field.units;
  info["mesh_cells"] = c.mesh ? c.mesh->cell_count() : 0;
  for (const model::Quantity& quantity : c.quantities)
    info["quantities"].push_back({{"name", quantity.name}, {"units", quantity.units}});
  info["outputs"] = model.output_names();
  for (const model::SnapshotOutput& output : c.outputs)
    info["output_units"][output.name] = output.labels.units;
  info["crack_lengths"] = c.crack.length.size();
  add_errors(c, info);
  info["created_by"] = c.created_by;
  return info;
}

nlohmann::ordered_json import_record(const std::string& file, const model::ModelContents& model) {
  nlohmann::ordered_json record = {{"model", file},
                                   {"form", model::to_text(model.form)},
                                   {"space_modes", model.space_modes},
                                   {"parameter_modes", model.parameter_modes}};
  add_errors(model, record);
  return record;
}

}  // namespace knothe::record
