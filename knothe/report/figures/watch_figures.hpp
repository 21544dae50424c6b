#pragma once
/// @file The figures that tell whether the model fits the data: evidence, alarm, residuals, and the
/// probability of other models.
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/record/results.hpp"
#include "knothe/report/figures/svg_figure.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {

/// Log-evidence increment of each step, and smoothed as the monitor does it.
[[nodiscard]] Plot evidence_plot(const record::Results& results);
/// The largest of the monitor's cumulative sums against their threshold; steps at which it rang.
[[nodiscard]] Plot alarm_plot(const record::Results& results);
/// Root mean square over the sensors of datum − posterior mean prediction, µm, and that of their noise;
/// `results.residuals` has them.
[[nodiscard]] Plot residual_plot(const record::Results& results);
/// The data of the last step against the posterior mean prediction, µm.
[[nodiscard]] Plot measured_plot(const record::Results& results);
/// A series as measured and as expected of the posterior that has it; and all of them, measured minus
/// predicted, in standard deviations of their noise.
[[nodiscard]] Plot series_plot(const std::string& name, const record::SeriesFit& fit);
[[nodiscard]] Plot series_residual_plot(const record::Results& results);
/// Size of the discrepancy that the joint correction infers, relative to the prior's spread.
[[nodiscard]] Plot discrepancy_plot(const record::Results& results);
/// The residuals of one component at the places of the sensors (x, y), averaged over the last steps, with the
/// outline of the model's outer face (null, or no mesh of hexahedra: without).
[[nodiscard]] Plot residual_map(const record::Results& results, char component,
                                const model::SeparatedModel* model = nullptr);
/// Posterior probability of each model.
[[nodiscard]] Plot model_probability_plot(const record::Results& results);

/// The section of the page that they make, with what happened in words.
void add_watch(Page& page, const record::Results& results, const model::SeparatedModel* model);

}  // namespace knothe::report
