#include "knothe/project/picture_options.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string_view>

#include "knothe/base/error.hpp"
#include "knothe/imaging/mesh/outline_registration.hpp"
#include "knothe/imaging/series/picture_folder.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/project_values.hpp"

namespace knothe::project {
namespace {

std::string resolved(const std::string& folder, const std::string& path) {
  return path.empty() ? path : (std::filesystem::path(folder) / path).lexically_normal().string();
}

/// Two numbers, or a complaint.
std::optional<std::array<double, 2>> read_pair(Values& values, const std::string& key) {
  if (!values.has(key)) return std::nullopt;
  const std::vector<double> v = values.numbers(key);
  if (v.size() == 2) return std::array<double, 2>{v[0], v[1]};
  values.complain(key, fmt::format("\"{}\" must be two numbers, [x, y]", key));
  return std::nullopt;
}

std::vector<std::array<double, 2>> read_points(Values& values, const std::string& key) {
  std::vector<std::array<double, 2>> points;
  for (const auto& row : values.matrix(key)) {
    if (row.size() != 2) {
      values.complain(key, fmt::format("\"{}\" must be points of two numbers each, [[x, y], [x, y]]", key));
      return {};
    }
    points.push_back({row[0], row[1]});
  }
  return points;
}

/// The body's outline, where that is to tell where the picture is.
std::optional<OutlineRegistration> read_outline(Values& values, const std::string& folder) {
  if (values.text("dic.registration", "given") != "outline") {
    for (const char* key : {"dic.outline", "dic.outline_picture"})
      if (values.has(key))
        values.complain(key, fmt::format("\"{}\" needs \"dic.registration\" = \"outline\"", key));
    return std::nullopt;
  }
  OutlineRegistration outline;
  outline.corners = read_points(values, "dic.outline");
  outline.picture = resolved(folder, values.text("dic.outline_picture", ""));
  if (values.has("dic.outline")) {
    try {
      (void)imaging::polygon_outline(outline.corners);
    } catch (const UsageError& error) {
      values.complain("dic.outline", error.what());
    }
  }
  if (values.has("dic.scale_std") && values.number("dic.scale", 0) > 0)
    outline.scale_std = values.number("dic.scale_std", 0) / values.number("dic.scale", 1);
  return outline;
}

std::optional<imaging::PictureFrame> read_frame(Values& values, bool by_outline) {
  std::optional<imaging::PictureFrame> frame;
  const bool fitted = values.has("dic.pixels") || values.has("dic.points");
  if (fitted && (values.has("dic.scale") || values.has("dic.origin")))
    values.complain("dic.pixels", "\"dic.pixels\" and \"dic.points\" give scale and origin: leave those out");
  if (fitted) {
    const auto pixels = read_points(values, "dic.pixels"), points = read_points(values, "dic.points");
    try {
      frame = imaging::fit_picture_frame(pixels, points, values.number("dic.point_std", 0.5));
    } catch (const UsageError& error) {
      values.complain("dic.pixels", error.what());
    }
  } else if (values.has("dic.scale")) {
    frame = imaging::picture_frame(values.number("dic.scale", 1),
                                   read_pair(values, "dic.origin").value_or(std::array<double, 2>{0, 0}));
    const double std = values.number("dic.scale_std", 0);
    frame->relative_scale_std = std / frame->scale();
    const double angle = values.number("dic.angle", 0) * std::numbers::pi / 180;
    const std::complex<double> turn = std::polar(1.0, angle);
    frame->slope *= turn, frame->offset *= turn;
  } else {
    for (const char* key : {"dic.origin", "dic.angle", "dic.scale_std", "dic.plane", "dic.view"})
      if (values.has(key) &&
          !(by_outline && (key == std::string_view("dic.plane") || key == std::string_view("dic.view"))))
        values.complain(key,
                        fmt::format("\"{}\" needs \"dic.scale\", or \"dic.pixels\" and \"dic.points\"", key));
  }
  return frame;
}

imaging::SeriesOptions read_series(Values& values, const std::string& folder) {
  imaging::SeriesOptions s;
  s.mask = resolved(folder, values.text("dic.mask", ""));
  if (values.has("dic.roi")) {
    const std::vector<double> v = values.numbers("dic.roi");
    if (v.size() == 4 && v[0] != v[2] && v[1] != v[3])
      s.region = imaging::Region{v[0], v[1], v[2], v[3]};
    else
      values.complain("dic.roi", "\"dic.roi\" must be two opposite corners, [x0, y0, x1, y1], px");
  }
  s.element_size = values.number("dic.element_size", s.element_size);
  if (s.element_size < 3)
    values.complain("dic.element_size", "\"dic.element_size\" must be at least 3 px; 16 to 32 are usual");
  s.shape = values.text("dic.shape", "quadrilateral") == "triangle" ? imaging::ElementShape::triangle
                                                                    : imaging::ElementShape::quadrilateral;
  s.noise = values.number("dic.noise", 0);
  s.outline_margin = values.number("dic.outline_margin", s.outline_margin);
  auto& c = s.correlation;
  c.prefilter_sigma = values.number("dic.prefilter", 0);
  c.saturation = values.number("dic.saturation", 0);
  c.regularisation = values.number("dic.regularisation", 0);
  c.regularisation_kind = values.text("dic.regularisation_kind", "tikhonov") == "mechanical"
                              ? imaging::Regularisation::mechanical
                              : imaging::Regularisation::tikhonov;
  c.poisson_ratio = values.number("dic.poisson_ratio", c.poisson_ratio);
  if (!(c.poisson_ratio > -1 && c.poisson_ratio <= 0.5))
    values.complain("dic.poisson_ratio", "\"dic.poisson_ratio\" is above -1 and at most 0.5");
  for (const char* key : {"dic.regularisation_kind", "dic.poisson_ratio"})
    if (values.has(key) && !(c.regularisation > 0))
      values.complain(key, fmt::format("\"{}\" needs \"dic.regularisation\", a wavelength in px", key));
  s.reference_update = values.number("dic.reference_update", 0);
  if (s.reference_update > 0 && s.reference_update < 1)
    values.complain("dic.reference_update",
                    "\"dic.reference_update\" is a factor of the residual, above 1 (2 is usual), or 0");
  if (s.reference_update > 0 && values.text("dic.crack", "off") == "on")
    values.complain("dic.reference_update",
                    "\"dic.reference_update\" does not go together with \"dic.crack\": a crack is measured "
                    "against the reference");
  c.rejection_factor = values.number("dic.rejection_factor", c.rejection_factor);
  c.reject_elements = c.rejection_factor > 0;
  c.tolerance = values.number("dic.tolerance", c.tolerance);
  values.at_least("dic.max_iterations", 1);
  c.max_iterations = static_cast<int>(values.integer("dic.max_iterations", c.max_iterations));
  if (values.text("dic.crack", "off") == "on") {
    imaging::CrackOptions crack;
    crack.gap = values.number("dic.crack_gap", 0), crack.origin = read_pair(values, "dic.crack_origin");
    s.crack = crack;
  } else {
    for (const char* key : {"dic.crack_gap", "dic.crack_origin"})
      if (values.has(key)) values.complain(key, fmt::format("\"{}\" needs \"dic.crack\" = \"on\"", key));
  }
  const std::string drift = values.text("dic.drift", "none");
  s.drift = drift == "shift"   ? imaging::Drift::shift
            : drift == "rigid" ? imaging::Drift::rigid
                               : imaging::Drift::none;
  s.drift_std = values.number("dic.drift_std", s.drift_std);
  const std::string brightness = values.text("dic.brightness", "global");
  c.brightness = brightness == "none"     ? imaging::Brightness::none
                 : brightness == "global" ? imaging::Brightness::global
                                          : imaging::Brightness::per_element;
  return s;
}

}  // namespace

PictureOptions read_pictures(Values& values, const std::string& folder) {
  PictureOptions p;
  p.folder = resolved(folder, values.text("data.pictures", ""));
  if (values.has("data.file") && values.has("data.pictures"))
    values.complain("data.pictures", "[data] has both \"file\" and \"pictures\": give one");
  p.times = values.numbers("data.times");
  for (std::size_t i = 1; i < p.times.size(); ++i)
    if (!(p.times[i] > p.times[i - 1])) {
      values.complain("data.times", "\"data.times\" must increase");
      break;
    }
  const auto names = [&](const char* key) {
    std::vector<std::string> result;
    for (const std::string& name : values.texts(key))
      result.push_back(p.folder.empty() ? resolved(folder, name) : name);
    return result;
  };
  p.references = names("dic.references");
  p.pictures = names("dic.pictures");
  if (!p.folder.empty() && !p.pictures.empty())
    values.complain("dic.pictures", "\"dic.pictures\" and \"data.pictures\" both name pictures: give one");
  p.series = read_series(values, folder);
  p.outline = read_outline(values, folder);
  p.frame = read_frame(values, p.outline.has_value());
  p.view = values.text("dic.view", "side") == "bottom" ? imaging::View::bottom : imaging::View::side;
  p.plane = values.number("dic.plane", 0);
  if (p.frame) p.frame->view = p.view, p.frame->plane = p.plane;
  p.model_mesh = values.text("dic.mesh", "region") == "model";
  const bool registered = p.frame || p.outline;
  if (p.model_mesh && !registered)
    values.complain("dic.mesh",
                    "\"dic.mesh\" = \"model\" needs \"dic.scale\", or \"dic.pixels\" and \"dic.points\", or "
                    "\"dic.registration\" = \"outline\"");
  p.mesh_file = resolved(folder, values.text("dic.mesh_file", ""));
  p.mesh_in_metres = values.text("dic.mesh_unit", "px") == "m";
  if (p.mesh_in_metres && !registered)
    values.complain("dic.mesh_unit",
                    "\"dic.mesh_unit\" = \"m\" needs \"dic.scale\", or \"dic.pixels\" and \"dic.points\", or "
                    "\"dic.registration\" = \"outline\"");
  if (values.has("dic.mesh_unit") && p.mesh_file.empty())
    values.complain("dic.mesh_unit", "\"dic.mesh_unit\" needs \"dic.mesh_file\"");
  if (p.model_mesh && !p.mesh_file.empty())
    values.complain("dic.mesh_file",
                    "\"dic.mesh\" = \"model\" and \"dic.mesh_file\" are two meshes: give one");
  p.plane_given = values.has("dic.plane");
  return p;
}

imaging::SeriesOptions series_options(const Project& project) {
  const PictureOptions& p = project.pictures;
  imaging::SeriesOptions series = p.series;
  if (!p.folder.empty()) {
    imaging::PictureFolder found = imaging::list_pictures(p.folder, p.references);
    series.references = std::move(found.references);
    series.pictures = std::move(found.pictures);
    series.times = std::move(found.times);
  } else {
    if (p.references.empty() || p.pictures.empty())
      throw project.error_at(
          "dic",
          "no pictures: give `[data] pictures = \"FOLDER\"`, or `references` and `pictures` "
          "in [dic]");
    series.references = p.references, series.pictures = p.pictures;
  }
  if (!p.times.empty()) {
    if (p.times.size() != series.pictures.size())
      throw project.error_at("data.times", fmt::format("\"data.times\" has {} times for {} pictures",
                                                       p.times.size(), series.pictures.size()));
    series.times = p.times;
  }
  return series;
}

imaging::SeriesOptions live_series_options(const Project& project) {
  const PictureOptions& p = project.pictures;
  imaging::SeriesOptions series = p.series;
  for (const std::string& name : p.references)
    series.references.push_back(
        p.folder.empty() ? name : (std::filesystem::path(p.folder) / name).lexically_normal().string());
  if (series.references.empty()) series.references = imaging::list_references(project.serve.watch_pictures);
  if (series.references.empty())
    throw project.error_at(
        "serve.watch_pictures",
        fmt::format("{} has no picture whose name begins with `reference`: take one or more of the unloaded "
                    "surface, or name them in [dic] references",
                    project.serve.watch_pictures));
  return series;
}

}  // namespace knothe::project
