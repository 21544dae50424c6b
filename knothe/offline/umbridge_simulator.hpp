#pragma once
/// @file A model of a UM-Bridge server as full-order model.
#include "knothe/inference/umbridge_model.hpp"
#include "knothe/project/offline_options.hpp"
#include "knothe/simulator/simulator.hpp"

namespace knothe::offline {

/// Outputs are quantities at times. One request after the other. What the server computes is not seen: the
/// key is its address, name and configuration.
class UmbridgeSimulator final : public simulator::Simulator {
 public:
  /// Asks the server for what it has. DataError, with its address, also where its sizes are not those of
  /// parameters, times and names.
  UmbridgeSimulator(project::UmbridgeSource source, std::vector<reduction::Axis> axes);
  [[nodiscard]] std::string key(std::span<const double> parameters) const override;
  [[nodiscard]] reduction::Snapshots solve(std::span<const double> parameters) override;

 private:
  project::UmbridgeSource source_;
  std::vector<reduction::Axis> axes_;
  inference::UmbridgeModel model_;
};

}  // namespace knothe::offline
