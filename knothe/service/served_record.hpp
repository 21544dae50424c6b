#pragma once
/// @file A step's line as the service gives it.
#include <nlohmann/json.hpp>

#include "knothe/report/step_record.hpp"
#include "knothe/service/journal_posterior.hpp"

namespace knothe::service {

/// The line of `knothe assimilate` (interfaces.md, section 4) without what the monitor of the evidence says:
/// it judges each datum by those that came before it, and where data come out of order it is no function of
/// the journal.
[[nodiscard]] inline auto served_record(const JournalPosterior::Conclusion& conclusion) {
  auto record = report::step_record(conclusion.result, conclusion.forecasts, conclusion.forecast_us);
  record.erase("monitor");
  record.erase("notice");
  return record;
}

}  // namespace knothe::service
