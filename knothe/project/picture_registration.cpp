#include "knothe/project/picture_registration.hpp"

#include <fmt/format.h>

#include <numbers>

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
    // The face in metres, y down.
    imaging::PictureFrame metres;
    metres.view = p.view, metres.plane = p.plane.value_or(0);
    outline = imaging::outline_of(surface_mesh(*mesh, with_plane(metres, project, mesh), project));
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

std::string registration_text(const imaging::OutlineFit& fit) {
  const double degrees = 180 / std::numbers::pi, scale = 1e3 * fit.frame.scale();
  return fmt::format(
      "registered by the outline: {:.6g} ± {:.1g} mm/px, turned by {:.3f} ± {:.3f}°, in place to {:.2f} and "
      "{:.2f} px; {} of {} edges used, {:.2f} px about it",
      scale, scale * fit.frame.relative_scale_std, degrees * std::arg(fit.frame.slope),
      degrees * fit.angle_std, fit.place_std[0], fit.place_std[1], fit.used, fit.places, fit.misfit);
}

}  // namespace knothe::project
