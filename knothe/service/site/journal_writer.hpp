#pragma once
/// @file The way of a site's measurements to the disk.
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "knothe/base/monotonic_time.hpp"
#include "knothe/likelihood/data/plausible_range.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/site/file_register.hpp"
#include "knothe/service/site/log.hpp"
#include "knothe/service/site/metrics.hpp"
#include "knothe/service/site/pulses.hpp"
#include "knothe/service/site/site_logbook.hpp"

namespace knothe::service {

/// Sources of data that come from watched folders, and from a camera.
inline constexpr const char* k_pictures_source = "pictures";
inline constexpr const char* k_csv_source = "csv";
inline constexpr const char* k_camera_source = "camera";

/// A measurement in the journal that is to be assimilated, or taken out again.
struct Arrival {
  Measurement measurement;
  MonotonicTime at;  ///< of its request
  enum class Kind {
    live,
    past,       ///< from the journal's past
    withdrawn,  ///< to be taken out
    replaced    ///< to be seen otherwise than it was: a sensor was switched
  } kind = Kind::live;
};

/// A datum that is withdrawn now.
struct Withdrawn {
  std::int64_t step = 0;
  bool before = false;    ///< it had been already
  bool replaced = false;  ///< and a datum of its key is there
};

/// What is answered of a datum that is in the journal.
[[nodiscard]] Json answer_of(const Appended& appended);
[[nodiscard]] Json answer_of(const Withdrawn& withdrawn);

/// Checks measurements and commits them in groups, by a thread of its own. Thread-safe. Its mutex is taken
/// last, and not held while it calls others.
class JournalWriter {
 public:
  using Answer = std::variant<Appended, RequestError, Withdrawn, LogbookEntry>;
  /// Called from the thread.
  struct Listener {
    /// What is in the journal now and was not before, and the number of its records: first the journal's
    /// past, in parts, of which the last is `all_replayed`, then after each commit, before its requests are
    /// answered.
    std::function<void(std::vector<Arrival>, std::int64_t records, bool all_replayed)> arrived;
    /// Before that: a datum in quarantine that has a value beyond its limit, and which, in words; empty: it
    /// is there no more.
    std::function<void(const Measurement&, const std::string& reason)> doubted;
    /// Before that: an entry of the logbook that is on disk now.
    std::function<void(const LogbookEntry&)> noted;
    /// After requests were answered.
    std::function<void()> changed;
  };
  struct Tally {
    std::size_t waiting = 0;  ///< requests
    std::size_t quarantined = 0;
    std::map<std::string, std::int64_t> outcomes;  ///< of requests
    bool read_only = false;                        ///< nothing can be written
    std::string trouble;                           ///< and why
  };

  /// Opens the journal; errors of `Journal` and `serve_limits`.
  JournalWriter(const project::Project& project, const project::UpdateSetup& setup, Metrics& metrics,
                Listener listener);
  ~JournalWriter() { stop(); }

  /// Records for what the data are; errors of `Journal`, DataError where data are of times that the model
  /// does not have.
  void identify(const Identity& identity);
  /// Number of starts, this one included, counted from `least` at least. Before `start`.
  std::int64_t count_start(std::int64_t least);
  [[nodiscard]] const std::string& id() const { return id_; }  ///< of the journal
  /// What is in the journal. Before `start`.
  [[nodiscard]] const JournalReader& records() const { return journal_; }
  /// Stores an alarm: with the next group, by itself, or in `finish`.
  void store_alarm(Alarm alarm);
  void start(std::shared_ptr<Pulse> pulse = nullptr);
  void open();    ///< From now on requests are taken.
  void stop();    ///< Commits what was taken, ends the thread.
  void finish();  ///< After `stop`: keeps the last alarms, and leaves nothing in the journal's log.
  [[nodiscard]] bool ready() const;

  /// Checks the datum and puts it in the queue; `done` is called from another thread once it is on disk (or
  /// is not going to be). RequestError for what is wrong with it.
  /// `file`, where it has one: noted in the same commit, so that no datum is ever without it.
  void ingest(Measurement datum, std::function<void(Answer)> done, std::optional<JournalFile> file = {});
  /// Lets a quarantined datum in. The same.
  void release(RecordName name, Signature signature, std::function<void(Answer)> done);
  /// Takes a datum out. The same.
  void withdraw(RecordName name, Signature signature, std::function<void(Answer)> done);
  /// Writes an entry into the logbook. The same.
  void enter(LogbookEntry entry, std::function<void(Answer)> done);
  /// The same, and waits until it is on disk: as it is there. RequestError where it is not.
  LogbookEntry enter(LogbookEntry entry);
  /// What became of the files of watched folders.
  [[nodiscard]] FileRegister& files() { return files_; }
  /// What became of a file that gave no datum, or several. An alarm about it is raised before: then no file
  /// is on disk without its alarm.
  void note(JournalFile file);
  /// The last datum of a camera that was in the journal at the start, without its values.
  [[nodiscard]] std::optional<Measurement> last_frame() const;
  void count(const std::string& outcome);  ///< of a request that did not get so far: "malformed"
  [[nodiscard]] Tally tally() const;
  [[nodiscard]] Json quarantine() const;

 private:
  struct Release {
    RecordName name;
    Signature signature;
  };
  struct Withdrawal {
    RecordName name;
    Signature signature;
  };
  struct Request {
    std::variant<Measurement, Release, Withdrawal, LogbookEntry> what;
    std::function<void(Answer)> done;
    MonotonicTime at;
    std::optional<JournalFile> file = std::nullopt;
  };
  void enqueue(Request request);
  void require_times() const;
  void replay();
  void commit_loop();
  [[nodiscard]] bool has_aside() const;
  void look_after_journal();
  void write_aside();
  void commit(std::vector<Request>& group);
  /// What is true once a group is on disk.
  struct Written {
    std::vector<Arrival> arrivals;
    std::vector<JournalEntry> quarantined;
    std::vector<JournalEntry> no_longer_quarantined;
    std::vector<likelihood::DatumKey> from_folders;
    std::vector<JournalFile> files;
    std::vector<Measurement> withdrawn;
    std::vector<LogbookEntry> entries;
  };
  Answer write(Request& request, Written& written);
  Answer write(Measurement& datum, MonotonicTime at, Written& written);
  Answer write(const Release& release, MonotonicTime at, Written& written);
  Answer write(const Withdrawal& withdrawal, MonotonicTime at, Written& written);
  Answer write(const LogbookEntry& entry, MonotonicTime at, Written& written);
  void sign(EntryKind kind, const JournalEntry& entry, const Signature& signature, Written& written);
  [[nodiscard]] static RequestError refusal_after(const LogbookEntry& end);
  void announce(const Written& written);
  [[nodiscard]] std::string refuse_if_misplaced(std::vector<Answer>& answers) const;
  void count_outcome(const Answer& answer);
  void probe_disk();
  void set_trouble(const std::string& trouble);
  void check_values(const Measurement& datum) const;
  [[nodiscard]] std::string complaint(const Measurement& datum) const;
  [[nodiscard]] std::string reason_of(Quarantine quarantined, const Measurement& datum) const;

  const project::ServeOptions& options_;
  const project::UpdateSetup& setup_;
  Eigen::VectorXd sensor_std_;
  likelihood::PlausibleRange limits_;
  Metrics& metrics_;
  Listener listener_;
  Journal journal_;  ///< of the thread
  std::string id_;
  bool checkpointed_ = true;  ///< of the thread: nothing is in the journal's log alone
  /// Of the thread, by source and session: the largest seqs, one more than may come late, the largest first.
  using LargestSeqs = std::map<std::pair<std::string, std::string>, std::vector<std::int64_t>>;
  LargestSeqs largest_seqs_, largest_before_;  ///< and those of the group's sessions before it
  std::vector<std::int64_t>& seqs_of(const likelihood::DatumKey& key);
  void count_seq(const likelihood::DatumKey& key);
  SensorSwitches switches_;  ///< of the thread
  FileRegister files_;
  TestCourse course_;  ///< of the thread
  void apply(const LogbookEntry& entry);

  mutable std::mutex mutex_;  ///< everything below
  std::condition_variable requests_there_;
  std::deque<Request> requests_;
  std::deque<Alarm> alarms_;  ///< to be kept
  bool open_ = false, stopping_ = false;
  std::string trouble_;  ///< why nothing can be written; empty: it can
  std::vector<JournalEntry> quarantine_;
  std::map<std::string, std::int64_t> outcomes_;
  std::optional<Measurement> last_frame_;

  std::shared_ptr<Pulse> pulse_;  ///< of the thread
  std::thread thread_;
};

}  // namespace knothe::service
