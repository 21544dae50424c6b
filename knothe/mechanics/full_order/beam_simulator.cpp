#include "knothe/mechanics/full_order/beam_simulator.hpp"

#include <utility>

#include "knothe/mechanics/full_order/run_key.hpp"

namespace knothe::mechanics {

BeamSimulator::BeamSimulator(BeamProblem problem, std::vector<reduction::Axis> axes)
    : problem_(std::move(problem)), axes_(std::move(axes)), model_(make_full_order_model(problem_)) {}

std::string BeamSimulator::key(std::span<const double> parameters) const {
  return run_key(problem_at(problem_, axes_, parameters));
}

reduction::Snapshots BeamSimulator::solve(std::span<const double> parameters) {
  const BeamProblem point = problem_at(problem_, axes_, parameters);
  reduction::Snapshots solution =
      as_snapshots(point, structure(), run_at(model_, problem_, axes_, parameters));
  solution.axes = axes_;
  for (std::size_t i = 0; i < axes_.size(); ++i) solution.axes[i].nodes = {parameters[i]};
  return solution;
}

}  // namespace knothe::mechanics
