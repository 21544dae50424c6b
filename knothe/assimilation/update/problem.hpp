#pragma once
/// @file What is assimilated, and how: the one description that the project file, Python, the library and the
/// service fill, and that the engine and its methods take.
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/noise/noise_model.hpp"
#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/assimilation/update/prior.hpp"
#include "knothe/assimilation/update/robust_options.hpp"
#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/reduction/observe/observed_model.hpp"

namespace knothe::assimilation {

struct Problem {
  std::shared_ptr<const reduction::ObservedModel> model;  ///< at the sensors
  NoiseModel noise;                                       ///< of a datum without noise of its own
  std::vector<Prior> priors;                              ///< in the order of the model's parameters
  UpdateOptions update;
  RobustOptions robust;  ///< gating, Student-t
  /// Steps to assimilate with the corrected model, first and last; needs `update.learn_bias`.
  std::optional<std::array<std::size_t, 2>> corrected_steps;
};

/// What cannot be combined (`compatibility.hpp`) looks at these.
[[nodiscard]] Features features_of(const Problem& problem);

}  // namespace knothe::assimilation
