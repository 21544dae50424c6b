#pragma once
/// @file The JSON in the page of an assimilation, from which its figures are drawn: the record that
/// `knothe assimilate` left, and what the figures need of its draws and of the model.
#include <nlohmann/json.hpp>

#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/record/results.hpp"

namespace knothe::report {

/// What posterior.nc says of measured values: `measured`, a list of {label, units, time, measured, mean, low,
/// high} (scalar series, then the sensor that moves most of each component), and `residuals`, {time, value},
/// measured minus predicted in standard deviations of the prediction with its noise. Where the file is not
/// there, of the series in summary.json; empty where nothing is.
[[nodiscard]] nlohmann::ordered_json predictions_record(const record::Results& results);

/// All of it. `model` may be null.
[[nodiscard]] nlohmann::ordered_json assimilation_record(const record::Results& results,
                                                         const model::SeparatedModel* model);

/// Rounds the numbers in `value` to so many significant digits, those of a list to so many of their range: a
/// page holds many.
void shorten_numbers(nlohmann::ordered_json& value, int digits);

}  // namespace knothe::report
