#include "knothe/model/reduced/outputs.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"

namespace knothe::model {

const SnapshotOutput& output_of(const SeparatedModel& model, const std::string& name) {
  for (const SnapshotOutput& output : model.contents().outputs)
    if (output.name == name) return output;
  const std::vector<std::string> names = model.output_names();
  throw UsageError(fmt::format("{} has no output \"{}\"{}; it has {}", model.where(), name,
                               did_you_mean(name, names),
                               names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
}

JointFunctions functions_of(const ModelContents& contents, const SnapshotOutput& output) {
  const auto times = std::ssize(contents.time);
  const auto grid = std::ssize(output.values) / times;
  const RowMatrix by_time = Eigen::Map<const RowMatrix>(output.values.data(), grid, times).transpose();
  return JointFunctions(nodes_of(contents.axes), std::span(by_time.data(), by_time.size()), times);
}

std::vector<std::vector<double>> nodes_of(std::span<const Axis> axes) {
  std::vector<std::vector<double>> nodes;
  for (const Axis& axis : axes) nodes.push_back(axis.nodes);
  return nodes;
}

}  // namespace knothe::model
