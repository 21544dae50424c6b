#pragma once
/// @file The built-in full-order model behind the interface of all simulators.
#include "knothe/model/simulator/grid_runs.hpp"
#include "knothe/model/simulator/simulator.hpp"
#include "knothe/offline/full_order/offline.hpp"

namespace knothe::offline {

/// The damageable beam of a project. Keeps the elastic body between solutions with the same one. Outputs:
/// reaction_force [N], crack_mouth_opening [m], imposed_displacement [m], equilibrium_residual [1].
class BeamSimulator final : public model::Simulator {
 public:
  /// `axes` say which parameters there are, and what 1.0 means. Errors: as make_full_order_model.
  BeamSimulator(BeamProblem problem, std::vector<model::Axis> axes);
  [[nodiscard]] std::string key(std::span<const double> parameters) const override;
  [[nodiscard]] model::Snapshots solve(std::span<const double> parameters) override;

  /// Whether the parameters are known and in range, and the damage law has a solution on this mesh.
  void check(std::span<const double> parameters) const override;
  [[nodiscard]] std::optional<model::Snapshots> frame() const override;
  /// Each run in a forked process, body by body. The first that fails stops the rest. Records:
  /// newton_iterations, secant_iterations, cpu_seconds, and steps without equilibrium.
  [[nodiscard]] std::vector<model::RunFailure> solve_to_files(
      std::span<const model::Run> runs, int processes,
      const std::function<void(std::size_t)>& finished) override;

  [[nodiscard]] const Structure& structure() const { return model_.structure(); }

 private:
  BeamProblem problem_;
  std::vector<model::Axis> axes_;
  FullOrderModel model_;
  std::vector<double> band_ratios_;
};

/// Full-order runs of a beam on a grid of parameters. In an MPI job (ranks.hpp) each rank computes its share:
/// the parts folder must be one that every rank sees. Errors: as run_grid, BeamSimulator.
[[nodiscard]] model::GridRuns run_snapshots(const BeamProblem& problem, const model::RunGrid& grid);
/// The ranks of this MPI job, to share a grid.
[[nodiscard]] model::JobShare share_of_ranks();

}  // namespace knothe::offline
