#pragma once
/// @file One structure: its journal, its posterior, and what is said of it. Two threads of its own: one
/// commits, one updates, so neither a slow disk nor a hard posterior holds up the other, or another site.
#include <nlohmann/json.hpp>
#include <set>

#include "knothe/project/project_engine.hpp"
#include "knothe/service/site/journal_writer.hpp"
#include "knothe/service/site/line_store.hpp"
#include "knothe/service/site/received_times.hpp"
#include "knothe/service/site/site_alarms.hpp"
#include "knothe/service/site/site_facts.hpp"
#include "knothe/service/site/site_health.hpp"
#include "knothe/service/site/site_logbook.hpp"
#include "knothe/service/site/verifier.hpp"
#include "knothe/service/site/watched_pictures.hpp"

namespace knothe::service {

/// What a site is told beside its project.
struct SiteSettings {
  std::string test = {};  ///< name; empty: the unnamed one
  bool strict_deadline = false;
  std::int64_t min_start = 0;             ///< its starts are counted from here at least, and events by them
  std::function<void()> changed = [] {};  ///< from any thread: there is something to send
  std::function<void(const Alarm&)> send = [](const Alarm&) {};  ///< takes an alarm on its way out
};

/// Thread-safe.
class Site : public SiteFacts {
 public:
  /// Opens the test's journal. Errors as of `SiteFacts` and `Journal`. Nothing runs before `start`.
  Site(project::Project project, SiteSettings settings, Metrics& metrics);
  ~Site();

  void start();
  /// Commits what was taken, finishes the step at hand, ends the threads.
  void stop();

  /// Whether every measurement in the journal is in the lines.
  [[nodiscard]] bool settled() const;
  [[nodiscard]] Json status() const;
  /// Looks at the clock: ages, states, gauges. True if the state has changed since.
  bool tick();
  /// Forgets the gauges of its latest line, which another test of this name does not have yet.
  void forget_gauges();

  [[nodiscard]] JournalWriter& journal() { return journal_; }
  [[nodiscard]] const JournalWriter& journal() const { return journal_; }
  [[nodiscard]] const LineStore& lines() const { return lines_; }
  [[nodiscard]] SiteAlarms& alarms() { return alarms_; }
  [[nodiscard]] const SiteHealth& health() const { return health_; }
  [[nodiscard]] const SiteLogbook& logbook() const { return logbook_; }
  [[nodiscard]] WatchedPictures& pictures() { return pictures_; }

  /// RequestError 409 where a datum names another test than this one: it is of another specimen.
  void require_test(const std::optional<std::string>& test) const;
  /// The entry for the logbook that is asked for; `JournalWriter::enter` writes it. `alarm` is acknowledged.
  /// RequestError 400, 404 or 409 that says what is wrong.
  [[nodiscard]] LogbookEntry entry(EntryKind kind, const EntryRequest& request, std::int64_t alarm = 0) const;

  [[nodiscard]] std::int64_t starts() const { return starts_; }  ///< of its journal, this one included
  /// The model that is used now.
  [[nodiscard]] std::shared_ptr<const ServedModel> model() const;
  /// Truncated to the model's box, and their medians.
  [[nodiscard]] const std::vector<posterior::Prior>& priors() const { return priors_; }
  [[nodiscard]] const Eigen::VectorXd& centre() const { return centre_; }
  /// `Engine::form_up_to`, with the model that it is of.
  struct Form {
    std::shared_ptr<const ServedModel> model;
    std::optional<likelihood::StepForm> form;
  };
  [[nodiscard]] Form form_up_to(std::size_t step);

 private:
  void arrive(std::vector<Arrival> arrivals, std::int64_t records, bool all_replayed);
  void doubt(const Measurement& measurement, const std::string& reason);
  void note_down(const LogbookEntry& entry);
  void update_loop();
  void apply_arrivals(const std::vector<Arrival>& arrivals);
  void add(const Measurement& measurement, bool is_live);
  void withdraw(const Measurement& measurement);
  bool remove(const Measurement& measurement);
  [[nodiscard]] double time_of(std::optional<std::int64_t> step) const;
  void retract(std::size_t step);
  void publish_step(std::size_t step, bool preview);
  void conclude_next();
  void publish(std::shared_ptr<Line> line, bool judged);
  [[nodiscard]] std::shared_ptr<Line> line_of(const assimilation::StepResult& result,
                                              std::shared_ptr<const ServedModel> model);
  void observe_phases(const assimilation::StepResult& result);
  void check_delays();
  void restore_model();
  void ask_full_order_model();
  void adopt_verification();
  [[nodiscard]] bool has_verification_to_do() const;
  [[nodiscard]] bool store_verification(const Verification& verification);
  [[nodiscard]] SiteHealth::State state_of_now(const JournalWriter::Tally& tally) const;  ///< mutex_ held
  [[nodiscard]] std::string labels(const std::string& more = "") const { return site_labels(name(), more); }

  SiteSettings settings_;
  Metrics& metrics_;
  JournalWriter journal_;
  std::shared_ptr<const ServedModel> model_;      ///< changed by the updating thread, under engine_mutex_
  std::unique_ptr<assimilation::Engine> engine_;  ///< the same; of `model_`
  mutable std::mutex engine_mutex_;
  std::vector<posterior::Prior> priors_;
  Eigen::VectorXd centre_;
  ReceivedTimes received_;  ///< updating thread
  std::map<std::size_t, double>
      adding_us_;                 ///< updating thread; what the data of a step have cost since its line
  std::size_t judged_from_ = 0;   ///< the same; alarms of the steps before it were raised before the restart
  bool previewed_ = false;        ///< updating thread; the last update was a preview
  bool newest_is_shown_ = false;  ///< the same; nothing has come since a preview
  std::int64_t starts_ = 0;
  std::atomic<std::int64_t> next_event_{1};  ///< id of the next line or alarm
  SiteLogbook logbook_;
  SiteAlarms alarms_;
  WatchedPictures pictures_;

  /// Everything below; also held for every change of `lines_` and of the times of `health_`, so that a status
  /// is of one moment.
  mutable std::mutex mutex_;
  std::condition_variable arrivals_there_, arrivals_taken_;
  std::deque<Arrival> arrivals_;
  std::size_t at_hand_ = 0;  ///< arrivals that the updating thread has taken and not added yet
  bool replayed_ = false, ready_ = false, stopping_ = false, no_more_arrivals_ = false;
  LineStore lines_;
  SiteHealth health_;
  std::int64_t records_ = 0;
  std::size_t stale_lines_ = 0;
  std::string failure_;  ///< of the last update
  MonotonicTime started_ = monotonic_now();

  std::unique_ptr<Verifier> verifier_;  ///< null where the full-order model is not asked
  bool verification_wanted_ = false;    ///< a thorough one, under mutex_
  Verification verification_;           ///< of `model_`, under mutex_
  Eigen::VectorXd asked_mean_;          ///< updating thread; of the posterior it was asked at last

  std::shared_ptr<Pulse> pulse_;  ///< of the updating thread
  std::thread updater_;
};

}  // namespace knothe::service
