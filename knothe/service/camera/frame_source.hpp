#pragma once
/// @file Where the frames of a camera come from. What is behind it (Aravis, GLib) is nobody else's business.
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "knothe/files/picture.hpp"

namespace knothe::service {

/// When a frame was taken.
struct FrameStamp {
  std::int64_t camera_us = 0;  ///< by the camera's clock, µs since it knows when
  std::int64_t host_us = 0;    ///< Unix time at which its first packet came here, µs
  std::uint64_t id = 0;        ///< counts the frames since acquisition began; GigE's goes from 65535 to 1
};

struct Frame {
  FrameStamp stamp;
  files::Picture picture;
};

/// A camera that is connected and takes frames until its end. For one thread.
class FrameSource {
 public:
  FrameSource() = default;
  FrameSource(const FrameSource&) = delete;
  FrameSource& operator=(const FrameSource&) = delete;
  virtual ~FrameSource() = default;

  /// The next frame in the order in which they were taken; nothing where none has come for so long. IoError
  /// where the camera is gone, or sends what is no grey picture.
  [[nodiscard]] virtual std::optional<Frame> next(double seconds) = 0;
  /// How many frames came with packets missing, since it was asked last, and what was wrong with the last.
  struct Incomplete {
    std::int64_t count = 0;
    std::string reason;
  };
  [[nodiscard]] virtual Incomplete incomplete() = 0;
  [[nodiscard]] virtual std::string serial() const = 0;
  [[nodiscard]] virtual std::string description() const = 0;  ///< vendor, model, settings, for the log
  /// Time between two frames, s; nothing where a trigger from outside comes when it comes.
  [[nodiscard]] virtual std::optional<double> period_s() const = 0;
};

}  // namespace knothe::service
