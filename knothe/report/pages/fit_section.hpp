#pragma once
/// @file Of the report of an assimilation: does the model fit the data?
#include <nlohmann/json.hpp>
#include <string>

#include "knothe/record/results.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {

/// Residuals, evidence, the monitor and its alarms, other models. `record`: what the page's figures are drawn
/// from.
void add_fit(Page& page, const record::Results& results, const nlohmann::ordered_json& record);

/// What the measured signal `k` of the record is called, with its unit: "drift (mm)".
[[nodiscard]] std::string measured_title(const nlohmann::ordered_json& record, std::size_t k);

}  // namespace knothe::report
