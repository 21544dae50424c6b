#include "knothe/project/picture_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/imaging/mesh/outline_registration.hpp"
#include "knothe/imaging/series/picture_folder.hpp"
#include "knothe/imaging/series/series_names.hpp"
#include "knothe/project/option_section.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {
namespace {

using Pair = std::array<double, 2>;

/// What the file says; a PictureOptions is made of it.
struct Given : PictureOptions {
  bool by_outline = false, look_for_crack = false, cameras_in_metres = false;
  std::array<double, 4> roi{};
  imaging::CrackSearchOptions crack;
  OutlineRegistration fit;
  std::optional<double> scale;
  double scale_std = 0, angle = 0;
  Pair origin{0, 0};
};

using G = Given;
using Series = imaging::SeriesOptions;
using Correlation = imaging::CorrelationOptions;

constexpr const char* k_pair = "two numbers, [x, y]";
constexpr const char* k_points = "points of two numbers each, [[x, y], [x, y]]";

void add_picture_options(Section<G>& s) {
  s.add("references", &G::references,
        "Pictures of the unloaded surface; several are averaged, and the noise is estimated from their "
        "differences.");
  s.add("pictures", &G::pictures, "Deformed pictures, if there is no `[data] pictures`.");
  s.add("mask", in(&G::series, &Series::mask), "Picture that is 0 where the surface is not to be measured.",
        file);
  s.add("roi", &G::roi,
        "Two opposite corners of the mesh, [x0, y0, x1, y1], px, inclusive; default: the mask's, or the "
        "largest rectangle with a pattern, or all but a margin of 10 px.",
        of_shape("two opposite corners, [x0, y0, x1, y1], px"), no_default);
  s.choice("mesh", &G::model_mesh, "region", "model",
           "Elements over the region, or the model's own surface mesh (needs the model and a scale).");
  s.add("mesh_file", &G::mesh_file,
        "Mesh of linear triangles and quadrilaterals to correlate on: Gmsh (.msh, ASCII, 4.1 or 2.2) or VTK "
        "(.vtu).",
        file);
  s.choice("mesh_unit", &G::mesh_in_metres, "px", "m",
           "Unit of that file: pixels of the reference picture (y down), or metres in the model's frame "
           "(needs a scale).");
  s.add("outline_margin", in(&G::series, &Series::outline_margin),
        "Width of the band along the outline of such a mesh that is not used: it shows the body's edge, px.",
        non_negative);
  s.add("element_size", in(&G::series, &Series::element_size),
        "Size of the elements, px; adjusted to divide the region.", positive,
        check([](double v) { return v >= 3; }, "\"{}\" must be at least 3 px; 16 to 32 are usual"));
  s.add("shape", in(&G::series, &Series::shape), "Shape of the elements.");
}

void add_correlation_options(Section<G>& s) {
  const auto correlation = [](auto member) { return in(&G::series, &Series::correlation, member); };
  s.add("prefilter", correlation(&Correlation::prefilter_sigma),
        "Standard deviation of a Gaussian on all pictures, px; default: 1 where speckles of the reference "
        "are smaller than 3 px (aliased), else 0.",
        non_negative, no_default);
  s.add("colour", in(&G::series, &Series::colour),
        "What is done with a colour picture: it is refused, or its luminance is used (`grey`).");
  s.add("brightness", correlation(&Correlation::brightness),
        "Brightness and contrast that may change from picture to picture.");
  s.add("saturation", correlation(&Correlation::saturation),
        "Grey level from which a pixel is masked; 0: the largest that the picture can hold.", non_negative);
  s.add("noise", in(&G::series, &Series::noise),
        "Standard deviation of a picture's noise, grey levels; 0: from repeated references, or the residual.",
        non_negative);
  s.add("regularisation", correlation(&Correlation::regularisation),
        "Regularisation of the displacement: its cut-off wavelength, px; 0 for none.", non_negative);
  s.add("regularisation_kind", correlation(&Correlation::regularisation_kind),
        "What is regularised: the gradient, or the forces that are missing for equilibrium of an elastic "
        "sheet (elastic fields pass unchanged).");
  s.add("poisson_ratio", correlation(&Correlation::poisson_ratio),
        "Poisson's ratio of that sheet, −1 to 0.5.",
        check([](double v) { return v > -1 && v <= 0.5; }, "\"{}\" is above -1 and at most 0.5"));
  s.add("reference_update", in(&G::series, &Series::reference_update),
        "A picture that does not converge, or whose residual exceeds this multiple of the first one's (2 is "
        "usual), is measured against the last good picture, which becomes the reference; 0: never.",
        non_negative,
        check([](double v) { return v == 0 || v >= 1; },
              "\"{}\" is a factor of the residual, above 1 (2 is usual), or 0"));
  s.add("rejection_factor", correlation(&Correlation::rejection_factor),
        "Elements whose residual exceeds this multiple of the median are rejected (cracks); 0: never.",
        non_negative);
  s.add("tolerance", correlation(&Correlation::tolerance),
        "Largest change of a displacement at convergence, px.", positive);
  s.add("max_iterations", correlation(&Correlation::max_iterations),
        "Maximum number of iterations per picture.", at_least(1));
}

void add_crack_and_drift_options(Section<G>& s) {
  s.choice("crack", &G::look_for_crack, "off", "on", "Path, opening and tip of a crack in every picture.");
  s.add("crack_gap", in(&G::crack, &imaging::CrackSearchOptions::gap),
        "Width on either side of the crack that is not used, px; 0: 3 px, on the model's mesh half an "
        "element and 2 px.",
        non_negative);
  s.add("crack_origin", in(&G::crack, &imaging::CrackSearchOptions::origin),
        "Pixel from which the crack's length counts, [x, y], e.g. the notch's end; default: where it enters "
        "the mesh.",
        of_shape(k_pair));
  s.add("drift", in(&G::series, &Series::drift),
        "Motion of the camera relative to the body, separate for each picture, that the likelihood leaves "
        "out: a shift, or a shift and a rotation (rigid).");
  s.add("drift_std", in(&G::series, &Series::drift_std),
        "Prior standard deviation of such a motion, px; a large one carries no information.", positive);
}

void add_camera_options(Section<G>& s) {
  s.add("cameras", &G::cameras,
        "Calibration of two or more cameras: OpenCV's (.yaml, .xml: M1, D1, M2, D2, R, T), DICe's (.xml) or "
        "MatchID's (.caldat). Displacements are then in metres, three components, in its frame, or with "
        "`pixels` and `points` in the model's.",
        file);
  s.choice("camera_unit", &G::cameras_in_metres, "mm", "m", "Unit of length of the calibration.");
  s.add("calibration_std", &G::calibration_std,
        "Uncertainty of the calibration, an error that all pictures share: CSV with a row for each parameter "
        "that is not exact (`parameter`: camera0.fx, …) and its `std`, or a column for each: the covariance.",
        file);
  s.add("other_pictures", &G::other_folders,
        "Folders of the further cameras' pictures, in the calibration's order; as many pictures as in "
        "`[data] pictures`, which holds the first camera's.");
}

void add_registration_options(Section<G>& s) {
  s.choice(
      "registration", &G::by_outline, "given", "outline",
      "Position of the picture in the model: by scale and origin or by pixels and points; or fitted to the "
      "body's outline, from these values (without them the whole body must be in view).");
  s.add("outline", in(&G::fit, &OutlineRegistration::corners),
        "Corners of the body's face, [[right, up], …], m, one after the other; default: the model's face.",
        of_shape(k_points));
  s.add(
      "outline_picture", in(&G::fit, &OutlineRegistration::picture),
      "Picture in which the outline is searched for, e.g. a mask of the body; default: the first reference.",
      file);
  s.add("scale", &G::scale, "Metres per pixel: displacements are then in metres, in the model's frame.",
        positive);
  s.add("scale_std", &G::scale_std,
        "Standard deviation of the scale, metres per pixel; with an outline, the scale counts as a "
        "measurement with this standard deviation.",
        non_negative);
  s.add("origin", &G::origin, "Pixel at which the model's origin appears, [x, y].", of_shape(k_pair));
  s.add("angle", &G::angle, "Angle by which the picture is rotated relative to the model, degrees.");
  s.add("pixels", &G::pixels,
        "Instead of scale, origin and angle: points found in the (first camera's) reference picture, "
        "[[x, y], …], px …",
        of_shape(k_points));
  s.add("points", &G::points, "… and where they are on the model's face, [[right, up], …], m.",
        of_shape(k_points));
  s.add("point_std", &G::point_std, "Standard deviation of such a point, px.", positive);
  s.add("lens", &G::lens,
        "Calibration of the one camera, whose distortion is taken out: of OpenCV or DICe (docs/how-to/"
        "calibrate.md). Needs a scale or points.",
        file);
  s.add("view", &G::view,
        "Face that the camera sees: side (right is x, up is y), bottom (right is x, up is z).");
  s.add("plane", &G::plane,
        "Constant coordinate of that face, m; default: the model's outermost, or 0 without a model.");
}

const Section<G>& dic_section() {
  static const Section<G> k_section(
      "dic", "Displacements from pictures: global finite-element image correlation.", [](Section<G>& s) {
        add_picture_options(s);
        add_correlation_options(s);
        add_crack_and_drift_options(s);
        add_camera_options(s);
        add_registration_options(s);
      });
  return k_section;
}

struct Recorded {
  std::string folder;
  std::vector<double> times;
};

const Section<Recorded>& data_section() {
  static const Section<Recorded> k_section("data", "", [](Section<Recorded>& s) {
    s.add("pictures", &Recorded::folder,
          "Folder of pictures, or TIFF with a picture a page, alone or with the series of `data.file`; "
          "those whose names begin with `reference` are the references, else the first is; a table "
          "`pictures.csv` (`time,file`) in it gives the times.",
          file);
    s.add("times", &Recorded::times, "Model time of each deformed picture.");
  });
  return k_section;
}

/// Complains of each of the keys that is given.
void refuse(Values& values, const std::vector<const char*>& keys, const char* needs) {
  for (const char* key : keys)
    if (values.has(key)) values.complain(key, fmt::format("\"{}\" needs {}", key, needs));
}

constexpr const char* k_needs_scale = "\"dic.scale\", or \"dic.pixels\" and \"dic.points\"";
constexpr const char* k_needs_place =
    "\"dic.scale\", or \"dic.pixels\" and \"dic.points\", or \"dic.registration\" = \"outline\"";

/// The body's outline, where that is to tell where the picture is.
std::optional<OutlineRegistration> outline_of(Values& values, const Given& g) {
  if (!g.by_outline) {
    refuse(values, {"dic.outline", "dic.outline_picture"}, "\"dic.registration\" = \"outline\"");
    return std::nullopt;
  }
  OutlineRegistration outline = g.fit;
  if (values.has("dic.outline")) {
    try {
      (void)imaging::polygon_outline(outline.corners);
    } catch (const UsageError& error) {
      values.complain("dic.outline", error.what());
    }
  }
  if (g.scale) outline.scale_std = g.scale_std / *g.scale;
  return outline;
}

std::optional<imaging::PictureFrame> frame_of(Values& values, const Given& g) {
  std::optional<imaging::PictureFrame> frame;
  if (!g.cameras.empty()) return frame;
  const bool fitted = values.has("dic.pixels") || values.has("dic.points");
  if (fitted && (g.scale || values.has("dic.origin")))
    values.complain("dic.pixels", "\"dic.pixels\" and \"dic.points\" give scale and origin: leave those out");
  if (fitted) {
    try {
      frame = imaging::fit_picture_frame(g.pixels, g.points, g.point_std);
    } catch (const UsageError& error) {
      values.complain("dic.pixels", error.what());
    }
  } else if (g.scale) {
    frame = imaging::picture_frame(*g.scale, g.origin);
    frame->relative_scale_std = g.scale_std / frame->scale();
    const std::complex<double> turn = std::polar(1.0, g.angle * std::numbers::pi / 180);
    frame->slope *= turn, frame->offset *= turn;
  } else {
    refuse(values, {"dic.origin", "dic.angle", "dic.scale_std"}, k_needs_scale);
    if (!g.by_outline) refuse(values, {"dic.plane", "dic.view"}, k_needs_scale);
  }
  if (!frame || g.by_outline) refuse(values, {"dic.lens"}, k_needs_scale);
  if (frame) frame->view = g.view, frame->plane = g.plane.value_or(0);
  return frame;
}

/// What follows from the options for the series, and what does not go together in them.
void complete_series(Values& values, Given& g) {
  Series& s = g.series;
  s.find_prefilter = !values.has("dic.prefilter");
  if (values.has("dic.roi")) {
    const auto& [x0, y0, x1, y1] = g.roi;
    s.region = imaging::Region{x0, y0, x1, y1};
    if (x0 == x1 || y0 == y1)
      values.complain("dic.roi", "\"dic.roi\" must be two opposite corners, [x0, y0, x1, y1], px");
  }
  if (!(s.correlation.regularisation > 0))
    refuse(values, {"dic.regularisation_kind", "dic.poisson_ratio"},
           "\"dic.regularisation\", a wavelength in px");
  s.correlation.reject_elements = s.correlation.rejection_factor > 0;
  if (!g.look_for_crack)
    return refuse(values, {"dic.crack_gap", "dic.crack_origin"}, "\"dic.crack\" = \"on\"");
  s.crack = g.crack;
  if (s.reference_update > 0)
    values.complain("dic.reference_update",
                    "\"dic.reference_update\" cannot be combined with \"dic.crack\": a crack is measured "
                    "against the reference");
}

/// Several cameras, and what they do not go together with.
void complete_cameras(Values& values, Given& g) {
  g.camera_unit = g.cameras_in_metres ? 1 : 1e-3;
  for (std::string& folder : g.other_folders) folder = values.resolved(folder);
  if (g.cameras.empty())
    return refuse(values, {"dic.camera_unit", "dic.calibration_std", "dic.other_pictures"},
                  "\"dic.cameras\", a calibration");
  for (const char* key :
       {"dic.scale", "dic.scale_std", "dic.origin", "dic.angle", "dic.registration", "dic.lens", "dic.crack",
        "dic.drift", "dic.mesh_file", "dic.reference_update", "dic.regularisation"})
    if (values.has(key))
      values.complain(key, fmt::format("\"{}\" is for one camera: leave it out with \"dic.cameras\"", key));
  if (g.folder.empty() || g.other_folders.empty())
    values.complain("dic.cameras",
                    "\"dic.cameras\" needs `[data] pictures`, the folder of the first camera, "
                    "and \"dic.other_pictures\", those of the others");
}

void check_meshes(Values& values, const PictureOptions& p) {
  const bool registered = p.frame || p.outline || !p.cameras.empty();
  const auto refuse_unless = [&](bool holds, const char* key, const std::string& text) {
    if (!holds) values.complain(key, text);
  };
  refuse_unless(registered || !p.model_mesh, "dic.mesh",
                std::string("\"dic.mesh\" = \"model\" needs ") + k_needs_place);
  refuse_unless(registered || !p.mesh_in_metres, "dic.mesh_unit",
                std::string("\"dic.mesh_unit\" = \"m\" needs ") + k_needs_place);
  refuse_unless(!values.has("dic.mesh_unit") || !p.mesh_file.empty(), "dic.mesh_unit",
                "\"dic.mesh_unit\" needs \"dic.mesh_file\"");
  refuse_unless(!p.model_mesh || p.mesh_file.empty(), "dic.mesh_file",
                "\"dic.mesh\" = \"model\" and \"dic.mesh_file\" are two meshes: give one");
}

}  // namespace

std::vector<Option> picture_option_table() {
  return joined(data_section(), dic_section());
}

PictureOptions read_pictures(Values& values) {
  Recorded recorded = data_section().read(values);
  Given p = dic_section().read(values);
  p.folder = std::move(recorded.folder), p.times = std::move(recorded.times);
  if (std::adjacent_find(p.times.begin(), p.times.end(), std::greater_equal<>()) != p.times.end())
    values.complain("data.times", "\"data.times\" must increase");
  if (p.folder.empty()) {
    for (auto* names : {&p.references, &p.pictures})
      for (std::string& name : *names) name = values.resolved(name);
  } else if (!p.pictures.empty()) {
    values.complain("dic.pictures", "\"dic.pictures\" and \"data.pictures\" both name pictures: give one");
  }
  complete_series(values, p);
  complete_cameras(values, p);
  p.outline = outline_of(values, p);
  p.frame = frame_of(values, p);
  check_meshes(values, p);
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
          "dic", "no pictures: give `[data] pictures = \"FOLDER\"`, or `references` and `pictures` in [dic]");
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

std::vector<imaging::SeriesOptions> camera_series_options(const Project& project) {
  std::vector<imaging::SeriesOptions> cameras{series_options(project)};
  for (const std::string& folder : project.pictures.other_folders) {
    imaging::PictureFolder found = imaging::list_pictures(folder, project.pictures.references);
    imaging::SeriesOptions series = cameras.front();
    series.references = std::move(found.references), series.pictures = std::move(found.pictures);
    cameras.push_back(std::move(series));
  }
  return cameras;
}

imaging::SeriesOptions live_series_options(const Project& project) {
  const PictureOptions& p = project.pictures;
  imaging::SeriesOptions series = p.series;
  for (const std::string& name : p.references)
    series.references.push_back(
        p.folder.empty() ? name : (std::filesystem::path(p.folder) / name).lexically_normal().string());
  const std::string& folder = project.serve.picture_folder();
  if (series.references.empty()) series.references = imaging::list_references(folder);
  if (series.references.empty())
    throw project.error_at(
        project.serve.camera.wanted ? "serve.camera" : "serve.watch_pictures",
        fmt::format("{} no picture whose name begins with `reference`: take one or more of the unloaded "
                    "surface, or name them in [dic] references",
                    folder.empty() ? "[serve.camera] keeps no frames, and there is" : folder + " has"));
  return series;
}

}  // namespace knothe::project
