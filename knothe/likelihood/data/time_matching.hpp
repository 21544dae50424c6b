#pragma once
/// @file Measured times and model times.
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace knothe::likelihood {

/// Measured times, of which those that agree within 1e-6 of the mean step (and of their size) are one: they
/// differ by the last digits of a clock. `times`: any order, perhaps several times each; the result
/// increases, each its most frequent one (of equally frequent ones the first).
[[nodiscard]] std::vector<double> distinct_times(std::vector<double> times);

/// The index of the model time that `time` is, to 1e-6 of a step; nothing where there is none.
[[nodiscard]] std::optional<std::size_t> matching_time(double time, std::span<const double> model);

/// For each measured time the index of the model time that it is, to 1e-6 of a step. Throws DataError naming
/// `path`, the index and the nearest model time where there is none.
[[nodiscard]] std::vector<std::size_t> match_times(std::span<const double> measured,
                                                   std::span<const double> model, const std::string& path);

}  // namespace knothe::likelihood
