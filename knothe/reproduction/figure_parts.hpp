#pragma once
/// @file What several figures of the study have in common.
#include <string>
#include <vector>

#include "knothe/report/figures/svg_figure.hpp"
#include "knothe/report/figures/svg_text.hpp"
#include "knothe/reproduction/picture_selection.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {

using Eigen::Index;
using report::Figure;
using report::Paint;
using report::Plot;
using report::readable;
using report::with_uncertainty;

/// Numbers of the steps of a run.
[[nodiscard]] std::vector<double> step_numbers(const Run& run);
/// Standard deviation of parameter k after each step.
[[nodiscard]] std::vector<double> stds(const Run& run, Eigen::Index k);
[[nodiscard]] std::vector<double> means(const Run& run, Eigen::Index k);
/// "30 to 40", "none" or, for one, "32".
[[nodiscard]] std::string range_of(const std::vector<std::size_t>& steps);
/// Successive marginals of both parameters, side by side; `subtitle` is added to their titles.
[[nodiscard]] report::Figure marginals_figure(const Run& run, const Eigen::VectorXd& truth,
                                              const std::string& subtitle, std::size_t stride = 2);
/// The outer face as grey elements, with these points on it.
[[nodiscard]] report::Figure sensors_figure(const reduction::SeparatedModel& model, const Sensors& sensors,
                                            const std::string& title);
/// A field on the nodes of a surface seen by a camera, chosen dofs marked (numbers of dofs; may be empty).
[[nodiscard]] report::Figure surface_figure(const Surface& surface, const std::string& title,
                                            const std::vector<double>& value, const std::string& unit,
                                            const std::vector<Eigen::Index>& chosen);
/// The crack length at a model time, with the prior that the paper has for Eq. 33.
[[nodiscard]] forecast::ForecastSpecification crack_length(const std::string& name, double horizon);
/// The subject's data, assimilated by composed maps as in the paper, with these forecasts at each step.
[[nodiscard]] Run forecast_run(const Subject& subject,
                               const std::vector<forecast::ForecastSpecification>& forecasts,
                               std::uint64_t seed, const std::string& label);

}  // namespace knothe::reproduction
