#include "knothe/project/picture_registration.hpp"

#include <fmt/format.h>

#include <numbers>

#include "knothe/imaging/stereo/stereo_pose.hpp"
#include "knothe/project/picture_measurements.hpp"
#include "knothe/project/picture_options.hpp"

namespace knothe::project {

bool needs_model_outline(const Project& project) {
  return project.pictures.outline && project.pictures.outline->corners.empty();
}

std::optional<imaging::OutlineFit> register_pictures(Project& project, const std::optional<model::Mesh>& mesh,
                                                     bool live) {
  PictureOptions& p = project.pictures;
  if (!p.outline) return std::nullopt;
  imaging::Outline outline;
  if (!p.outline->corners.empty()) {
    outline = imaging::polygon_outline(p.outline->corners);
  } else {
    if (!mesh)
      throw project.error_at("dic.registration",
                             "\"dic.registration\" = \"outline\": there is no model whose mesh has one; give "
                             "\"dic.outline\", the corners of the body's face");
    outline = imaging::outline_of(surface_mesh(*mesh, model_face(project, mesh), project));
  }
  std::string path = p.outline->picture;
  if (path.empty()) path = (live ? live_series_options(project) : series_options(project)).references.front();
  imaging::OutlineFit fit = imaging::fit_outline(files::read_picture(path, p.series.colour), outline,
                                                 {.start = p.frame, .scale_std = p.outline->scale_std}, path);
  fit.frame.view = p.view, fit.frame.plane = p.plane.value_or(0);
  p.frame = fit.frame;
  p.outline.reset();
  return fit;
}

namespace {

Eigen::Vector3d on_face(const imaging::PictureFrame& face, double right, double up) {
  const auto at = face.model_point(right, -up);
  return {at[0], at[1], at[2]};
}

/// Fits the pose, and leaves the mesh on which it was found, flat in the model's face.
imaging::StereoPose fit_cameras(const PictureOptions& p, const imaging::PictureFrame& face,
                                imaging::StereoOptions& cameras) {
  imaging::StereoOptions still = cameras;
  for (imaging::SeriesOptions& series : still.series) series.pictures.clear(), series.times.clear();
  const imaging::StereoSurface surface = imaging::StereoSeries(still).surface();
  Eigen::Matrix2Xd pixels(2, std::ssize(p.pixels));
  imaging::SurfacePoints points(3, std::ssize(p.points));
  for (std::size_t k = 0; k < p.pixels.size(); ++k) pixels.col(k) << p.pixels[k][0], p.pixels[k][1];
  for (std::size_t k = 0; k < p.points.size(); ++k)
    points.col(k) = on_face(face, p.points[k][0], p.points[k][1]);
  const Eigen::Vector3d origin = on_face(face, 0, 0);
  const Eigen::Vector3d outward = (on_face(face, 1, 0) - origin).cross(on_face(face, 0, 1) - origin);
  const imaging::StereoPose pose =
      imaging::fit_stereo_pose(cameras.cameras.front(), surface.points, pixels, points, outward, p.point_std);
  imaging::use_pose(pose, cameras);
  cameras.series.front().mesh = surface.meshes.front(), cameras.series.front().region.reset();
  cameras.nodes = imaging::SurfacePoints(pose.pose.inverse() * surface.points);
  for (Index a = 0; a < cameras.nodes->cols(); ++a)
    cameras.nodes->col(a) -= outward.dot(cameras.nodes->col(a) - origin) * outward;
  for (imaging::SeriesOptions& series : cameras.series) series.outline_margin = 0;
  return pose;
}

}  // namespace

std::string register_cameras(const Project& project, const std::optional<model::Mesh>& mesh,
                             imaging::StereoOptions& cameras) {
  const PictureOptions& p = project.pictures;
  const imaging::PictureFrame face = model_face(project, mesh);
  std::string text;
  if (!p.pixels.empty() || !p.points.empty()) {
    const imaging::StereoPose pose = fit_cameras(p, face, cameras);
    text = fmt::format(
        "registered by {} points: at most {:.3g} mm off, turned to {:.1g} mrad; the surface is flat to "
        "{:.3g} mm",
        p.points.size(), 1e3 * pose.misfit, 1e3 * pose.turn_std, 1e3 * pose.flatness);
  }
  if (!p.model_mesh) return text;
  if (!mesh) throw project.error_at("dic.mesh", "\"dic.mesh\" = \"model\": the model has no mesh");
  const imaging::ImageMesh of_face = surface_mesh(*mesh, face, project);
  imaging::SurfacePoints nodes(3, of_face.node_count());
  for (Index a = 0; a < nodes.cols(); ++a) nodes.col(a) = on_face(face, of_face.x[a], -of_face.y[a]);
  cameras.series.front().mesh = imaging::seen_mesh(cameras.cameras.front(), nodes, of_face.elements);
  cameras.nodes = nodes, cameras.series.front().region = p.series.region;
  for (imaging::SeriesOptions& series : cameras.series) series.outline_margin = p.series.outline_margin;
  return text;
}

std::string registration_text(const imaging::OutlineFit& fit) {
  const double degrees = 180 / std::numbers::pi, scale = 1e3 * fit.frame.scale();
  return fmt::format(
      "registered by the outline: {:.6g} ± {:.1g} mm/px, turned by {:.3f} ± {:.3f}°, in place to {:.2f} and "
      "{:.2f} px; {} of {} edges used, {:.2f} px about it",
      scale, scale * fit.frame.relative_scale_std, degrees * std::arg(fit.frame.slope),
      degrees * fit.angle_std, fit.place_std[0], fit.place_std[1], fit.used, fit.places, fit.misfit);
}

}  // namespace knothe::project
