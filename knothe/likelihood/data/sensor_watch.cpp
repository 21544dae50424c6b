#include "knothe/likelihood/data/sensor_watch.hpp"

#include <cmath>
#include <limits>

namespace knothe::likelihood {

SensorWatch::SensorWatch(const NoiseModel& noise)
    : noise_std_(noise.measurement().standard_deviations()),
      last_(Eigen::VectorXd::Constant(noise.size(), std::numeric_limits<double>::quiet_NaN())),
      expected_then_(Eigen::VectorXd::Zero(noise.size())),
      same_(Eigen::VectorXi::Zero(noise.size())),
      missing_(Eigen::VectorXi::Zero(noise.size())) {}

void SensorWatch::observe(const Eigen::Ref<const Eigen::VectorXd>& values,
                          const Eigen::Ref<const Eigen::VectorXd>& expected) {
  stuck_.clear();
  absent_.clear();
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (std::isnan(values[i])) {
      if (++missing_[i] >= k_steps) absent_.push_back(i);
      continue;
    }
    missing_[i] = 0;
    if (values[i] == last_[i]) {
      ++same_[i];
    } else {
      same_[i] = 1;
      last_[i] = values[i];
      expected_then_[i] = expected[i];
    }
    if (same_[i] >= k_steps && std::abs(expected[i] - expected_then_[i]) > 3 * noise_std_[i])
      stuck_.push_back(i);
  }
}

}  // namespace knothe::likelihood
