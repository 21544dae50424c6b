#pragma once
/// @file Model time from a measured quantity: the displacement that the machine imposes, say.
#include <span>
#include <string>
#include <vector>

#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::likelihood {

/// Where each datum is on the model's axis of time.
struct ClockReading {
  std::vector<double> time;  ///< n, model time, inside that of the model
  std::vector<double> std;   ///< n, standard deviation of its error, ≥ 0
  std::vector<double> rate;  ///< n, model time per unit of the reading, negative where that falls
};

/// Model time of each value of `measured`, the quantity that the model knows as output `name`: piecewise
/// linear between the model's times, and the error of a reading carried through the slope. The output must be
/// the same for all parameters, and go one way only. A reading may lie outside the model's range, or behind
/// an earlier one, by no more than four standard deviations: beyond, the structure was unloaded or the model
/// ends there, which it does not describe. `where`: what messages call the data. Errors: DataError.
[[nodiscard]] ClockReading read_clock(const model::SeparatedModel& model, const std::string& name,
                                      const MeasuredSeries& measured, const std::string& where);

/// E[∂y/∂t] over the priors at the times of `rates`, n × n_t.
[[nodiscard]] Eigen::MatrixXd mean_rates(const model::ObservedModel& rates,
                                         const posterior::PriorTransform& transform);

/// `noise` with the error of the clock in each step: a reading that is off by δ moves all predictions by
/// δ ∂y/∂t. Its covariance is that over the clock's error and the priors, σ² E[(∂y/∂t)(∂y/∂t)ᵀ]: the mean
/// rate and the leading directions (at most 3) of the rate's spread. `rates`: ∂y/∂t at the times of the data.
[[nodiscard]] NoiseModel with_clock_error(const NoiseModel& noise, const model::ObservedModel& rates,
                                          const posterior::PriorTransform& transform,
                                          std::span<const double> std);

}  // namespace knothe::likelihood
