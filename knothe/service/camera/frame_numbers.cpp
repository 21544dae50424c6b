#include "knothe/service/camera/frame_numbers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace knothe::service {
namespace {

/// By how much the clocks of camera and machine may differ since the last frame and still be taken to be
/// running on: frames may have waited, and the time of the last one before a restart is that of its record.
constexpr double k_tolerance_us = 10e6, k_relative_tolerance = 1e-3;
/// GigE Vision counts 16 bits and leaves the 0 out.
constexpr std::int64_t k_ids = 65535;

}  // namespace

void FrameNumbers::begin(const std::string& serial, std::optional<double> period_s) {
  serial_ = serial;
  period_us_ = period_s ? std::optional(1e6 * *period_s) : std::nullopt;
  last_id_.reset();
}

bool FrameNumbers::is_same_clock(const FrameStamp& stamp) const {
  if (last_->session != serial_ && !last_->session.starts_with(serial_ + ".")) return false;
  const double camera = stamp.camera_us - last_->camera_us;
  const double host = stamp.host_us - last_->host_us;
  return std::abs(camera - host) <= k_tolerance_us + k_relative_tolerance * std::abs(host);
}

std::int64_t FrameNumbers::steps_since_last(const FrameStamp& stamp, Place& place) const {
  using By = Place::By;
  place.connected = last_id_.has_value();
  const bool same_clock = is_same_clock(stamp);
  if (period_us_) {
    place.by = same_clock ? By::camera_clock : By::host_clock;
    const std::int64_t us = same_clock ? stamp.camera_us - last_->camera_us : stamp.host_us - last_->host_us;
    const std::int64_t steps = std::llround(us / *period_us_);
    return same_clock ? steps : std::max<std::int64_t>(steps, 1);
  }
  place.by = same_clock ? By::order : By::host_clock;
  if (!last_id_) return same_clock && stamp.camera_us <= last_->camera_us ? 0 : 1;
  const std::int64_t id = stamp.id, last_id = *last_id_, steps = id - last_id;
  return steps < 0 ? steps + k_ids : steps;
}

std::optional<FrameNumbers::Place> FrameNumbers::place(const FrameStamp& stamp) {
  Place place;
  place.frame = {first_, serial_, stamp.camera_us, stamp.host_us};
  if (last_) {
    const std::int64_t steps = steps_since_last(stamp, place);
    if (steps <= 0) return std::nullopt;
    place.absent = steps - 1;
    place.frame.number = last_->number + steps;
    const bool new_clock = place.by == Place::By::host_clock;
    place.frame.session = new_clock ? fmt::format("{}.{}", serial_, place.frame.number) : last_->session;
  }
  last_ = place.frame;
  last_id_ = stamp.id;
  return place;
}

FrameNumbers::Numbered FrameNumbers::absent(const Place& place, const Numbered& before, std::int64_t i) {
  const auto between = [&](std::int64_t from, std::int64_t to) {
    return from + (to - from) * i / (place.absent + 1);
  };
  return {before.number + i, before.session, between(before.camera_us, place.frame.camera_us),
          between(before.host_us, place.frame.host_us)};
}

}  // namespace knothe::service
