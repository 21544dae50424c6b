#pragma once
/// @file What was refused though its sender was told that it arrived: kept, so that somebody can put it
/// right.
#include <cstdint>
#include <string>

#include "knothe/service/site/log.hpp"

namespace knothe::service {

/// A file of JSON lines, for one thread. Once it has `max_bytes` it is renamed to NAME.1, in the place of the
/// one before.
class DeadLetters {
 public:
  explicit DeadLetters(std::string path, std::int64_t max_bytes = 8 << 20)
      : path_(std::move(path)), max_bytes_(max_bytes) {}
  [[nodiscard]] const std::string& path() const { return path_; }
  /// Returns when it is on disk; false where it cannot be written: nothing of it is there.
  [[nodiscard]] bool store(const Json& letter) const noexcept;

 private:
  std::string path_;
  std::int64_t max_bytes_;
};

}  // namespace knothe::service
