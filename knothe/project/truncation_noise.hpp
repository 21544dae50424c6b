#pragma once
/// @file Measurement noise with a reduced model's own error added.
#include <Eigen/Core>
#include <span>

#include "knothe/assimilation/noise/noise_model.hpp"

namespace knothe::project {

/// Noise of covariance R_i + `added`[i] at each step i of the data (m²), R_i that of `noise`; R_i may be
/// correlated, but every dof must be measured.
[[nodiscard]] assimilation::NoiseModel with_truncation(const assimilation::NoiseModel& noise,
                                                       std::span<const Eigen::MatrixXd> added);

}  // namespace knothe::project
