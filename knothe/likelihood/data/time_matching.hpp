#pragma once
/// @file Measured times and model times.
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace knothe::likelihood {

/// The index of the model time that `time` is, to 1e-6 of a step; nothing where there is none.
[[nodiscard]] std::optional<std::size_t> matching_time(double time, std::span<const double> model);

/// For each measured time the index of the model time that it is, to 1e-6 of a step. Throws DataError naming
/// `path`, the index and the nearest model time where there is none.
[[nodiscard]] std::vector<std::size_t> match_times(std::span<const double> measured,
                                                   std::span<const double> model, const std::string& path);

}  // namespace knothe::likelihood
