#include "knothe/service/camera/aravis_camera.hpp"

#include <arv.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"

namespace knothe::service {
namespace {

constexpr std::size_t k_buffer_memory = std::size_t{256} << 20;  // bytes
/// Of the socket, bytes: the system cuts it to net.core.rmem_max. Aravis' own choice, one frame, is too small
/// where a frame comes in one burst.
constexpr int k_socket_buffer = 16 << 20;
/// How long a frame may wait for its packets on a loaded machine; the frames behind it wait with it, µs.
constexpr guint k_packet_patience_us = 500'000;
/// A camera that is silent for so long, and so many periods, is gone.
constexpr double k_silence = 2, k_silent_periods = 5;  // s, 1
constexpr std::size_t k_min_buffers = 8, k_max_buffers = 128;

/// Of GObject.
struct Release {
  void operator()(gpointer object) const { g_object_unref(object); }
};
template <class T>
using Owned = std::unique_ptr<T, Release>;

/// A buffer goes back into the ring of its stream.
struct BackInto {
  ArvStream* stream;
  void operator()(ArvBuffer* buffer) const { arv_stream_push_buffer(stream, buffer); }
};

/// A call that may fail: `Attempt("the exposure", …)` gives what the call is told to put its error into.
class Attempt {
 public:
  explicit Attempt(std::string what) : what_(std::move(what)) {}
  Attempt(const Attempt&) = delete;
  Attempt& operator=(const Attempt&) = delete;
  ~Attempt() { g_clear_error(&error_); }
  operator GError**() { return &error_; }
  void require() const {
    if (error_ != nullptr) throw IoError(fmt::format("{}: {}", what_, error_->message));
  }

 private:
  std::string what_;
  GError* error_ = nullptr;
};

/// The identifier of the camera with that serial number. IoError where it is not there.
std::string identifier_of(const std::string& serial) {
  arv_update_device_list();
  std::string others;
  for (unsigned int i = 0; i < arv_get_n_devices(); ++i) {
    const char* found = arv_get_device_serial_nbr(i);
    if (found == nullptr) continue;
    if (serial == found) return arv_get_device_id(i);
    others += fmt::format("{}{}", others.empty() ? "; there are " : ", ", found);
  }
  throw IoError(fmt::format("no camera with the serial number {} was found{}", serial, others));
}

Owned<ArvCamera> connect(const project::CameraOptions& options) {
  const std::string name = options.serial.empty() ? options.address : identifier_of(options.serial);
  Attempt attempt(name.empty() ? "no camera was found" : fmt::format("the camera {}", name));
  Owned<ArvCamera> camera(arv_camera_new(name.empty() ? nullptr : name.c_str(), attempt));
  attempt.require();
  if (!camera)
    throw IoError(name.empty() ? "no camera was found" : fmt::format("no camera {} was found", name));
  return camera;
}

void set_image(ArvCamera* camera, const project::CameraOptions& options) {
  if (!options.pixel_format.empty()) {
    Attempt attempt("serve.camera.pixel_format");
    arv_camera_set_pixel_format_from_string(camera, options.pixel_format.c_str(), attempt);
    attempt.require();
  }
  if (!options.region.empty()) {
    Attempt attempt("serve.camera.region");
    const auto at = [&](std::size_t i) -> gint { return options.region[i]; };
    arv_camera_set_region(camera, at(0), at(1), at(2), at(3), attempt);
    attempt.require();
    gint x = 0, y = 0, width = 0, height = 0;
    arv_camera_get_region(camera, &x, &y, &width, &height, attempt);
    attempt.require();
    if (x != at(0) || y != at(1) || width != at(2) || height != at(3))
      throw IoError(fmt::format("serve.camera.region: the camera makes [{}, {}, {}, {}] of [{}, {}, {}, {}]",
                                x, y, width, height, at(0), at(1), at(2), at(3)));
  }
  if (options.exposure) {
    Attempt attempt("serve.camera.exposure"), automatic("");
    if (arv_camera_is_exposure_auto_available(camera, automatic))
      arv_camera_set_exposure_time_auto(camera, ARV_AUTO_OFF, automatic);
    arv_camera_set_exposure_time(camera, 1e6 * *options.exposure, attempt);
    attempt.require();
  }
  if (options.gain) {
    Attempt attempt("serve.camera.gain"), automatic("");
    if (arv_camera_is_gain_auto_available(camera, automatic))
      arv_camera_set_gain_auto(camera, ARV_AUTO_OFF, automatic);
    arv_camera_set_gain(camera, *options.gain, attempt);
    attempt.require();
  }
}

/// Time between two frames, s.
std::optional<double> set_trigger(ArvCamera* camera, const project::CameraOptions& options) {
  using project::CameraTrigger;
  Attempt attempt("serve.camera.trigger"), rate("serve.camera.frame_rate");
  arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, attempt);
  attempt.require();
  if (options.trigger == CameraTrigger::free) {
    arv_camera_clear_triggers(camera, attempt);
    attempt.require();
    if (options.frame_rate) arv_camera_set_frame_rate(camera, *options.frame_rate, rate);
    rate.require();
    const double hertz = arv_camera_get_frame_rate(camera, rate);
    rate.require();
    if (!(hertz > 0)) throw IoError("the camera does not say its frame rate: give serve.camera.frame_rate");
    return 1 / hertz;
  }
  const bool software = options.trigger == CameraTrigger::software;
  arv_camera_set_trigger(camera, software ? "Software" : options.trigger_line.c_str(), attempt);
  attempt.require();
  return options.frame_rate ? std::optional(1 / *options.frame_rate) : std::nullopt;
}

/// Grey levels of a whole buffer, as the file would have them in which it is kept: of 8 or 16 bits. IoError
/// for another format.
files::Picture picture_of(ArvBuffer* buffer) {
  const ArvPixelFormat format = arv_buffer_get_image_pixel_format(buffer);
  const bool deep = format == ARV_PIXEL_FORMAT_MONO_10 || format == ARV_PIXEL_FORMAT_MONO_12 ||
                    format == ARV_PIXEL_FORMAT_MONO_14 || format == ARV_PIXEL_FORMAT_MONO_16;
  if (!deep && format != ARV_PIXEL_FORMAT_MONO_8)
    throw IoError(
        fmt::format("the camera sends pixels of format 0x{:08x}, which are not grey levels of 8 or 16 bits: "
                    "set serve.camera.pixel_format to Mono8, Mono10, Mono12, Mono14 or Mono16",
                    format));
  files::Picture picture;
  picture.width = arv_buffer_get_image_width(buffer);
  picture.height = arv_buffer_get_image_height(buffer);
  picture.bit_depth = deep ? 16 : 8;
  picture.maximum = deep ? 65535 : 255;
  const std::size_t width = picture.width, height = picture.height;
  gint padding = 0, below = 0;
  arv_buffer_get_image_padding(buffer, &padding, &below);
  const std::size_t bytes = deep ? 2 : 1;
  const std::size_t stride = bytes * width + padding;
  std::size_t size = 0;
  const auto* data = static_cast<const std::uint8_t*>(arv_buffer_get_image_data(buffer, &size));
  if (data == nullptr || width * height == 0 || size < stride * (height - 1) + bytes * width)
    throw IoError(fmt::format("the camera sends {} bytes for {} × {} pixels", size, width, height));
  picture.pixels.resize(width * height);
  for (std::size_t y = 0; y < height; ++y) {
    const std::uint8_t* row = data + stride * y;
    float* out = picture.pixels.data() + width * y;
    for (std::size_t x = 0; x < width; ++x)  // little endian
      out[x] = bytes == 1 ? row[x] : row[2 * x] | row[2 * x + 1] << 8;
  }
  return picture;
}

std::string words_of(ArvBufferStatus status) {
  switch (status) {
    case ARV_BUFFER_STATUS_TIMEOUT:
      return "packets did not come in time";
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return "packets are missing";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "packets have wrong numbers";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "its size is not that of the region";
    default:
      return fmt::format("Aravis says status {}", static_cast<int>(status));
  }
}

/// Triggers a camera at a rate, by a thread of its own.
class SoftwareTrigger {
 public:
  SoftwareTrigger(ArvCamera* camera, double period_s) : camera_(camera), period_(period_s) {
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }

 private:
  void run(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    const auto start = std::chrono::steady_clock::now();
    for (std::int64_t i = 1; !stop.stop_requested(); ++i) {
      const auto due = start + std::chrono::duration_cast<std::chrono::nanoseconds>(i * period_);
      end_.wait_until(lock, stop, due, [] { return false; });
      if (stop.stop_requested()) return;
      Attempt unseen("");  // that the camera is gone is told by its stream
      arv_camera_software_trigger(camera_, unseen);
    }
  }
  ArvCamera* camera_;
  std::chrono::duration<double> period_;
  std::mutex mutex_;
  std::condition_variable_any end_;
  std::jthread thread_;
};

class AravisCamera final : public FrameSource {
 public:
  explicit AravisCamera(const project::CameraOptions& options) : camera_(connect(options)) {
    ArvCamera* camera = camera_.get();
    Attempt unasked(""), serial("the serial number");
    arv_camera_stop_acquisition(camera, unasked);  // of a reader before
    // Through a packet socket, which root would have, whole seconds of frames were lost now and then.
    if (arv_camera_is_gv_device(camera))
      arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    if (options.packet_size && arv_camera_is_gv_device(camera)) {
      Attempt size("serve.camera.packet_size");
      arv_camera_gv_set_packet_size(camera, *options.packet_size, size);
      size.require();
    }
    set_image(camera, options);
    period_s_ = set_trigger(camera, options);
    is_steady_ = options.trigger != project::CameraTrigger::hardware;
    const char* number = arv_camera_get_device_serial_number(camera, serial);
    serial.require();
    serial_ = number != nullptr ? number : "camera";
    start();
    if (options.trigger == project::CameraTrigger::software) trigger_.emplace(camera, *period_s_);
  }

  ~AravisCamera() override {
    trigger_.reset();
    g_signal_handlers_disconnect_by_data(arv_camera_get_device(camera_.get()), this);
    Attempt unasked("");
    if (!lost_) arv_camera_stop_acquisition(camera_.get(), unasked);
  }

  std::optional<Frame> next(double seconds) override {
    const std::unique_ptr<ArvBuffer, BackInto> buffer(
        arv_stream_timeout_pop_buffer(stream_.get(), static_cast<guint64>(1e6 * seconds)),
        BackInto{stream_.get()});
    if (!buffer) {
      require_life();
      return std::nullopt;
    }
    last_came_ = monotonic_now();
    const ArvBufferStatus status = arv_buffer_get_status(buffer.get());
    if (status == ARV_BUFFER_STATUS_CLEARED || status == ARV_BUFFER_STATUS_ABORTED) return std::nullopt;
    if (status != ARV_BUFFER_STATUS_SUCCESS) {
      ++incomplete_.count;
      incomplete_.reason = words_of(status);
      return std::nullopt;
    }
    const std::int64_t host_us = arv_buffer_get_system_timestamp(buffer.get()) / 1000;
    const std::int64_t camera_us = arv_buffer_get_timestamp(buffer.get()) / 1000;
    return Frame{{camera_us > 0 ? camera_us : host_us, host_us, arv_buffer_get_frame_id(buffer.get())},
                 picture_of(buffer.get())};
  }

  Incomplete incomplete() override { return std::exchange(incomplete_, {}); }
  std::string serial() const override { return serial_; }
  std::string description() const override {
    Attempt unknown("");
    const char* vendor = arv_camera_get_vendor_name(camera_.get(), unknown);
    const char* model = arv_camera_get_model_name(camera_.get(), unknown);
    return fmt::format(
        "{} {}, {}", vendor != nullptr ? vendor : "?", model != nullptr ? model : "?",
        period_s_ ? fmt::format("{:.6g} frames per second", 1 / *period_s_) : "frames as triggered");
  }
  std::optional<double> period_s() const override { return period_s_; }

 private:
  void start() {
    Attempt attempt("the camera's stream");
    const std::size_t payload = arv_camera_get_payload(camera_.get(), attempt);
    attempt.require();
    stream_.reset(arv_camera_create_stream(camera_.get(), nullptr, nullptr, attempt));
    attempt.require();
    if (ARV_IS_GV_STREAM(stream_.get()))
      g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
                   k_socket_buffer, "frame-retention", k_packet_patience_us, nullptr);
    const std::size_t fit = k_buffer_memory / std::max<std::size_t>(payload, 1);
    for (std::size_t i = 0; i < std::clamp(fit, k_min_buffers, k_max_buffers); ++i)
      arv_stream_push_buffer(stream_.get(), arv_buffer_new_allocate(payload));
    g_signal_connect(arv_camera_get_device(camera_.get()), "control-lost", G_CALLBACK(on_control_lost), this);
    arv_camera_start_acquisition(camera_.get(), attempt);
    attempt.require();
    last_came_ = monotonic_now();
  }

  /// A camera that runs by itself, or that we trigger, sends something: its silence is noticed sooner than
  /// that its heartbeat fails.
  void require_life() {
    const double silent = seconds_since(last_came_);
    if (is_steady_ && silent > std::max(k_silence, k_silent_periods * *period_s_)) lost_ = true;
    if (lost_) throw IoError(fmt::format("the camera {} no longer answers", serial_));
  }

  static void on_control_lost(ArvDevice*, gpointer self) { static_cast<AravisCamera*>(self)->lost_ = true; }

  Owned<ArvCamera> camera_;
  Owned<ArvStream> stream_;
  std::string serial_;
  std::optional<double> period_s_;
  bool is_steady_ = true;
  MonotonicTime last_came_;
  Incomplete incomplete_;
  std::atomic<bool> lost_{false};
  std::optional<SoftwareTrigger> trigger_;
};

}  // namespace

std::string what_cameras_need() {
  return "";
}

std::unique_ptr<FrameSource> open_aravis_camera(const project::CameraOptions& options) {
  return std::make_unique<AravisCamera>(options);
}

}  // namespace knothe::service
