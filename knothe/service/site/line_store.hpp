#pragma once
/// @file The lines of a site, by step and by event.
#include <deque>
#include <mutex>
#include <set>
#include <utility>

#include "knothe/files/nameless_file.hpp"
#include "knothe/service/site/line.hpp"

namespace knothe::service {

/// One line a step, the newest. Those published last are in memory, all others in a file without a name,
/// which goes with the process: a restart makes all lines again. Thread-safe; its mutex is taken last.
class LineStore {
 public:
  static constexpr std::size_t k_in_memory = 256, k_untrusted = 1000;

  /// `folder`: where the file is. While it cannot be written, lines stay in memory.
  explicit LineStore(std::string folder) : file_(std::move(folder)) {}

  /// Replaces the line of its step; one that is `withdrawn` takes it away. Its event must be greater than
  /// those published before.
  void publish(std::shared_ptr<const Line> line);

  /// Of the last step; nothing if there is none.
  [[nodiscard]] std::shared_ptr<const Line> latest() const;
  /// Of that step; nothing if there is none.
  [[nodiscard]] std::shared_ptr<const Line> line(std::size_t step) const;
  /// Of the first step ≥ `from` that has one; nothing if none has.
  [[nodiscard]] std::shared_ptr<const Line> line_from(std::size_t from) const;
  /// Event and step of the lines of all steps ≥ `from`, in the order of the steps.
  [[nodiscard]] std::vector<std::pair<std::int64_t, std::size_t>> events_from(std::size_t from) const;
  /// What was published with the smallest event > `event` and not replaced since, withdrawn ones too.
  [[nodiscard]] std::shared_ptr<const Line> next_line(std::int64_t event) const;
  [[nodiscard]] std::int64_t last_event() const;  ///< 0: none yet
  /// The last `k_untrusted` steps whose lines are not trusted, increasing.
  [[nodiscard]] std::vector<std::size_t> untrusted() const;
  [[nodiscard]] std::size_t in_memory() const;  ///< lines

 private:
  /// What is published of a step, and its place in the file.
  struct Entry {
    std::size_t step = 0;
    std::int64_t event = 0;
    std::int64_t offset = 0;
    std::uint32_t size = 0, capacity = 0;  ///< bytes
    std::uint32_t model = 0;               ///< of `models_`
    bool withdrawn = false;
  };
  [[nodiscard]] std::vector<Entry>::const_iterator first_from(std::size_t step) const;
  [[nodiscard]] const Entry* find(std::size_t step) const;
  Entry& insert(std::size_t step);
  [[nodiscard]] std::shared_ptr<const Line> get(const Entry& entry) const;
  void set_latest();
  void drop_replaced_events();
  bool file_oldest();
  bool write(const Line& line, Entry& entry);

  mutable std::mutex mutex_;
  std::vector<Entry> entries_;                                  ///< by step
  std::vector<std::pair<std::int64_t, std::size_t>> events_;    ///< and steps, by event; replaced ones too
  std::map<std::size_t, std::shared_ptr<const Line>> recent_;   ///< by step
  std::deque<std::pair<std::int64_t, std::size_t>> published_;  ///< of `recent_`, and what replaced them
  std::shared_ptr<const Line> latest_;
  std::set<std::size_t> untrusted_;
  std::vector<std::shared_ptr<const ServedModel>> models_;
  files::NamelessFile file_;
  std::int64_t end_ = 0;  ///< of the file
  bool told_ = false;     ///< that it cannot be written
};

}  // namespace knothe::service
