#pragma once
/// @file A full-order model whose solutions are put on the axis of one of its outputs.
#include <memory>

#include "knothe/model/simulator/simulator.hpp"

namespace knothe::model {

/// An output of the full-order model that takes the place of time.
struct TimeAxis {
  std::string output;          ///< must grow from step to step in every solution
  std::vector<double> values;  ///< of it, strictly increasing: the model's times
};

/// Puts a solution of one point on the axis: field and outputs are linear in the output between two steps of
/// the solver. The lift is left out, for it is another one in each solution. Errors: NumericalError if the
/// output does not grow, begins after the axis or ends before it, with the values and what to do;
/// ProjectError if there is no such output.
[[nodiscard]] Snapshots resampled(const Snapshots& solution, const TimeAxis& axis);

/// Solutions of another simulator, resampled. A test that is controlled by an opening, say, is compared at
/// equal openings, which a solver that prescribes the displacement reaches at other steps for each parameter.
class ResampledSimulator final : public Simulator {
 public:
  ResampledSimulator(std::unique_ptr<Simulator> simulator, TimeAxis axis);

  [[nodiscard]] std::string key(std::span<const double> parameters) const override;
  [[nodiscard]] Snapshots solve(std::span<const double> parameters) override;
  [[nodiscard]] std::vector<Snapshots> solve_all(std::span<const std::vector<double>> points,
                                                 const std::function<void(std::size_t)>& finished) override;
  void check(std::span<const double> parameters) const override { simulator_->check(parameters); }
  [[nodiscard]] std::optional<Snapshots> frame() const override;
  /// The solver's own runs stay in the same folder: another axis needs no new ones.
  [[nodiscard]] std::vector<RunFailure> solve_to_files(
      std::span<const Run> runs, int processes, const std::function<void(std::size_t)>& finished) override;

 private:
  std::unique_ptr<Simulator> simulator_;
  TimeAxis axis_;
};

}  // namespace knothe::model
