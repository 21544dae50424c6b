/// @file Calibrations of cameras, OpenCV's and DICe's: what is accepted has sights for its pictures, or says
/// not.
#include "fuzz/support.hpp"
#include "knothe/imaging/camera/calibration_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string& file = knothe::fuzz::write_scratch(data, size);
  knothe::fuzz::refuse_or_accept([&] {
    for (const knothe::imaging::Camera& camera : knothe::imaging::read_cameras(file)) {
      const auto ray = camera.ray({100, 50});
      if (!ray.origin.allFinite() || !ray.direction.allFinite()) std::abort();
    }
  });
  return 0;
}
