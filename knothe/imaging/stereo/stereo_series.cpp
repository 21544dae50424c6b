#include "knothe/imaging/stereo/stereo_series.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/imaging/camera/calibration_file.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"

namespace knothe::imaging {
namespace {

void check_stereo(const StereoOptions& options) {
  if (options.series.size() < 2 || options.series.size() != options.cameras.size())
    throw UsageError(fmt::format(
        "the calibration has {} cameras, and there are pictures of {}: give the pictures of each camera",
        options.cameras.size(), options.series.size()));
  for (const SeriesOptions& s : options.series) {
    if (s.pictures.size() != options.series.front().pictures.size())
      throw UsageError(fmt::format("{} pictures of one camera and {} of another: one of each at every time",
                                   options.series.front().pictures.size(), s.pictures.size()));
    if (s.crack || s.drift != Drift::none || s.reference_update > 0 || s.correlation.regularisation > 0)
      throw UsageError(
          "crack, drift, reference_update and regularisation are for one camera: leave them out with "
          "cameras");
  }
}

/// The reference of one camera: the mean, if there are several.
files::Picture reference_of(const SeriesOptions& options) {
  std::vector<files::Picture> pictures;
  for (const std::string& name : options.references)
    pictures.push_back(files::read_picture(name, options.colour));
  return averaged(pictures, options.references);
}

/// The first camera's mesh and settings, before the shape is known.
PictureSeries first_look(SeriesOptions options) {
  options.pictures.clear(), options.times.clear();
  return PictureSeries(std::move(options));
}

/// Of the nodes that are left of a mesh, which have kept their places in the picture, where `nodes` says.
SurfacePoints known_places(const ImageMesh& left, const ImageMesh& mesh, const SurfacePoints& nodes) {
  std::map<std::array<double, 2>, Index> at;
  for (Index a = 0; a < nodes.cols(); ++a) at[{mesh.x[a], mesh.y[a]}] = a;
  SurfacePoints places(3, left.node_count());
  for (Index a = 0; a < places.cols(); ++a) places.col(a) = nodes.col(at.at({left.x[a], left.y[a]}));
  return places;
}

}  // namespace

StereoOptions cameras_in_metres(const std::string& path, double unit, const std::string& error) {
  StereoOptions options;
  options.cameras = read_cameras(path);
  for (Camera& camera : options.cameras) camera.translation *= unit;
  if (!error.empty()) options.calibration = read_calibration_error(error, std::ssize(options.cameras), unit);
  return options;
}

StereoSeries::StereoSeries(StereoOptions options) : options_(std::move(options)) {
  check_stereo(options_);
  {
    const PictureSeries first = first_look(options_.series.front());
    std::vector<files::Picture> references{first.correlation().reference()};
    for (auto s = options_.series.begin() + 1; s != options_.series.end(); ++s)
      references.push_back(reference_of(*s));
    ImageMesh mesh = first.correlation().mesh();
    if (!first.options().mask.empty()) mesh = masked(mesh, read_mask(first.options().mask), 1);
    surface_ = find_surface(options_.cameras, references, mesh, first.options().correlation,
                            options_.epipolar_bound);
    if (options_.nodes)
      surface_.points = known_places(surface_.meshes.front(), *options_.series.front().mesh, *options_.nodes);
    first_remarks_ = first.remarks();
  }
  for (Index c = 0; c < std::ssize(options_.series); ++c) {
    SeriesOptions s = options_.series[c];
    if (!options_.series.front().mesh) s.outline_margin = 0;
    s.mesh = surface_.meshes[c], s.region.reset(), s.mask.clear();
    series_.push_back(std::make_unique<PictureSeries>(std::move(s)));
    if (series_.back()->correlation().mesh().node_count() != surface_.points.cols())
      throw UsageError(fmt::format(
          "camera {} sees only a part of the region: choose \"roi\" or a mask where all views overlap", c));
  }
}

StereoResult StereoSeries::next() {
  std::vector<PictureResult> pictures;
  for (const auto& series : series_) pictures.push_back(series->next());
  return combined(std::move(pictures));
}

std::vector<StereoResult> StereoSeries::resume(const std::vector<std::vector<PictureResult>>& measured) {
  std::vector<StereoResult> results;
  for (Index t = 0; t < std::ssize(measured.front()); ++t) {
    std::vector<PictureResult> pictures;
    for (const auto& of_camera : measured) pictures.push_back(of_camera[t]);
    results.push_back(combined(std::move(pictures)));
  }
  for (Index c = 0; c < std::ssize(series_); ++c) {
    CorrelationResult last;
    for (const PictureResult& picture : measured[c])
      if (!picture.missing) last = picture.correlation;
    series_[c]->resume(results.size(), last);
  }
  return results;
}

StereoResult StereoSeries::combined(std::vector<PictureResult> pictures) const {
  StereoResult result;
  result.pictures = std::move(pictures);
  std::vector<double> gamma;
  for (const PictureResult& picture : result.pictures) {
    result.index = picture.index, result.elapsed_ms += picture.elapsed_ms;
    gamma.push_back(picture.noise);
    if (picture.missing && !result.missing) result.missing = true, result.message = picture.message;
  }
  if (result.missing) return result;
  const auto start = std::chrono::steady_clock::now();
  try {
    const std::vector<CameraMotion> seen = motions(result, gamma);
    result.motion = surface_motion(options_.cameras, surface_, seen);
    result.calibration = Eigen::MatrixXd::Zero(3 * surface_.points.cols(), 0);
    if (!options_.calibration.names.empty())
      result.calibration = calibration_sensitivity(options_.cameras, surface_, seen, result.motion) *
                           options_.calibration.factor;
    if (!(result.motion.epipolar_rms <= options_.epipolar_bound)) {
      result.message = fmt::format(
          "{}: the cameras' displacements contradict each other by {:.3g} px (root mean square): were the "
          "pictures taken at the same time, and did no camera move?",
          result.pictures.front().picture, result.motion.epipolar_rms);
      result.missing = true, result.motion = {};
    }
  } catch (const Error& error) {
    result.missing = true;
    result.message = fmt::format("{}: {}", result.pictures.front().picture, error.what());
  }
  result.elapsed_ms +=
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return result;
}

std::vector<CameraMotion> StereoSeries::motions(const StereoResult& result,
                                                const std::vector<double>& gamma) const {
  std::vector<CameraMotion> motions;
  for (Index c = 0; c < std::ssize(series_); ++c) {
    const CorrelationResult& r = result.pictures[c].correlation;
    motions.push_back({r.displacement, series_[c]->precision(r.element_valid, gamma[c], r.gain).matrix,
                       measured_nodes(surface_.meshes[c], r.element_valid)});
  }
  return motions;
}

Eigen::SparseMatrix<double> StereoSeries::precision(const StereoResult& result,
                                                    const std::vector<double>& gamma) const {
  return surface_motion(options_.cameras, surface_, motions(result, gamma)).precision;
}

std::vector<std::string> StereoSeries::remarks() const {
  std::vector<std::string> remarks = first_remarks_;
  for (Index c = 0; c < std::ssize(series_); ++c)
    for (const std::string& text : series_[c]->remarks())
      if (c > 0 || std::find(remarks.begin(), remarks.end(), text) == remarks.end())
        remarks.push_back(fmt::format("camera {}: {}", c, text));
  return remarks;
}

std::vector<char> StereoSeries::valid_elements(const StereoResult& result) const {
  std::vector<char> valid(surface_.meshes.front().elements.size(), result.missing ? 0 : 1);
  for (const PictureResult& picture : result.pictures)
    for (Index e = 0; e < std::ssize(valid) && !result.missing; ++e)
      valid[e] &= picture.correlation.element_valid[e];
  return valid;
}

}  // namespace knothe::imaging
