#pragma once
/// @file A step's line as the service gives it.
#include <nlohmann/json.hpp>

#include "knothe/report/results/step_record.hpp"
#include "knothe/service/site/journal_posterior.hpp"

namespace knothe::service {

/// The line of `knothe assimilate` (docs/formats.md). Where the monitor of the evidence has not
/// followed yet, without what it says.
[[nodiscard]] inline auto served_record(const JournalPosterior::Conclusion& conclusion) {
  auto record = report::step_record(conclusion.result, conclusion.forecasts, conclusion.forecast_us);
  if (!conclusion.followed) record.erase("monitor");
  return record;
}

}  // namespace knothe::service
