#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/reduction/compress/compression.hpp"
#include "knothe/reduction/model/form_names.hpp"
#include "knothe/reduction/model/separated_model.hpp"
#include "knothe/reduction/model/truncation_error.hpp"

namespace knothe::commands {
namespace {

using Json = nlohmann::ordered_json;
using reduction::SeparatedModel;

/// "NAME=V,NAME=V" → the values in the model's order.
std::vector<double> parse_point(const std::string& text, const SeparatedModel& model) {
  const std::vector<std::string> names = model.parameter_names();
  std::vector<double> values(names.size());
  std::vector<bool> given(names.size(), false);
  std::size_t begin = 0;
  while (begin < text.size()) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    const std::string item = text.substr(begin, end - begin);
    const std::size_t equals = item.find('=');
    const std::string name = item.substr(0, equals);
    const auto it = std::find(names.begin(), names.end(), name);
    if (it == names.end() || equals == std::string::npos) {
      throw UsageError(fmt::format("--at {}: the model has no parameter \"{}\"{}; it has {}", text, name,
                                   did_you_mean(name, names), fmt::join(names, ", ")));
    }
    char* rest = nullptr;
    const std::string number = item.substr(equals + 1);
    values[it - names.begin()] = std::strtod(number.c_str(), &rest);
    if (number.empty() || *rest != '\0')
      throw UsageError(fmt::format("--at {}: \"{}\" is not a number", text, number));
    if (given[it - names.begin()])
      throw UsageError(fmt::format("--at {}: \"{}\" is given twice", text, name));
    given[it - names.begin()] = true;
    begin = end + 1;
  }
  for (std::size_t k = 0; k < names.size(); ++k) {
    if (!given[k]) throw UsageError(fmt::format("--at {}: the value of \"{}\" is missing", text, names[k]));
  }
  return values;
}

}  // namespace

int model_info(const ModelArguments& arguments) {
  const auto model = SeparatedModel::load(arguments.model);
  const reduction::ModelContents& c = model.contents();
  Json info = {{"file", arguments.model},
               {"form", reduction::to_text(c.form)},
               {"space_modes", c.space_modes},
               {"parameter_modes", c.parameter_modes},
               {"dofs", model.dof_count()},
               {"steps", model.step_count()},
               {"time", {c.time.front(), c.time.back()}}};
  for (const reduction::Axis& axis : c.axes) {
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
  info["outputs"] = model.output_names();
  info["crack_lengths"] = c.crack.length.size();
  info["relative_error"] = c.relative_error;
  info["max_error_m"] = c.max_error_m;
  info["created_by"] = c.created_by;
  if (arguments.json) {
    fmt::print("{}\n", files::json_line(info));
    return 0;
  }
  fmt::print("{}: {} form, {} space modes, {} parameter modes, made by {}\n", arguments.model,
             reduction::to_text(c.form), c.space_modes, c.parameter_modes, c.created_by);
  fmt::print("  {} dofs [{}], {} steps of model time {:g} … {:g}, {} mesh cells\n", model.dof_count(),
             c.field.units, model.step_count(), c.time.front(), c.time.back(),
             c.mesh ? c.mesh->cell_count() : 0);
  for (const reduction::Axis& axis : c.axes) {
    fmt::print("  {}: {:g} … {:g}, {} nodes; 1.0 is {:g} {}\n", axis.name, axis.nodes.front(),
               axis.nodes.back(), axis.nodes.size(), axis.reference, axis.units);
  }
  fmt::print("  outputs: {}; crack lengths: {}\n", fmt::join(model.output_names(), ", "),
             c.crack.length.size());
  fmt::print("  error on the training grid: {:.2g} relative (L²), at most {:.3g} µm on any dof\n",
             c.relative_error, c.max_error_m * 1e6);
  return 0;
}

int model_evaluate(const EvaluateArguments& arguments) {
  const auto model = SeparatedModel::load(arguments.model);
  const std::vector<double> point = parse_point(arguments.at, model);
  if (arguments.step < 0 || static_cast<std::size_t>(arguments.step) >= model.step_count()) {
    throw UsageError(
        fmt::format("--step {}: the model has steps 0 to {}", arguments.step, model.step_count() - 1));
  }
  std::vector<std::size_t> dofs;
  for (long dof : arguments.dofs) {
    if (dof < 0 || static_cast<std::size_t>(dof) >= model.dof_count()) {
      throw UsageError(fmt::format("--dofs {}: the model has dofs 0 to {}", dof, model.dof_count() - 1));
    }
    dofs.push_back(static_cast<std::size_t>(dof));
  }
  const auto step = static_cast<std::size_t>(arguments.step);
  if (!arguments.output.empty()) {
    files::refuse_overwriting(arguments.output, {arguments.model});
    if (!model.contents().mesh)
      throw DataError(model.where() + ": the model has no mesh: there is no field to write");
    reduction::write_field(model.contents(), model.evaluate(point, step).value, model.contents().time[step],
                           arguments.output);
  }
  if (!arguments.json && !arguments.output.empty()) return 0;
  const auto field = model.evaluate(point, step, dofs, arguments.derivatives ? 2 : 0);
  Json line = {{"values", field.value}};
  if (arguments.derivatives) {
    line["gradient"] = Json::array();
    line["hessian"] = Json::array();
    const std::size_t d = field.dimension;
    for (std::size_t i = 0; i < field.count; ++i) {
      const auto gradient = field.gradient.begin() + static_cast<std::ptrdiff_t>(i * d);
      line["gradient"].push_back(std::vector<double>(gradient, gradient + static_cast<std::ptrdiff_t>(d)));
      Json rows = Json::array();
      for (std::size_t a = 0; a < d; ++a) {
        const auto row = field.hessian.begin() + static_cast<std::ptrdiff_t>((i * d + a) * d);
        rows.push_back(std::vector<double>(row, row + static_cast<std::ptrdiff_t>(d)));
      }
      line["hessian"].push_back(std::move(rows));
    }
  }
  fmt::print("{}\n", files::json_line(line));
  return 0;
}

int model_import(const ImportArguments& arguments) {
  reduction::CompressionOptions options;
  options.form = *from_text<reduction::Form>(arguments.form);
  options.modes = static_cast<std::size_t>(arguments.modes);
  if (arguments.tolerance > 0) options.tolerance = arguments.tolerance;
  options.quiet = false;
  files::refuse_overwriting(arguments.output, {arguments.snapshots});
  const auto [model, truncation] = reduction::import_model_and_error(arguments.snapshots, options);
  reduction::write_model(model, truncation, arguments.output);
  fmt::print(
      "{}: {} form, {} space modes, {} parameter modes, error on the grid {:.2g} (relative), at most {:.3g} "
      "µm\n",
      arguments.output, arguments.form, model.space_modes, model.parameter_modes, model.relative_error,
      model.max_error_m * 1e6);
  if (arguments.tolerance > 0 && model.relative_error > arguments.tolerance)
    fmt::print(stderr, "note: --modes {} is too few for --tolerance {:g}\n", arguments.modes,
               arguments.tolerance);
  return 0;
}

}  // namespace knothe::commands
