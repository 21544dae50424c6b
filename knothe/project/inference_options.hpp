#pragma once
/// @file The tables of a project file that only `knothe infer` reads: [model] umbridge, [observations].
#include <string>
#include <vector>

#include "knothe/model/forward/umbridge_model.hpp"

namespace knothe::project {

struct Values;

/// A model behind a UM-Bridge server ([model] umbridge); without a `url` the model is a separated one.
struct UmbridgeOptions : model::UmbridgeSettings {
  double difference_step = 1e-4;  ///< in units of the prior's scale
};

/// What `knothe infer` compares the model's outputs with.
struct ObservationOptions {
  std::vector<double> values;
  std::vector<double> std;                      ///< as many, or empty
  std::vector<std::vector<double>> covariance;  ///< rows; or empty
  std::vector<std::size_t> dofs, steps;         ///< of a separated model
  std::string output;                           ///< of a separated model
};

/// [model] umbridge and what belongs to it.
[[nodiscard]] UmbridgeOptions read_umbridge(Values& values);
/// [observations], with its noise checked: sizes, symmetry, definiteness.
[[nodiscard]] ObservationOptions read_observations(Values& values);

}  // namespace knothe::project
