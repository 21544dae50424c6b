/// @file Calibrations of cameras.
#include "fuzz/support.hpp"
#include "knothe/imaging/camera/calibration_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  knothe::fuzz::refuse_or_accept([&] {
    const auto cameras = knothe::imaging::parse_cameras(knothe::fuzz::text_of(data, size), "a.yaml");
    if (cameras.size() < 2) std::abort();
    for (const auto& camera : cameras)
      if (!camera.rotation.allFinite() || !(camera.fx > 0)) std::abort();
  });
  return 0;
}
