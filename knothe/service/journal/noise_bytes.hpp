#pragma once
/// @file The noise of a single measurement as the journal keeps it.
#include <string>
#include <string_view>

#include "knothe/likelihood/noise/gaussian_noise.hpp"

namespace knothe::service {

/// R⁻¹ of correlated noise as compressed sparse columns (docs/reference/service.md), deflated: the same noise
/// again, to the bit. Not what steps share: that is the sensors'.
[[nodiscard]] std::string noise_bytes(const likelihood::GaussianNoise& noise);

/// Back again. DataError if the bytes are none that `noise_bytes` made.
[[nodiscard]] likelihood::GaussianNoise noise_of_bytes(std::string_view bytes);

}  // namespace knothe::service
