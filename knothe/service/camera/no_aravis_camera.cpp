#include "knothe/base/error.hpp"
#include "knothe/service/camera/aravis_camera.hpp"

namespace knothe::service {

std::string what_cameras_need() {
  return "this knothe was built without cameras: install libaravis-dev and libusb-1.0-0-dev and build it "
         "again (cmake says \"cameras by Aravis\")";
}

std::unique_ptr<FrameSource> open_aravis_camera(const project::CameraOptions& /*options*/) {
  throw IoError(what_cameras_need());
}

}  // namespace knothe::service
