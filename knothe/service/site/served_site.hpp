#pragma once
/// @file A site as it is served: the test that runs, and how another takes its place without a restart.
///
/// A test is a `Site`: journal, engine, lines, alarms, logbook. Nothing of it is reset; another `Site` is
/// made beside it and takes its place. So whoever is asked something about a site asks here for the test that
/// runs now, and holds it for as long as the answer takes.
#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "knothe/service/site/alarm_sender.hpp"
#include "knothe/service/site/site.hpp"

namespace knothe::service {

/// Thread-safe.
class ServedSite {
 public:
  /// What brings data of a test by itself (watched folders, a camera), each with a thread of its own that
  /// ends when it is destroyed.
  using Watches = std::vector<std::shared_ptr<void>>;
  struct Settings {
    std::string test;  ///< asked for at the start; the last test that has followed it is served
    bool strict_deadline = false;
    std::function<void()> changed = [] {};
    std::function<Watches(const std::shared_ptr<Site>&)> watch = [](const auto&) { return Watches(); };
  };

  /// Errors of `Site`. Nothing runs before `start`.
  ServedSite(project::Project project, Settings settings, Metrics& metrics);
  ~ServedSite();

  void start();
  void stop();

  /// The test that runs.
  [[nodiscard]] std::shared_ptr<Site> current() const;
  [[nodiscard]] const std::string& name() const { return project_.serve.site; }
  /// As in its file: of the unnamed test.
  [[nodiscard]] const project::Project& project() const { return project_; }

  /// Begins the test `asked.test` with a journal of its own: the one that runs is finished, and stays as it
  /// is. The one sealed entry in its journal that says so is the change: a process that dies before it serves
  /// the old test again, after it the new one. The new one's first entry. RequestError: nothing has changed.
  LogbookEntry begin_test(const EntryRequest& asked);
  /// Goes back to an earlier test, in the same way.
  LogbookEntry resume_test(const EntryRequest& asked);

 private:
  [[nodiscard]] std::shared_ptr<Site> open(const std::string& test, std::int64_t min_start);
  [[nodiscard]] std::shared_ptr<Site> open_ready(const std::string& test, std::int64_t min_start);
  LogbookEntry change_to(const std::string& test, LogbookEntry first);
  void await_departure(const std::string& test);

  project::Project project_;
  Settings settings_;
  Metrics& metrics_;
  AlarmSender sender_;  ///< outlives the tests: what waits to be sent is sent
  std::atomic<bool> stopping_{false};
  std::mutex changing_;  ///< one change at a time; everything below but `current_` is under it
  std::map<std::string, std::weak_ptr<Site>> left_;  ///< tests that ran before: readers may still hold them
  Watches watches_;
  mutable std::mutex mutex_;
  std::shared_ptr<Site> current_;  ///< under mutex_
};

}  // namespace knothe::service
