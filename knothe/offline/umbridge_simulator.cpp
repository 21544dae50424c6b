#include "knothe/offline/umbridge_simulator.hpp"

#include <fmt/format.h>

#include <Eigen/Core>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/simulator/result_file.hpp"

namespace knothe::offline {
namespace {

model::UmbridgeSettings settings_of(const project::UmbridgeSource& source,
                                    const std::vector<model::Axis>& axes) {
  model::UmbridgeSettings settings;
  settings.url = source.url;
  settings.name = source.name;
  settings.config = source.config;
  settings.timeout = source.timeout;
  settings.derivatives = 0;
  settings.table = "[offline.umbridge]";
  for (const model::Axis& axis : axes) settings.parameters.push_back(axis.name);
  return settings;
}

}  // namespace

UmbridgeSimulator::UmbridgeSimulator(project::UmbridgeSource source, std::vector<model::Axis> axes)
    : source_(std::move(source)), axes_(std::move(axes)), model_(settings_of(source_, axes_)) {
  const std::size_t times = source_.times.size(), names = source_.names.size();
  if (model_.dimension() != std::ssize(axes_))
    throw DataError(fmt::format("{}: the model has {} inputs, [offline.parameters] {} parameters",
                                model_.where(), model_.dimension(), axes_.size()));
  if (static_cast<std::size_t>(model_.output_count()) != times * names)
    throw DataError(fmt::format("{}: the model has {} outputs, [offline.umbridge] {} times of {} quantities",
                                model_.where(), model_.output_count(), times, names));
}

std::string UmbridgeSimulator::key(std::span<const double> parameters) const {
  std::string text = fmt::format("umbridge {} {} {} | {:a} | {} {}", source_.url, model_.name(),
                                 source_.config, fmt::join(source_.times, " "), fmt::join(source_.names, ","),
                                 fmt::join(source_.units, ","));
  if (!source_.time_units.empty()) text += " | time in " + source_.time_units;
  for (Index i = 0; i < std::ssize(axes_); ++i)
    text += fmt::format(" | {} {:a}", axes_[i].name, parameters[i] * axes_[i].reference);
  return text;
}

model::Snapshots UmbridgeSimulator::solve(std::span<const double> parameters) {
  Eigen::MatrixXd point(std::ssize(axes_), 1), values(model_.output_count(), 1);
  for (Index i = 0; i < std::ssize(axes_); ++i) point(i, 0) = parameters[i] * axes_[i].reference;
  model_.evaluate(point, values);
  model::Snapshots solution;
  solution.axes = axes_;
  for (Index i = 0; i < std::ssize(axes_); ++i) solution.axes[i].nodes = {parameters[i]};
  solution.field = {"1", "quantities, each in its own unit"};
  solution.time = source_.times;
  model::state_time_units(solution, source_.time_units);
  solution.values.assign(values.data(), values.data() + values.size());
  for (Index k = 0; k < std::ssize(source_.names); ++k)
    solution.quantities.push_back(
        {source_.names[k], k < std::ssize(source_.units) ? source_.units[k] : std::string("1")});
  model::settle_units(solution, source_.url);
  return solution;
}

}  // namespace knothe::offline
