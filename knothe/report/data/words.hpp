#pragma once
/// @file What parameters, units and forecasts are called on a page.
#include <string>

#include "knothe/record/results.hpp"

namespace knothe::report {

/// How numbers in `units` are shown: metres in mm, newtons in kN.
struct UnitScale {
  std::string unit;  ///< empty: none
  double factor = 1.0;
};
[[nodiscard]] UnitScale unit_scale(const std::string& units);

/// How a forecast is shown: its name for people, unit, and the factor from the file's numbers to that unit.
struct ForecastScale {
  std::string title;  ///< "Crack length at 0.12 mm", or "at time 0.3"
  bool crack = false;
  std::string unit;
  double factor = 1.0;
};
[[nodiscard]] ForecastScale forecast_scale(const record::Results& results, const std::string& name);

/// Name of a parameter as it is written for people: "Y0" → "Y₀".
[[nodiscard]] std::string pretty_name(const std::string& name);
/// "N/m3" → "N/m³"; "1" → "".
[[nodiscard]] std::string pretty_units(const std::string& units);
/// A parameter and what its numbers mean: "Y₀ (1 = 216 J/m³)", "k1 (N/m)".
[[nodiscard]] std::string parameter_label(const record::ParameterSummary& parameter);

}  // namespace knothe::report
