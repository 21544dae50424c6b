/// @file A GigE camera on this machine (Aravis' own), which shows pictures from a folder.
///
/// usage: fake_camera SERIAL FOLDER [--start US] [--rate HZ | --trigger HZ] [--lose FIRST LAST] [--heartbeat
/// MS] shows FOLDER/picture_*, one a frame, at 127.0.0.1 until its standard input ends; behind the last, the
/// last. The first picture is the one of the first frame (or of Unix time `--start`, µs); from then on the
/// clock goes on, whether somebody reads the camera or not. A frame's time stamp is exact, however late it
/// was made.
/// `--rate`: of the reader's triggers; `--trigger`: of a line. `--lose`: frames FIRST to LAST lose most of
/// their packets. `--heartbeat`: the camera is free again so long after its reader died. Prints `ready`, then
/// `start US` once the first picture was shown.
#include <arv.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "knothe/files/picture.hpp"

namespace {

constexpr std::int64_t k_pause_us = 1'000'000;   ///< without frames: nobody reads
constexpr guint32 k_heartbeat_register = 0x938;  ///< GigE Vision's, ms

struct Show {
  std::vector<knothe::files::Picture> pictures;
  ArvGvFakeCamera* camera = nullptr;
  std::int64_t start_us = 0, last_us = 0, last = -1, lose_first = 1, lose_last = 0;
  double rate_hz = 0;  ///< 0: what the reader sets
};

/// The number of the frame that is made now; a camera that this machine makes wait skips none.
std::int64_t next_number(Show& show, double period_us) {
  const std::int64_t now = g_get_real_time();
  if (show.start_us == 0) {
    show.start_us = now;
    std::printf("start %lld\n", static_cast<long long>(now));
    std::fflush(stdout);
  }
  const bool goes_on = show.last_us != 0 && now - show.last_us < k_pause_us;
  const auto by_clock = static_cast<std::int64_t>(static_cast<double>(now - show.start_us) / period_us + 0.5);
  show.last_us = now;
  show.last = goes_on ? show.last + 1 : std::max(show.last + 1, by_clock);
  return show.last;
}

void fill(ArvBuffer* buffer, void* data, guint32, guint32, ArvPixelFormat format) {
  Show& show = *static_cast<Show*>(data);
  guint32 period = 0;
  arv_fake_camera_read_register(arv_gv_fake_camera_get_fake_camera(show.camera),
                                ARV_FAKE_CAMERA_REGISTER_ACQUISITION_FRAME_PERIOD_US, &period);
  const double period_us = show.rate_hz > 0 ? 1e6 / show.rate_hz : period;
  const std::int64_t number = next_number(show, period_us);
  const double taken_us = static_cast<double>(number) * period_us;
  arv_buffer_set_timestamp(buffer,
                           1000 * static_cast<guint64>(show.start_us + static_cast<std::int64_t>(taken_us)));
  const bool loses = number >= show.lose_first && number <= show.lose_last;
  g_object_set(show.camera, "gvsp-lost-ratio", loses ? 0.7 : 0.0, nullptr);
  const auto shown = std::clamp<std::int64_t>(number, 0, static_cast<std::int64_t>(show.pictures.size()) - 1);
  const auto& picture = show.pictures[static_cast<std::size_t>(shown)];
  size_t size = 0;
  auto* out = static_cast<unsigned char*>(const_cast<void*>(arv_buffer_get_image_data(buffer, &size)));
  const int width = arv_buffer_get_image_width(buffer), height = arv_buffer_get_image_height(buffer);
  const std::size_t bytes = format == ARV_PIXEL_FORMAT_MONO_16 ? 2 : 1;
  for (int y = 0; y < std::min(height, picture.height); ++y)
    for (int x = 0; x < std::min(width, picture.width); ++x) {
      const auto at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
      const auto level = static_cast<unsigned>(picture.at(x, y));
      out[bytes * at] = static_cast<unsigned char>(level & 255U);
      if (bytes == 2) out[2 * at + 1] = static_cast<unsigned char>(level >> 8U);
    }
}

/// Aravis' camera hears software triggers alone: a line is one of them, as soon as the reader waits for it.
void pull_line(const std::stop_token& stop, ArvFakeCamera* camera, double hertz) {
  while (!stop.stop_requested()) {
    std::this_thread::sleep_for(std::chrono::duration<double>(1 / hertz));
    guint32 waits = 0;
    arv_fake_camera_read_register(camera, ARV_FAKE_CAMERA_REGISTER_TRIGGER_MODE, &waits);
    if (waits != 1) continue;
    arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOURCE, 1);
    arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOFTWARE, 1);
  }
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 3) throw std::runtime_error("usage: fake_camera SERIAL FOLDER [OPTIONS]");
  Show show;
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(argv[2]))
    if (entry.path().filename().string().starts_with("picture_")) names.push_back(entry.path().string());
  std::sort(names.begin(), names.end());
  for (const std::string& name : names) show.pictures.push_back(knothe::files::read_picture(name));
  if (show.pictures.empty()) throw std::runtime_error("no pictures");
  g_random_set_seed(1);  // which packets are lost
  show.camera = arv_gv_fake_camera_new("127.0.0.1", argv[1]);
  ArvFakeCamera* camera = arv_gv_fake_camera_get_fake_camera(show.camera);
  std::jthread line;
  for (int i = 3; i < argc; ++i) {
    const std::string option = argv[i];
    if (option == "--start") show.start_us = std::stoll(argv[++i]);
    if (option == "--rate" || option == "--trigger") show.rate_hz = std::stod(argv[++i]);
    if (option == "--trigger") line = std::jthread(pull_line, camera, show.rate_hz);
    if (option == "--heartbeat")
      arv_fake_camera_write_register(camera, k_heartbeat_register,
                                     static_cast<guint32>(std::stoi(argv[++i])));
    if (option == "--lose") show.lose_first = std::stoll(argv[++i]), show.lose_last = std::stoll(argv[++i]);
  }
  arv_fake_camera_set_fill_pattern(camera, fill, &show);
  if (!arv_gv_fake_camera_is_running(show.camera)) throw std::runtime_error("the camera does not run");
  std::puts("ready");
  std::fflush(stdout);
  while (std::getchar() != EOF) {
  }
  line = {};
  g_object_unref(show.camera);
} catch (const std::exception& error) {
  std::fprintf(stderr, "fake_camera: %s\n", error.what());
  return 1;
}
