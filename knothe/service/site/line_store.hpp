#pragma once
/// @file The lines of a site, by step and by event.
#include <mutex>

#include "knothe/service/site/line.hpp"

namespace knothe::service {

/// One line a step, the newest. Thread-safe; its mutex is taken last.
class LineStore {
 public:
  /// Replaces the line of its step; one that is `withdrawn` takes it away. Its event must be greater than
  /// those published before.
  void publish(std::shared_ptr<const Line> line);

  /// Of the last step; nothing if there is none.
  [[nodiscard]] std::shared_ptr<const Line> latest() const;
  /// Of that step; nothing if there is none.
  [[nodiscard]] std::shared_ptr<const Line> line(std::size_t step) const;
  /// Of all steps ≥ `from`, in order.
  [[nodiscard]] std::vector<std::shared_ptr<const Line>> lines(std::size_t from) const;
  /// What was published with the smallest event > `event` and not replaced since, withdrawn ones too.
  [[nodiscard]] std::shared_ptr<const Line> next_line(std::int64_t event) const;
  [[nodiscard]] std::int64_t last_event() const;  ///< 0: none yet

 private:
  mutable std::mutex mutex_;
  std::map<std::size_t, std::shared_ptr<const Line>> lines_;
  std::map<std::int64_t, std::shared_ptr<const Line>> events_;  ///< the last of each step, by event
  std::map<std::size_t, std::int64_t> event_of_;                ///< by step
};

}  // namespace knothe::service
