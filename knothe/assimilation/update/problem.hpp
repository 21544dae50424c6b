#pragma once
/// @file What is assimilated, and how: the one description that the project file, Python, the library and the
/// service fill, and that the engine and its methods take.
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/likelihood/step/robust_options.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::assimilation {

struct Problem {
  std::shared_ptr<const model::ObservedModel> model;  ///< at the sensors
  likelihood::NoiseModel noise;                       ///< of a datum without noise of its own
  std::vector<posterior::Prior> priors;               ///< in the order of the model's parameters
  UpdateOptions update;
  likelihood::RobustOptions robust;  ///< gating, Student-t
  /// Steps to assimilate with the corrected model, first and last; needs `update.learn_bias`.
  std::optional<std::array<std::size_t, 2>> corrected_steps;
};

/// What cannot be combined (`compatibility.hpp`) looks at these.
[[nodiscard]] Features features_of(const Problem& problem);

}  // namespace knothe::assimilation
