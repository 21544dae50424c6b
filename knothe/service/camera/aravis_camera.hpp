#pragma once
/// @file GigE and USB3 cameras by Aravis; no GLib in this header. Where the program is built without it,
/// no_aravis_camera.cpp stands in.
#include "knothe/project/camera_options.hpp"
#include "knothe/service/camera/frame_source.hpp"

namespace knothe::service {

/// What to do to have cameras; empty: they are there.
[[nodiscard]] std::string what_cameras_need();

/// Finds the camera, sets it as the options say, and starts it. IoError that says what was refused.
[[nodiscard]] std::unique_ptr<FrameSource> open_aravis_camera(const project::CameraOptions& options);

}  // namespace knothe::service
