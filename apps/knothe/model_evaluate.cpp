#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "apps/offline_command_line.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/model/reduced/parameter_order.hpp"
#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::commands {
using Json = nlohmann::ordered_json;
using model::SeparatedModel;

int model_evaluate(const EvaluateArguments& arguments) {
  const auto model = SeparatedModel::load(arguments.model);
  const std::vector<double> point = model::point_at(arguments.at, model.parameter_names());
  if (arguments.step < 0 || static_cast<std::size_t>(arguments.step) >= model.step_count()) {
    throw UsageError(
        fmt::format("--step {}: the model has steps 0 to {}", arguments.step, model.step_count() - 1));
  }
  std::vector<std::size_t> dofs;
  for (long dof : arguments.dofs) {
    if (dof < 0 || static_cast<std::size_t>(dof) >= model.dof_count()) {
      throw UsageError(fmt::format("--dofs {}: the model has dofs 0 to {}", dof, model.dof_count() - 1));
    }
    dofs.push_back(dof);
  }
  const std::size_t step = arguments.step;
  if (!arguments.output.empty()) {
    files::refuse_overwriting(arguments.output, {arguments.model});
    if (!model.contents().mesh)
      throw DataError(model.where() + ": the model has no mesh: there is no field to write");
    model::write_field(model.contents(), model.evaluate(point, step).value, model.contents().time[step],
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
      const auto gradient = field.gradient.begin() + i * d;
      line["gradient"].push_back(std::vector<double>(gradient, gradient + d));
      Json rows = Json::array();
      for (std::size_t a = 0; a < d; ++a) {
        const auto row = field.hessian.begin() + (i * d + a) * d;
        rows.push_back(std::vector<double>(row, row + d));
      }
      line["hessian"].push_back(std::move(rows));
    }
  }
  fmt::print("{}\n", files::json_line(line));
  return 0;
}

}  // namespace knothe::commands
