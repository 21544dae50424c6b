#pragma once
/// @file A datum: what all sensors said at one time.
#include <Eigen/Core>
#include <compare>
#include <cstdint>
#include <optional>
#include <string>

#include "knothe/likelihood/noise/gaussian_noise.hpp"

namespace knothe::likelihood {

/// Who a datum is. Data of one step are summed in this order: by source, then session, then seq.
struct DatumKey {
  std::string source, session;
  std::int64_t seq = 0;
  auto operator<=>(const DatumKey&) const = default;
};

/// One vector of values of all sensors, with the noise that it was measured with.
struct Datum {
  DatumKey key;
  std::size_t step = 0;        ///< place in the order of assimilation
  std::size_t time_index = 0;  ///< model time, an index of the observed model's
  Eigen::VectorXd values;      ///< n, in the units of the sensors; NaN where missing
  /// Its own (a picture with rejected elements); absent: that of the sensors.
  std::optional<GaussianNoise> noise;
};

}  // namespace knothe::likelihood
