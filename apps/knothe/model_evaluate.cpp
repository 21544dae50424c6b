#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/reduction/model/separated_model.hpp"

namespace knothe::commands {
namespace {

using Json = nlohmann::ordered_json;
using reduction::SeparatedModel;

/// "NAME=V,NAME=V" → the values in the model's order.
std::vector<double> parse_point(const std::string& text, const SeparatedModel& model) {
  const std::vector<std::string> names = model.parameter_names();
  std::vector<double> values(names.size());
  std::vector<bool> given(names.size(), false);
  for (std::size_t begin = 0; begin < text.size();) {
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
    const auto k = static_cast<std::size_t>(it - names.begin());
    values[k] = std::strtod(number.c_str(), &rest);
    if (number.empty() || *rest != '\0')
      throw UsageError(fmt::format("--at {}: \"{}\" is not a number", text, number));
    if (given[k]) throw UsageError(fmt::format("--at {}: \"{}\" is given twice", text, name));
    given[k] = true;
    begin = end + 1;
  }
  for (std::size_t k = 0; k < names.size(); ++k) {
    if (!given[k]) throw UsageError(fmt::format("--at {}: the value of \"{}\" is missing", text, names[k]));
  }
  return values;
}

}  // namespace

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

}  // namespace knothe::commands
