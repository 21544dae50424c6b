#pragma once
/// @file JSON for other programs: numbers read back to the same double, and nothing non-finite ever leaves.
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace knothe::files {

/// One line of JSON, without the line end. Throws NumericalError naming the first member that is not finite
/// ("forecast.crack.mean"): JSON has no NaN, and a null would be taken for a missing value.
/// Bytes that are not UTF-8 become U+FFFD.
[[nodiscard]] std::string json_line(const nlohmann::ordered_json& value);

}  // namespace knothe::files
