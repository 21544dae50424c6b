#pragma once
/// @file Sensors that have stopped reporting, or report the same for ever.
#include <Eigen/Core>
#include <vector>

#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/likelihood/step/collapsed_posterior.hpp"

namespace knothe::likelihood {

/// Absent: no value at five steps in a row. Stuck: the very same value at five steps in a row, while the
/// model (at the priors' medians) has moved there by more than three standard deviations of the noise.
class SensorWatch {
 public:
  explicit SensorWatch(const NoiseModel& noise);
  /// Looks at the next datum. `expected`: the model's prediction, n.
  void observe(const Eigen::Ref<const Eigen::VectorXd>& values,
               const Eigen::Ref<const Eigen::VectorXd>& expected);
  [[nodiscard]] const std::vector<Eigen::Index>& stuck() const { return stuck_; }
  [[nodiscard]] const std::vector<Eigen::Index>& absent() const { return absent_; }

 private:
  static constexpr int k_steps = 5;
  Eigen::VectorXd noise_std_, last_, expected_then_;
  Eigen::VectorXi same_, missing_;
  std::vector<Eigen::Index> stuck_, absent_;
};

}  // namespace knothe::likelihood
