#include "knothe/model/reduced/parameter_order.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/model/grid/validation.hpp"

namespace knothe::model {

namespace {

/// order[k] = the position among the model's axes of names[k].
std::vector<std::size_t> order_of(const ModelContents& contents, std::span<const std::string> names) {
  std::vector<std::string> known;
  for (const Axis& axis : contents.axes) known.push_back(axis.name);
  std::vector<std::size_t> order;
  for (const std::string& name : names) {
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end()) {
      throw ProjectError(fmt::format("the model has no parameter {}{}; it has: {}", name,
                                     did_you_mean(name, known), fmt::join(known, ", ")));
    }
    const std::size_t position = found - known.begin();
    if (std::find(order.begin(), order.end(), position) != order.end()) {
      throw ProjectError(fmt::format("parameter {} is named twice", name));
    }
    order.push_back(position);
  }
  for (Index i = 0; i < std::ssize(known); ++i) {
    if (std::find(order.begin(), order.end(), i) == order.end()) {
      throw ProjectError(fmt::format("the model's parameter {} is missing among those given: it has {}",
                                     known[i], fmt::join(known, ", ")));
    }
  }
  return order;
}

/// An array [before, n₁, …, n_d, after] with its middle axes permuted.
std::vector<double> permuted(const std::vector<double>& values, const files::Shape& grid,
                             const std::vector<std::size_t>& order, std::size_t before, std::size_t after) {
  const std::size_t points = product(grid);
  std::vector<std::size_t> stride(grid.size(), 1);
  for (std::size_t i = grid.size() - 1; i-- > 0;) stride[i] = stride[i + 1] * grid[i + 1];
  std::vector<double> result;
  result.reserve(values.size());
  for (std::size_t block = 0; block < before; ++block) {
    std::vector<std::size_t> index(grid.size(), 0);
    for (std::size_t point = 0; point < points; ++point) {
      std::size_t source = 0;
      for (Index k = 0; k < std::ssize(order); ++k) source += index[k] * stride[order[k]];
      const auto first = values.begin() + (block * points + source) * after;
      result.insert(result.end(), first, first + after);
      for (std::size_t k = order.size(); k-- > 0;) {
        if (++index[k] < grid[order[k]]) break;
        index[k] = 0;
      }
    }
  }
  return result;
}

}  // namespace

ModelContents with_parameter_order(ModelContents contents, std::span<const std::string> names) {
  const std::vector<std::size_t> order = order_of(contents, names);
  if (std::is_sorted(order.begin(), order.end())) return contents;
  const files::Shape grid = contents.grid_shape();
  if (contents.form == Form::tree)
    contents.joint = permuted(contents.joint, grid, order, contents.parameter_modes, 1);
  for (SnapshotOutput& output : contents.outputs) {
    output.values = permuted(output.values, grid, order, 1, contents.time.size());
  }
  const ModelContents before = contents;
  for (Index k = 0; k < std::ssize(order); ++k) {
    contents.axes[k] = before.axes[order[k]];
    if (contents.form == Form::canonical) contents.parameters[k] = before.parameters[order[k]];
  }
  return contents;
}

std::vector<double> point_at(const std::string& text, const std::vector<std::string>& names) {
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
    const std::size_t k = it - names.begin();
    values[k] = std::strtod(number.c_str(), &rest);
    if (number.empty() || *rest != '\0')
      throw UsageError(fmt::format("--at {}: \"{}\" is not a number", text, number));
    if (given[k]) throw UsageError(fmt::format("--at {}: \"{}\" is given twice", text, name));
    given[k] = true;
    begin = end + 1;
  }
  for (Index k = 0; k < std::ssize(names); ++k) {
    if (!given[k]) throw UsageError(fmt::format("--at {}: the value of \"{}\" is missing", text, names[k]));
  }
  return values;
}

}  // namespace knothe::model
