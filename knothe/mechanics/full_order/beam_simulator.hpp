#pragma once
/// @file The built-in full-order model behind the interface of all simulators.
#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/simulator/simulator.hpp"

namespace knothe::mechanics {

/// The damageable beam of a project. Keeps the elastic body between solutions with the same one.
class BeamSimulator final : public simulator::Simulator {
 public:
  /// `axes` say which parameters there are, and what 1.0 means. Errors: as make_full_order_model.
  BeamSimulator(BeamProblem problem, std::vector<reduction::Axis> axes);
  [[nodiscard]] std::string key(std::span<const double> parameters) const override;
  /// NumericalError, beside what run_at throws, where a step is not in equilibrium.
  [[nodiscard]] reduction::Snapshots solve(std::span<const double> parameters) override;

  [[nodiscard]] const Structure& structure() const { return model_.structure(); }

 private:
  BeamProblem problem_;
  std::vector<reduction::Axis> axes_;
  FullOrderModel model_;
};

}  // namespace knothe::mechanics
