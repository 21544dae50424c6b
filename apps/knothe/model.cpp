#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/command_output.hpp"
#include "knothe/model/compress/compression.hpp"
#include "knothe/model/compress/quantity_scales.hpp"
#include "knothe/model/reduced/form_names.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/record/model_record.hpp"
#include "knothe/record/physical_parameters.hpp"

namespace knothe::commands {

namespace {

std::string off_grid_text(const model::ModelContents& model) {
  if (!model.off_grid) return "not known";
  return fmt::format("{:.2g} (relative), {} (from {})", model.off_grid->relative_error,
                     model::largest_error(model.off_grid->max_error_m, model.quantities),
                     model.off_grid->source);
}

}  // namespace

int model_info(const ModelArguments& arguments) {
  const auto model = model::SeparatedModel::load(arguments.model);
  const model::ModelContents& c = model.contents();
  std::string text = fmt::format(
      "{}: {} form, {} space modes, {} parameter modes, made by {}\n  {} dofs [{}], {} steps of model time "
      "{:g} … {:g}, {} mesh cells\n",
      arguments.model, model::to_text(c.form), c.space_modes, c.parameter_modes, c.created_by,
      model.dof_count(), c.field.units, model.step_count(), c.time.front(), c.time.back(),
      c.mesh ? c.mesh->cell_count() : 0);
  for (const model::Axis& axis : c.axes) {
    const std::string units = record::reference_units(axis);
    const std::string unit = units.empty() || units == "1" ? "" : " " + units;
    text += fmt::format("  {}: {:g} … {:g}{}, {} nodes{}\n", axis.name, axis.nodes.front(), axis.nodes.back(),
                        axis.reference == 1 ? unit : "", axis.nodes.size(),
                        axis.reference == 1 ? "" : fmt::format("; 1.0 = {:g}{}", axis.reference, unit));
  }
  for (const model::Quantity& quantity : c.quantities)
    text += fmt::format("  dof {} [{}]\n", quantity.name, quantity.units);
  text += fmt::format(
      "  outputs: {}; crack lengths: {}\n  error on the training grid: {:.2g} relative (L²), {}\n"
      "  error off the grid: {}",
      fmt::join(model.output_names(), ", "), c.crack.length.size(), c.relative_error,
      model::largest_error(c.max_error_m, c.quantities), off_grid_text(c));
  files::CommandOutput(arguments.json).line(record::model_record(model), text);
  return 0;
}

int model_import(const ImportArguments& arguments) {
  model::CompressionOptions options;
  options.form = *from_text<model::Form>(arguments.form);
  options.modes = arguments.modes;
  if (arguments.tolerance > 0) options.tolerance = arguments.tolerance;
  options.quiet = false;
  files::refuse_overwriting(arguments.output, {arguments.snapshots});
  const auto [model, truncation] = model::import_model_and_error(arguments.snapshots, options);
  model::write_model(model, truncation, arguments.output);
  files::CommandOutput(arguments.json)
      .line(record::import_record(arguments.output, model),
            fmt::format("{}: {} form, {} space modes, {} parameter modes, error on the grid {:.2g} "
                        "(relative), {}; off the grid {}",
                        arguments.output, arguments.form, model.space_modes, model.parameter_modes,
                        model.relative_error, model::largest_error(model.max_error_m, model.quantities),
                        off_grid_text(model)));
  if (arguments.tolerance > 0 && model.relative_error > arguments.tolerance)
    fmt::print(stderr, "note: --modes {} is too few for --tolerance {:g}\n", arguments.modes,
               arguments.tolerance);
  return 0;
}

}  // namespace knothe::commands
