#pragma once
/// @file What people did and said while a structure was watched: alarms acknowledged, sensors switched off,
/// notes, the end of the test. Part of the journal, like the data.
#include <array>
#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "knothe/base/enum_names.hpp"
#include "knothe/service/journal/measurement.hpp"

namespace knothe::service {

/// `test_begun` is the first of a test that was begun in a running service; `test_followed` is the last of
/// the one before: it is finished, and the test that its text names has taken its place. `verification` is
/// what the full-order model said (verification.hpp). Data that are `released` or `withdrawn` have an entry
/// where somebody signed for it.
enum class EntryKind {
  acknowledgement,
  sensor_off,
  sensor_on,
  note,
  test_finished,
  test_resumed,
  test_begun,
  test_followed,
  verification_asked,
  verification,
  released,
  withdrawn
};
constexpr auto names_of(EntryKind) {
  return std::to_array<Named<EntryKind>>({{EntryKind::acknowledgement, "acknowledgement"},
                                          {EntryKind::sensor_off, "sensor_off"},
                                          {EntryKind::sensor_on, "sensor_on"},
                                          {EntryKind::note, "note"},
                                          {EntryKind::test_finished, "test_finished"},
                                          {EntryKind::test_resumed, "test_resumed"},
                                          {EntryKind::test_begun, "test_begun"},
                                          {EntryKind::test_followed, "test_followed"},
                                          {EntryKind::verification_asked, "verification_asked"},
                                          {EntryKind::verification, "verification"},
                                          {EntryKind::released, "released"},
                                          {EntryKind::withdrawn, "withdrawn"}});
}

struct LogbookEntry {
  std::int64_t number = 0;  ///< in the journal, from 1
  EntryKind kind = EntryKind::note;
  std::int64_t subject = 0;  ///< id of the alarm, index of the sensor, number of the record; else 0
  double time = 0;           ///< model time that it speaks of; of a sensor: from which it holds
  std::string author, text;
  std::int64_t written_ms = 0;  ///< Unix time
};

/// A request to write one, as it was sent. What is missing, and needed, is for its route to say.
struct EntryRequest {
  std::string site;
  std::optional<std::int64_t> step;
  std::optional<std::int64_t> sensor_index;
  std::string sensor_name;  ///< of a series; empty: by its index
  std::optional<bool> active;
  std::optional<std::string> test;  ///< name
  std::string author;
  std::string text;  ///< or comment
};

/// From a JSON object with `by` and, as the route needs them, `site`, `step`, `sensor`, `active`, `name` (of
/// a test), `text` or `comment`. `holder`, and errors, as of `parse_json_key`.
[[nodiscard]] EntryRequest parse_json_entry(std::string_view body, const std::string& holder = {});

/// How a test goes: begun, finished, resumed, followed by another.
class TestCourse {
 public:
  /// In the order of writing; entries of other kinds change nothing.
  void add(const LogbookEntry& entry);
  /// The entry that finished the test, or by which another took its place; none: it goes on.
  [[nodiscard]] const std::optional<LogbookEntry>& end() const { return end_; }
  /// Name of the test that has taken its place.
  [[nodiscard]] std::optional<std::string> followed_by() const;
  /// When it was begun in a running service, Unix time; 0: it was begun with the program.
  [[nodiscard]] std::int64_t begun_ms() const { return begun_ms_; }

 private:
  std::optional<LogbookEntry> end_;
  std::int64_t begun_ms_ = 0;
};

/// Which sensors are switched off, at which model times. Every entry holds from its time on, over those that
/// were written before it: so sensors are on again from some time on, or "on from the first time on" takes
/// all back.
class SensorSwitches {
 public:
  explicit SensorSwitches(std::span<const double> model_times) : model_times_(model_times) {}

  /// Entries of other kinds change nothing.
  void add(const LogbookEntry& entry);
  /// The first step at which what is switched at a model time holds; of a model with other times, the first
  /// that is not before.
  [[nodiscard]] std::size_t first_step(double time) const;
  [[nodiscard]] bool is_off(std::int64_t sensor, std::size_t step) const;
  /// Indices, increasing.
  [[nodiscard]] std::vector<std::int64_t> off_at(std::size_t step) const;
  /// The datum as the engine is to see it: what was switched off at its step is missing.
  [[nodiscard]] Measurement seen(Measurement datum) const;

 private:
  struct Switch {
    std::size_t from = 0;
    bool off = false;
  };
  std::span<const double> model_times_;
  std::map<std::int64_t, std::vector<Switch>> switches_;  ///< by sensor, in the order of writing
};

}  // namespace knothe::service
