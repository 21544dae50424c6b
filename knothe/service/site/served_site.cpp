#include "knothe/service/site/served_site.hpp"

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <thread>

#include "knothe/base/error.hpp"
#include "knothe/service/journal/sqlite.hpp"
#include "knothe/service/journal/test_journals.hpp"
#include "knothe/service/site/folder_watch.hpp"

namespace knothe::service {
namespace {

constexpr std::chrono::milliseconds k_glance{2};
constexpr std::chrono::seconds k_longest_departure{2};

bool is_followed(const Site& site) {
  const auto end = site.logbook().finished();
  return end && end->kind == EntryKind::test_followed;
}

/// A program that died while it made a journal may have left what only a writer can put in order.
JournalGlance glance_repaired(const std::string& path) {
  try {
    return glance_at_journal(path);
  } catch (const Error&) {
    (void)Journal(path);
    return glance_at_journal(path);
  }
}

/// RequestError where something is in the way of a new test of this name.
void require_unused(const std::string& journal, const std::string& test) {
  const std::string path = journal_of_test(journal, test);
  if (!std::filesystem::exists(path)) return;
  const std::string file = std::filesystem::path(path).filename().string();
  JournalGlance glance;
  try {
    glance = glance_repaired(path);
  } catch (const Error&) {
    throw RequestError(409, "TestExists",
                       fmt::format("{} is there, and cannot be read: choose another name", file));
  }
  // What a begin that was cut short has left is begun again.
  if (glance.is_used)
    throw RequestError(409, "TestExists",
                       fmt::format("{} is there already, with {} records ({}): choose another name, or go on "
                                   "with it (POST /v1/tests/resume)",
                                   test_in_words(test), glance.records, file));
}

}  // namespace

ServedSite::ServedSite(project::Project project, Settings settings, Metrics& metrics)
    : project_(std::move(project)),
      settings_(std::move(settings)),
      metrics_(metrics),
      sender_(project_, metrics_),
      current_(open(last_to_follow(project_.serve.journal, settings_.test), 0)) {
  if (current_->test() != settings_.test)
    log_event("info", "a test is served that has followed the one asked for",
              {{"site", name()}, {"test", current_->test()}, {"asked", settings_.test}});
}

ServedSite::~ServedSite() {
  stop();
}

std::shared_ptr<Site> ServedSite::open(const std::string& test, std::int64_t min_start) {
  return std::make_shared<Site>(
      project_,
      SiteSettings{test, settings_.strict_deadline, min_start, settings_.changed,
                   [this, test](const Alarm& alarm) { sender_.enqueue(alarm, test); }},
      metrics_);
}

void ServedSite::start() {
  const std::lock_guard lock(changing_);
  current()->start();
  watches_ = settings_.watch(current());
}

void ServedSite::stop() {
  stopping_ = true;
  const std::lock_guard lock(changing_);
  watches_.clear();
  current()->stop();
}

std::shared_ptr<Site> ServedSite::current() const {
  const std::lock_guard lock(mutex_);
  return current_;
}

// --- Another test ----------------------------------------------------------------------------------------

LogbookEntry ServedSite::begin_test(const EntryRequest& asked) {
  const std::string test = asked.test.value_or("");
  if (const std::string objection = objection_to_test_name(test); !objection.empty())
    throw RequestError(400, "Malformed", fmt::format("\"name\": {}", objection));
  const std::lock_guard lock(changing_);
  if (test == current()->test())
    throw RequestError(409, "TestExists", fmt::format("{} is the one that runs", test_in_words(test)));
  require_unused(project_.serve.journal, test);
  return change_to(test, {0, EntryKind::test_begun, 0, current()->setup().problem.model->time.front(),
                          asked.author, asked.text, 0});
}

LogbookEntry ServedSite::resume_test(const EntryRequest& asked) {
  const std::string test = asked.test.value_or("");
  const std::lock_guard lock(changing_);
  const bool is_name = test.empty() || objection_to_test_name(test).empty();
  if (!is_name || !std::filesystem::exists(journal_of_test(project_.serve.journal, test)))
    throw RequestError(404, "UnknownTest",
                       fmt::format("there is no test \"{}\"; GET /v1/tests lists them", test));
  if (test == current()->test())
    return current()->journal().enter(current()->entry(EntryKind::test_resumed, asked));
  return change_to(test, {0, EntryKind::test_resumed, 0, current()->setup().problem.model->time.front(),
                          asked.author, asked.text, 0});
}

/// The journal of a test has one writer: the one that was left just now must be gone.
void ServedSite::await_departure(const std::string& test) {
  const auto end = std::chrono::steady_clock::now() + k_longest_departure;
  while (!left_[test].expired() && !stopping_) {
    if (std::chrono::steady_clock::now() > end)
      throw RequestError(503, "NotReady", "the test is still being read by those who saw it run: ask again");
    std::this_thread::sleep_for(k_glance);
  }
}

/// A test whose journal is replayed and takes entries. RequestError that says why there is none.
std::shared_ptr<Site> ServedSite::open_ready(const std::string& test, std::int64_t min_start) {
  try {
    auto site = open(test, min_start);
    site->start();
    while (!site->journal().ready() && !stopping_) std::this_thread::sleep_for(k_glance);
    return site;
  } catch (const DiskFullError& error) {
    throw RequestError(507, "DiskFull", fmt::format("the test cannot be begun: {}", error.what()));
  } catch (const Error& error) {
    throw RequestError(409, "NotBegun",
                       fmt::format("the test cannot be begun, and the one before goes on: {}", error.what()));
  }
}

namespace {

/// What is in the watched folders when a test begins, or is gone back to, is not of its specimen. What no
/// test has taken is said.
void note_files_there(Site& next, Site& before) {
  std::string first;
  std::size_t count = 0;
  const FileRegister& known = before.journal().files();
  for (const JournalFile& file : files_there(next.project(), known)) {
    if (next.journal().files().settled(file)) continue;
    next.journal().files().note(file);
    if (!known.digest_of(file.source, file.name).empty()) continue;
    if (count++ == 0) first = file.name;
  }
  if (count == 0) return;
  next.alarms().raise(
      0, "warning", "sensors",
      fmt::format("{} files came before this test and no test has taken them, first {}: they are left "
                  "alone; what is of this test can be sent (POST /v1/measurements)",
                  count, first));
}

}  // namespace

/// The one that runs goes on while the other is opened, and until it is followed. What its senders bring in
/// the moment between that and the change is refused as not ready (503): it comes again, to the new one.
LogbookEntry ServedSite::change_to(const std::string& test, LogbookEntry first) {
  const auto before = current();
  await_departure(test);
  if (stopping_ || !before->journal().ready())
    throw RequestError(503, "NotReady",
                       stopping_ ? "the service is stopping" : "the journal is being replayed");
  const auto next = open_ready(test, before->starts() + 1);
  const std::string author = first.author;
  watches_.clear();
  LogbookEntry written;
  try {
    note_files_there(*next, *before);  // on disk with the entry
    written = next->journal().enter(std::move(first));
  } catch (const std::exception&) {
    watches_ = settings_.watch(before);
    throw;
  }
  const auto follow = [&](Site& left, const std::string& by) {
    const auto latest = left.lines().latest();
    left.journal().enter(
        {0, EntryKind::test_followed, 0, latest ? latest->time : written.time, author, by, 0});
  };
  try {
    follow(*before, test);
  } catch (const RequestError&) {
    // A journal that was moved just then has the entry all the same: the change is made.
    if (!is_followed(*before)) {
      watches_ = settings_.watch(before);
      if (written.kind == EntryKind::test_resumed) follow(*next, before->test());
      throw;
    }
  }
  {
    const std::lock_guard lock(mutex_);
    current_ = next;
  }
  watches_ = settings_.watch(next);
  left_[before->test()] = before;
  before->stop();
  if (!next->lines().latest()) next->forget_gauges();
  settings_.changed();
  log_event("info", "another test is served",
            {{"site", name()}, {"test", test}, {"before", before->test()}, {"by", author}});
  return written;
}

}  // namespace knothe::service
