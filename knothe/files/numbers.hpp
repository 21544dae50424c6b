#pragma once
/// @file Numbers as text that reads back to the same double.
#include <optional>
#include <string>
#include <string_view>

namespace knothe::files {

/// The shortest decimal text (at most 17 significant digits) that reads back to `value` exactly; "nan",
/// "inf", "-inf".
[[nodiscard]] std::string format_number(double value);

/// The whole of `text` (spaces around it aside) as a number, independent of the locale; "nan" in any case is
/// NaN. Nothing if it is not one.
[[nodiscard]] std::optional<double> parse_number(std::string_view text);

}  // namespace knothe::files
