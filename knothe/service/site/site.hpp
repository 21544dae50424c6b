#pragma once
/// @file One structure: its journal, its posterior, and what is said of it. Two threads of its own: one
/// commits, one updates, so neither a slow disk nor a hard posterior holds up the other, or another site.
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "knothe/project/project_engine.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/site/metrics.hpp"

namespace knothe::service {

using Json = nlohmann::ordered_json;
using MonotonicClock = std::chrono::steady_clock;

/// Sources of data that come from watched folders.
inline constexpr const char* k_pictures_source = "pictures";
inline constexpr const char* k_csv_source = "csv";

/// A step's posterior as it is published. Immutable.
struct Line {
  std::int64_t event = 0;  ///< id, increasing for ever
  std::size_t step = 0;
  double time = 0;
  std::string json;                           ///< the line of a step (docs/formats.md)
  Eigen::VectorXd mean, std;                  ///< d
  Eigen::MatrixXd samples;                    ///< at most 400 × d, equally weighted
  std::vector<bool> missing;                  ///< per sensor, of the last datum of the step
  Eigen::VectorXd residual;                   ///< measured − predicted at the mean; 0 where missing
  double misfit = 0, misfit_probability = 1;  ///< χ² of the residual and P(more)
  Eigen::Index misfit_values = 0;
  std::map<std::string, double> above_threshold;  ///< P(q > threshold) by forecast
  bool trusted = true;
  std::string remark;
  bool monitor_alarm = false, bias_corrected = false;
  std::vector<Eigen::Index> stuck, absent;  ///< sensors that have stopped
  std::string notice;                       ///< what the monitor found or did at this step
  /// The correction of the model's bias, where it is on: as what is to be added to the model's functions w (a
  /// field), or at the sensors, m. Else empty.
  Eigen::VectorXd bias_functions, bias_sensors;
};

struct Alarm {
  std::int64_t id = 0;
  std::size_t step = 0;
  std::string severity, kind, message;
  [[nodiscard]] Json json() const;
};

/// Thread-safe.
class Site {
 public:
  /// Reads model and sensors, opens the journal. Errors as of `knothe assimilate` and `Journal`. `changed` is
  /// called (from any thread) when there is something new to send. Nothing runs before `start`.
  Site(project::Project project, bool strict_deadline, Metrics& metrics, std::function<void()> changed);
  ~Site();

  void start();
  /// Commits what was taken, finishes the step at hand, ends the threads.
  void stop();

  using Answer = std::variant<Appended, RequestError>;
  /// Checks the datum and puts it in the queue; `done` is called from another thread once it is on disk (or
  /// is not going to be). RequestError for what is wrong with it.
  void ingest(Measurement datum, std::function<void(Answer)> done);
  /// Lets a quarantined datum in. The same.
  void release(assimilation::DatumKey key, std::function<void(Answer)> done);
  /// Whether a datum that came from a watched folder is in the journal.
  [[nodiscard]] bool holds(const assimilation::DatumKey& key) const;
  /// What a person should know of a datum, as an alarm of the latest step.
  void warn(const std::string& kind, const std::string& message);
  /// The file in a watched folder that the datum of this model time was measured in.
  void show_picture(double time, std::string file);
  /// Of that step; empty if there is none.
  [[nodiscard]] std::string picture_of(std::size_t step) const;
  void count(const std::string& outcome);  ///< of a request that did not get so far: "malformed"

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] bool ready() const;
  [[nodiscard]] bool missed_strict_deadline() const { return strict_miss_.load(); }

  [[nodiscard]] std::shared_ptr<const Line> latest() const;
  /// Of that step; nothing if there is none.
  [[nodiscard]] std::shared_ptr<const Line> line(std::size_t step) const;
  /// Of all steps ≥ `from`, in order.
  [[nodiscard]] std::vector<std::shared_ptr<const Line>> lines(std::size_t from) const;
  /// The one with the smallest event > `event`.
  [[nodiscard]] std::shared_ptr<const Line> next_line(std::int64_t event) const;
  [[nodiscard]] std::int64_t last_event() const;
  /// Whether every measurement in the journal is in the lines.
  [[nodiscard]] bool settled() const;
  [[nodiscard]] std::vector<Alarm> alarms(std::int64_t after) const;
  [[nodiscard]] Json quarantine() const;

  [[nodiscard]] Json status() const;
  /// Looks at the clock: ages, states, gauges. True if the state has changed since.
  bool tick();
  [[nodiscard]] std::int64_t state_version() const { return state_version_.load(); }

  [[nodiscard]] const project::Project& project() const { return project_; }
  [[nodiscard]] const project::UpdateSetup& setup() const { return setup_; }
  [[nodiscard]] const Identity& identity() const { return identity_; }
  [[nodiscard]] const engine::Engine& engine() const { return engine_; }
  /// Of `Engine`, at any time.
  [[nodiscard]] std::optional<assimilation::StepForm> form_up_to(std::size_t step);
  [[nodiscard]] double budget_s() const;
  [[nodiscard]] std::optional<double> period_s() const;
  [[nodiscard]] std::optional<double> stale_after_s() const;

 private:
  struct Request {
    std::variant<Measurement, assimilation::DatumKey> what;
    std::function<void(Answer)> done;
    MonotonicClock::time_point at;
  };
  struct Arrival {
    Measurement measurement;
    MonotonicClock::time_point at;
    bool live = true;  ///< not from the journal's past
  };
  struct State {
    std::string word, reason;
    bool operator==(const State&) const = default;
  };

  void replay();
  void commit_loop();
  void commit(std::vector<Request>& group);
  Answer write(Request& request, std::vector<Arrival>& arrivals);
  void probe_disk();
  void update_loop();
  void take(const std::vector<Arrival>& arrivals);
  void conclude(std::size_t step, bool preview);
  void conclude_next();
  void publish(std::shared_ptr<Line> line);
  [[nodiscard]] std::shared_ptr<Line> make_line(const engine::StepResult& result);
  void judge_latency();
  void raise_alarms(const Line& line);
  void raise(std::size_t step, const std::string& severity, const std::string& kind,
             const std::string& message);
  void check_values(const Measurement& datum) const;
  [[nodiscard]] State state_of_now() const;  ///< mutex_ held
  [[nodiscard]] std::optional<double> period_locked() const;
  [[nodiscard]] double budget_locked() const;
  [[nodiscard]] std::string labels(const std::string& more = "") const;

  project::Project project_;
  std::string name_;
  bool strict_;
  Metrics& metrics_;
  std::function<void()> changed_;
  project::UpdateSetup setup_;
  Eigen::VectorXd sensor_std_;
  Identity identity_;
  Journal journal_;        ///< of the committing thread
  engine::Engine engine_;  ///< of the updating thread; its steps under engine_mutex_
  mutable std::mutex engine_mutex_;
  std::map<std::size_t, std::int64_t> received_ms_;  ///< when a step's last measurement arrived, Unix time

  mutable std::mutex mutex_;  ///< everything below
  std::condition_variable requests_there_, arrivals_there_;
  std::deque<Request> requests_;
  std::deque<Arrival> arrivals_;
  std::size_t at_hand_ = 0;  ///< arrivals that the updating thread has taken and not added yet
  bool stopping_ = false, replayed_ = false, ready_ = false, read_only_ = false, no_more_arrivals_ = false;
  std::map<std::size_t, std::shared_ptr<const Line>> lines_;
  std::map<std::int64_t, std::size_t> events_;
  std::int64_t next_event_ = 1;
  std::deque<Alarm> alarms_;
  std::map<std::string, std::string> alarm_conditions_;  ///< updating thread
  bool previewed_ = false;                               ///< the same; the last update was a preview
  bool newest_is_shown_ = false;                         ///< the same; nothing has come since a preview
  std::vector<JournalEntry> quarantine_;
  std::map<std::string, std::int64_t> outcomes_;
  std::set<assimilation::DatumKey> from_folders_;
  std::map<std::size_t, std::string> pictures_;         ///< file by step
  std::deque<MonotonicClock::time_point> accepted_at_;  ///< the last 32
  std::vector<MonotonicClock::time_point> waiting_;     ///< of data taken, whose line is not published yet
  std::int64_t records_ = 0, deadline_misses_ = 0;
  std::size_t stale_lines_ = 0;
  bool last_missed_ = false;
  std::string failure_;  ///< of the last update
  State state_;
  MonotonicClock::time_point started_ = MonotonicClock::now();

  std::map<std::pair<std::string, std::string>, std::int64_t> largest_seq_;  ///< committing thread
  std::atomic<std::int64_t> state_version_{0};
  std::atomic<bool> strict_miss_{false};
  std::thread committer_, updater_;
};

}  // namespace knothe::service
