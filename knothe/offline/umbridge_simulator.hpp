#pragma once
/// @file A model of a UM-Bridge server as full-order model.
#include "knothe/model/forward/umbridge_model.hpp"
#include "knothe/model/simulator/simulator.hpp"
#include "knothe/project/offline_options.hpp"

namespace knothe::offline {

/// Outputs are quantities at times. One request after the other. What the server computes is not seen: the
/// key is its address, name and configuration.
class UmbridgeSimulator final : public model::Simulator {
 public:
  /// Asks the server for what it has. DataError, with its address, also where its sizes are not those of
  /// parameters, times and names.
  UmbridgeSimulator(project::UmbridgeSource source, std::vector<model::Axis> axes);
  [[nodiscard]] std::string key(std::span<const double> parameters) const override;
  [[nodiscard]] model::Snapshots solve(std::span<const double> parameters) override;

 private:
  project::UmbridgeSource source_;
  std::vector<model::Axis> axes_;
  model::UmbridgeModel model_;
};

}  // namespace knothe::offline
