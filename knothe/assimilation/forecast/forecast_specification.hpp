#pragma once
/// @file What is to be forecast.
#include <array>
#include <optional>
#include <string>

#include "knothe/assimilation/forecast/length_curve.hpp"
#include "knothe/base/enum_names.hpp"

namespace knothe::assimilation {

/// What is to be forecast: a table [forecast.NAME] of a project file.
struct ForecastSpecification {
  enum class Quantity { crack_length, displacement, output };
  std::string name;
  Quantity quantity = Quantity::crack_length;
  double horizon = 0;                           ///< model time
  std::optional<double> threshold;              ///< in the unit of the quantity; absent: the prior mean, or 0
  double prior_mean = 0.04, prior_std = 0.013;  ///< crack length, m
  std::optional<double> discrepancy_std;        ///< m, of Eq. 33; absent: estimated with the length
  /// m; length of the crack of interest minus that of the elastic one whose sensor displacements match
  /// (docs/explanation/forecast.md). The prior is that of the elastic one.
  double length_offset = 0;
  LengthCurve::Points length_curve;  ///< before the offset: what depends on the length
  /// Standard deviation of what the model leaves out at the horizon (of a crack length: of what its offset
  /// varies by), in the unit of the quantity; independent of the data.
  double model_error_std = 0;
  std::array<double, 3> point{};  ///< displacement, m
  int component = 0;              ///< displacement
  std::string output;             ///< name of a model's output
};

constexpr auto names_of(ForecastSpecification::Quantity /*quantity*/) {
  using Quantity = ForecastSpecification::Quantity;
  return std::to_array<Named<Quantity>>({{Quantity::crack_length, "crack_length"},
                                         {Quantity::displacement, "displacement"},
                                         {Quantity::output, "output"}});
}

}  // namespace knothe::assimilation
