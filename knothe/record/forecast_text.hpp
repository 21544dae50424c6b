#pragma once
/// @file Numbers as the console says them.
#include <optional>
#include <string>
#include <utility>

#include "knothe/assimilation/decide/decision.hpp"
#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/assimilation/verdict/verdict.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/reduced/loading.hpp"

namespace knothe::record {

/// As many digits as a verdict leaves: ± has the reduced model's own error, and what is rejected has two
/// digits and no ±.
class Precision {
 public:
  Precision() = default;
  explicit Precision(const assimilation::Verdict& verdict);

  /// A posterior's standard deviation with the model's error: a forecast's as the worst parameter's.
  [[nodiscard]] double of_parameter(double std, Index parameter) const;
  [[nodiscard]] double of_forecast(double std) const;

  [[nodiscard]] std::string estimate(double mean, double std) const;  ///< "1.04 ± 0.041"; "1.0"
  [[nodiscard]] std::string number(double value, double std) const;   ///< "1.040"; "1.0"
  [[nodiscard]] bool is_rejected() const { return is_rejected_; }

 private:
  bool is_rejected_ = false;
  Eigen::VectorXd shift_;  ///< of each parameter by the model's error, standard deviations
};

/// Factor and unit, as it stands behind a number (" mm"), for a quantity of this size; "" of a pure number.
[[nodiscard]] std::pair<double, std::string> readable_unit(double size, const std::string& units);

/// "−0.4012 ± 0.0012 mm": the standard deviation with two significant digits, the mean to the same decimal;
/// metres as mm, or µm where both are below 10 µm; "200.2 ± 1.7 GPa".
[[nodiscard]] std::string value_text(double mean, double std, const std::string& units,
                                     const Precision& precision = {});

/// A value that was given: "40 mm", "1 kN".
[[nodiscard]] std::string given_text(double value, const std::string& units);

/// "12.3 %", "< 0.1 %", "> 99.9 %": of samples, none of them above does not mean never.
[[nodiscard]] std::string probability_text(double probability);

/// "0.12 mm", of what is imposed, where that is known and rises; else "time 0.3", with its unit where there
/// is one.
[[nodiscard]] std::string horizon_text(double horizon, const model::Loading& loading);

/// A forecast with its horizon, its 95 % interval, and the probabilities on either side of its threshold; of
/// what is rejected the value alone.
[[nodiscard]] std::string forecast_text(const assimilation::NamedForecast& forecast,
                                        const model::Loading& loading, const Precision& precision = {});

/// "load to 0.124 mm", "hold", "stop".
[[nodiscard]] std::string action_text(const assimilation::Decision& decision);

}  // namespace knothe::record
