#pragma once
/// @file Data that are wrong, or of another structure than the model's, or assimilated with a model or a
/// noise that is wrong.
#include <functional>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "tests/verdicts/beam_bench.hpp"

namespace knothe::verdicts {

/// What is assimilated.
struct Case {
  const Reduced* model = nullptr;
  bool force = false;                     ///< the reaction force is among the data
  Eigen::MatrixXd values;                 ///< sensors × data; NaN: missing
  std::vector<std::size_t> time_indices;  ///< of the data
  double noise = k_noise;                 ///< as stated
  const Structure* structure = nullptr;   ///< that made the data, where it is not the model's
  std::vector<posterior::Prior> priors;   ///< in place of those of all others
  double degrees_of_freedom = 0;          ///< of a Student-t likelihood
};

struct Situation {
  std::string name;
  std::optional<assimilation::MisfitCause> cause;  ///< that should be named
  std::function<Case(BeamBench&, const Eigen::Vector2d& truth, std::mt19937_64&)> make;
};

/// Nothing is wrong.
[[nodiscard]] Case right_case(BeamBench& bench, const Eigen::Vector2d& truth, std::mt19937_64& random);
[[nodiscard]] std::vector<Situation> wrong_situations();

/// One of the two parameters far outside the model's box.
[[nodiscard]] Eigen::Vector2d outside_the_box(const Eigen::Vector2d& truth);
/// A truth drawn from the prior.
[[nodiscard]] Eigen::Vector2d draw_truth(std::mt19937_64& random);
[[nodiscard]] std::vector<posterior::Prior> priors();
/// The structure that is modelled.
[[nodiscard]] const Structure& modelled();

}  // namespace knothe::verdicts
