#include "knothe/service/site/test_lines.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/record/step_record.hpp"
#include "knothe/service/journal/replay.hpp"
#include "knothe/service/journal/test_journals.hpp"

namespace knothe::service {
namespace {

/// What the lines of a journal depend on.
std::string fingerprint(const JournalReader& journal, const Identity& identity) {
  const auto last = [](const auto& entries) { return entries.empty() ? 0 : entries.back().number; };
  return fmt::format("{} {} {} {} {}", journal.seal(), journal.withdrawals(), journal.quarantined().size(),
                     last(journal.logbook()), identity.model + identity.configuration);
}

}  // namespace

std::string TestLines::lines_of(const ServedSite& served, const std::string& test, std::size_t from) {
  const std::string path = journal_of_test(served.project().serve.journal, test);
  const bool is_name = test.empty() || objection_to_test_name(test).empty();
  if (!is_name || !std::filesystem::exists(path))
    throw RequestError(404, "UnknownTest",
                       fmt::format("there is no test \"{}\"; GET /v1/tests lists them", test));
  const auto site = served.current();
  const std::pair key(served.name(), test);
  if (kept_.size() >= k_max_tests && !kept_.contains(key))
    kept_.clear();  // what is asked for again is made again
  Kept& kept = kept_[key];
  try {
    const JournalReader journal(path);
    const auto identity = journal.identity();
    if (identity && identity->sensors != site->identity().sensors)
      throw DataError("its data are of other sensors than those of the test that runs");
    if (const std::string now = fingerprint(journal, site->identity()); kept.of != now) {
      kept = {};
      for_each_result(journal, site->project(), site->setup(), [&](const assimilation::StepResult& result) {
        if (stopping_) throw RequestError(503, "NotReady", "the service is stopping");
        Json line = record::step_record(result, site->setup().model.contents().axes);
        line.erase("marginals");
        for (auto& forecast : line["forecast"]) forecast.erase("density");
        kept.lines.emplace_back(result.update.step, files::json_line(line));
      });
      kept.of = now;
    }
  } catch (const DataError& error) {
    kept_.erase(key);
    throw RequestError(409, "NotComparable",
                       fmt::format("the test \"{}\" cannot be shown: {}", test, error.what()));
  }
  std::string body = "[";
  for (const auto& [step, line] : kept.lines) {
    if (step < from) continue;
    if (body.size() > 1) body += ",\n";
    body += line;
  }
  return body + "]";
}

}  // namespace knothe::service
