#pragma once
/// @file Checks of options that are numbers. What is said of others: "must be a positive number, not -1".
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>

namespace knothe {

inline CLI::Validator number_check(const char* name, const char* wanted, bool (*fits)(double)) {
  const auto check = [wanted, fits](const std::string& text) {
    double value = 0;
    return CLI::detail::lexical_cast(text, value) && fits(value)
               ? std::string()
               : fmt::format("must be a {} number, not {}", wanted, text);
  };
  return {check, name};
}

inline CLI::Validator positive_number() {
  return number_check("POSITIVE", "positive", [](double x) { return x > 0; });
}
inline CLI::Validator number_from_zero() {
  return number_check("NONNEGATIVE", "non-negative", [](double x) { return x >= 0; });
}

}  // namespace knothe
