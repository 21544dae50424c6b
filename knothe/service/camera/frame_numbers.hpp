#pragma once
/// @file Which picture of the test a frame of a camera is.
#include <optional>
#include <string>

#include "knothe/service/camera/frame_source.hpp"

namespace knothe::service {

/// Counts the frames of a camera, those that never came included. Where they come at a known rate a frame's
/// number follows from the camera's clock, whose drift does not add up because only the time since the last
/// frame counts; else from its id. After an interruption the camera's clock is used as long as it agrees
/// with this machine's; else (it was switched off meanwhile, or is another camera) this machine's clock
/// counts.
class FrameNumbers {
 public:
  struct Numbered {
    std::int64_t number = 0;
    /// Serial number of the camera; where its clock began again, with the number of the first frame since.
    std::string session;
    std::int64_t camera_us = 0, host_us = 0;
  };
  struct Place {
    Numbered frame;
    std::int64_t absent = 0;  ///< numbers between the last frame and this one
    /// Whether those were lost while the camera was connected; else it, or the service, was away.
    bool connected = true;
    enum class By { camera_clock, host_clock, order } by = By::camera_clock;
  };

  /// `last`: the last frame that is known; nothing: the next one has the number 0.
  explicit FrameNumbers(std::optional<Numbered> last) : last_(std::move(last)) {}

  /// The camera is connected (again). `period_s` as of `FrameSource`.
  void begin(const std::string& serial, std::optional<double> period_s);
  /// So many frames were there before the first whole one, of all.
  void skip(std::int64_t count) {
    if (!last_) first_ += count;
  }
  /// Nothing for a frame that is not newer than the last one by half a period or more: it is known already.
  [[nodiscard]] std::optional<Place> place(const FrameStamp& stamp);
  /// The number, session and times of the `i`-th of the absent ones before a place, from 1 on.
  [[nodiscard]] static Numbered absent(const Place& place, const Numbered& before, std::int64_t i);
  [[nodiscard]] const std::optional<Numbered>& last() const { return last_; }

 private:
  [[nodiscard]] std::int64_t steps_since_last(const FrameStamp& stamp, Place& place) const;
  [[nodiscard]] bool is_same_clock(const FrameStamp& stamp) const;

  std::optional<Numbered> last_;
  std::int64_t first_ = 0;
  std::string serial_;
  std::optional<double> period_us_;
  std::optional<std::uint64_t> last_id_;  ///< since `begin`
};

}  // namespace knothe::service
