/// @file Calibrations of cameras: what is accepted has lines of sight, or says that it has none.
#include "fuzz/support.hpp"
#include "knothe/imaging/camera/calibration_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  knothe::fuzz::refuse_or_accept([&] {
    const auto cameras = knothe::imaging::parse_cameras(knothe::fuzz::text_of(data, size), "a.yaml");
    if (cameras.size() < 2) std::abort();
    for (const auto& camera : cameras) {
      const auto ray = camera.ray({100, 50});
      if (!ray.origin.allFinite() || !ray.direction.allFinite()) std::abort();
    }
  });
  return 0;
}
