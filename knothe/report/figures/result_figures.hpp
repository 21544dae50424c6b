#pragma once
/// @file The figures of an assimilation, each from what the results folder holds.
#include <string>
#include <vector>

#include "knothe/record/results.hpp"
#include "knothe/report/figures/svg_figure.hpp"

namespace knothe::report {

/// Successive posterior marginals of parameter `d`, coloured by step, with prior and truth (the paper's Fig.
/// 9).
[[nodiscard]] Plot marginals_plot(const record::Results& results, std::size_t d);
/// Posterior mean and 95 % band of parameter `d` over the steps.
[[nodiscard]] Plot convergence_plot(const record::Results& results, std::size_t d);
/// Draws of the last posterior, parameter `row` against parameter `column`.
[[nodiscard]] Plot pair_plot(const record::Results& results, std::size_t row, std::size_t column);
/// The vertical axis of successive densities with these peaks: logarithmic from a hundredth of the lowest
/// peak upwards where the highest is more than twenty times that, else early steps would vanish next to late
/// ones.
[[nodiscard]] PlotAxis density_axis(const std::string& unit, const std::vector<double>& peaks);
/// A density as a line on that axis: where it is logarithmic, lines leave it at its lower end.
[[nodiscard]] std::vector<double> density_values(const std::vector<double>& values, const PlotAxis& axis);

/// Order of the map as bars, time of an update as a line (Fig. 9, right).
[[nodiscard]] Plot cost_plot(const record::Results& results);
/// Load against displacement, with the steps where each parameter's standard deviation falls most.
[[nodiscard]] Plot load_plot(const record::Results& results);
/// Information gained per step: fall of the differential entropy of the Gaussian with the posterior's
/// covariance, in nats.
[[nodiscard]] Plot information_plot(const record::Results& results);
[[nodiscard]] Plot variance_diagnostic_plot(const record::Results& results);
[[nodiscard]] Plot sample_size_plot(const record::Results& results);

/// How numbers in `units` are shown: metres in mm, newtons in kN.
struct UnitScale {
  std::string unit;  ///< empty: none
  double factor = 1.0;
};
[[nodiscard]] UnitScale unit_scale(const std::string& units);

/// How a forecast is shown: its name for people, unit, and the factor from the file's numbers to that unit.
struct ForecastScale {
  std::string title;     ///< "Crack length at time 0.3"
  std::string quantity;  ///< "Crack length"
  bool crack = false;    ///< it is a crack length
  std::string unit;
  double factor = 1.0;
  [[nodiscard]] std::string label() const { return unit.empty() ? quantity : quantity + " (" + unit + ")"; }
};
[[nodiscard]] ForecastScale forecast_scale(const record::Results& results, const std::string& name);
/// Successive densities of forecast `name` (Fig. 13), and its mean and 95 % band over the steps.
[[nodiscard]] Plot forecast_densities_plot(const record::Results& results, const std::string& name);
[[nodiscard]] Plot forecast_convergence_plot(const record::Results& results, const std::string& name);

/// Indices (into results.steps) of the `count` steps where the standard deviation of parameter `d` falls
/// most, by ratio.
[[nodiscard]] std::vector<std::size_t> learning_steps(const record::Results& results, std::size_t d,
                                                      std::size_t count = 5);

/// Name of a parameter as it is written in figures: "Y0" → "Y₀".
[[nodiscard]] std::string pretty_name(const std::string& name);
/// "N/m3" → "N/m³"; "1" → "".
[[nodiscard]] std::string pretty_units(const std::string& units);
/// What the axis of a parameter is called: "Y₀ (1 = 216 J/m³)", "k1 (N/m)".
[[nodiscard]] std::string axis_label(const record::ParameterSummary& parameter);

}  // namespace knothe::report
