#include "knothe/service/journal/step_matching.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/likelihood/data/time_matching.hpp"

namespace knothe::service {

void match_step(JournalEntry& entry, std::span<const double> model_times, const std::string& journal) {
  Measurement& datum = entry.measurement;
  const auto step = likelihood::matching_time(datum.time, model_times);
  if (!step)
    throw DataError(
        fmt::format("{}: record {} (source \"{}\", session \"{}\", seq {}) is of time {}, which the model "
                    "does not have: it was recorded with a model of other time steps. Put that model back, "
                    "or begin another journal ([serve] journal)",
                    journal, entry.id, datum.key.source, datum.key.session, datum.key.seq, datum.time));
  datum.step = *step;
}

}  // namespace knothe::service
