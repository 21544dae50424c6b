#include "knothe/project/picture_measurements.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/imaging/camera/calibration_file.hpp"
#include "knothe/imaging/mesh/mesh_file.hpp"
#include "knothe/imaging/series/camera_drift.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/project/picture_options.hpp"
#include "knothe/project/picture_registration.hpp"

namespace knothe::project {
namespace {

constexpr double k_in_plane = 1e-9;  // m

/// Coordinate across the face that a camera sees.
std::size_t across(imaging::View view) {
  return view == imaging::View::side ? 2 : 1;
}

/// The six faces of a hexahedron, VTK's order of vertices.
constexpr std::array<std::array<std::size_t, 4>, 6> k_faces{
    {{0, 1, 2, 3}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}}};

double signed_area(const imaging::ImageMesh& mesh, const std::array<int, 4>& nodes) {
  double area = 0;
  for (std::size_t a = 0; a < 4; ++a) {
    const std::size_t p = nodes[a], q = nodes[(a + 1) % 4];
    area += 0.5 * (mesh.x[p] * mesh.y[q] - mesh.x[q] * mesh.y[p]);
  }
  return area;
}

/// The frame of what the lens has left of the pictures; `plain`: the same without a lens.
imaging::PictureFrame with_lens(const imaging::PictureFrame& plain, const PictureOptions& p) {
  imaging::PictureFrame frame = plain;
  frame.lens = imaging::read_lens(p.lens);
  if (!p.pixels.empty()) {
    std::vector<std::array<double, 2>> straight;
    for (const auto& [x, y] : p.pixels) straight.push_back(frame.without_lens(x, y));
    const imaging::PictureFrame fit = imaging::fit_picture_frame(straight, p.points, p.point_std);
    frame.slope = fit.slope, frame.offset = fit.offset, frame.relative_scale_std = fit.relative_scale_std;
  } else {
    const std::complex<double> origin = -plain.offset / plain.slope;  // x − i y, px
    const auto [x, y] = frame.without_lens(origin.real(), -origin.imag());
    frame.offset = -plain.slope * std::complex<double>(x, -y);
  }
  return frame;
}

}  // namespace

imaging::PictureFrame picture_frame_of(const Project& project, const std::optional<model::Mesh>& mesh) {
  const PictureOptions& p = project.pictures;
  if (!p.frame)
    throw project.error_at("dic",
                           "pictures need a scale to be measurements: \"dic.scale\" and \"dic.origin\", or "
                           "\"dic.pixels\" and \"dic.points\"");
  return with_plane(p.lens.empty() ? *p.frame : with_lens(*p.frame, p), project, mesh);
}

imaging::PictureFrame model_face(const Project& project, const std::optional<model::Mesh>& mesh) {
  imaging::PictureFrame metres;
  metres.view = project.pictures.view, metres.plane = project.pictures.plane.value_or(0);
  return with_plane(metres, project, mesh);
}

imaging::PictureFrame with_plane(imaging::PictureFrame frame, const Project& project,
                                 const std::optional<model::Mesh>& mesh) {
  if (project.pictures.plane || !mesh) return frame;
  const std::size_t axis = across(frame.view);
  const bool largest = frame.view == imaging::View::side;
  frame.plane = mesh->points[axis];
  for (std::size_t i = axis; i < mesh->points.size(); i += 3)
    frame.plane = largest ? std::max(frame.plane, mesh->points[i]) : std::min(frame.plane, mesh->points[i]);
  return frame;
}

imaging::ImageMesh surface_mesh(const model::Mesh& mesh, const imaging::PictureFrame& frame,
                                const Project& project) {
  const std::size_t axis = across(frame.view);
  imaging::ImageMesh face;
  std::map<std::int64_t, int> number;
  if (mesh.nodes_per_cell != 8)
    throw project.error_at("dic.mesh", fmt::format("the model's mesh is of {} cells; a surface mesh is made "
                                                   "of hexahedra only: use \"dic.mesh\" = \"region\"",
                                                   mesh.type));
  for (std::size_t c = 0; c < mesh.cell_count(); ++c)
    for (const auto& vertices : k_faces) {
      std::array<int, 4> nodes{};
      const bool in_plane = std::all_of(vertices.begin(), vertices.end(), [&](std::size_t v) {
        const std::size_t point = mesh.cells[8 * c + v];
        return std::abs(mesh.points[3 * point + axis] - frame.plane) < k_in_plane;
      });
      if (!in_plane) continue;
      for (std::size_t a = 0; a < 4; ++a) {
        const std::int64_t point = mesh.cells[8 * c + vertices[a]];
        const auto [at, is_new] = number.try_emplace(point, face.node_count());
        if (is_new) {
          const double* x = mesh.points.data() + 3 * point;
          const auto pixel = frame.picture_point({x[0], x[1], x[2]});
          face.x.push_back(pixel[0]), face.y.push_back(pixel[1]);
        }
        nodes[a] = at->second;
      }
      if (signed_area(face, nodes) < 0) std::swap(nodes[1], nodes[3]);
      face.elements.push_back(nodes);
    }
  if (face.elements.empty())
    throw project.error_at("dic.plane", fmt::format("no face of the model's mesh lies in the plane {} = {} m",
                                                    axis == 2 ? "z" : "y", frame.plane));
  return face;
}

namespace {
/// The mesh that the project names, if it names one.
std::optional<imaging::ImageMesh> mesh_of(const Project& project, const std::optional<model::Mesh>& mesh) {
  const PictureOptions& p = project.pictures;
  if (!p.mesh_file.empty()) {
    std::optional<imaging::PictureFrame> frame;
    if (p.mesh_in_metres) frame = picture_frame_of(project, mesh);
    return imaging::read_image_mesh(p.mesh_file, frame);
  }
  if (!p.model_mesh) return std::nullopt;
  if (!mesh) throw project.error_at("dic.mesh", "\"dic.mesh\" = \"model\": the model has no mesh");
  return surface_mesh(*mesh, picture_frame_of(project, mesh), project);
}
}  // namespace

imaging::SeriesOptions series_options(const Project& project, const std::optional<model::Mesh>& mesh) {
  imaging::SeriesOptions options = series_options(project);
  options.mesh = mesh_of(project, mesh);
  return options;
}

/// The series of pictures that are there, and γ from the first that can be measured if need be.
void PictureMeasurements::read_series(const Project& project, const model::ModelContents& contents) {
  imaging::SeriesOptions options = series_options(project, contents.mesh);
  if (options.times.empty()) {
    if (options.pictures.size() > contents.time.size())
      throw project.error_at("data",
                             fmt::format("{} pictures, but the model has {} times: give \"data.times\"",
                                         options.pictures.size(), contents.time.size()));
    options.times.assign(contents.time.begin(), contents.time.begin() + std::ssize(options.pictures));
  }
  series_ = std::make_unique<imaging::PictureSeries>(std::move(options));
  gamma_ = series_->known_noise();
  while (!(gamma_ > 0) && !series_->done()) {
    results_.push_back(series_->next());
    gamma_ = results_.back().noise;
  }
  if (!(gamma_ > 0))
    throw DataError(fmt::format("none of the {} pictures could be measured; the first: {}", results_.size(),
                                results_.empty() ? "" : results_.front().message));
}

PictureMeasurements::PictureMeasurements(const Project& given, const model::SeparatedModel& model,
                                         bool live) {
  const auto& contents = model.contents();
  Project project = given;
  if (!project.pictures.cameras.empty())
    throw project.error_at(
        "dic.cameras",
        "pictures of several cameras are measured by `knothe assimilate`, or by `knothe dic FILE.toml -o "
        "u.h5`: then `[data] file = \"u.h5\"` in a project without [dic] cameras");
  registration_ = register_pictures(project, contents.mesh, live);
  frame_ = picture_frame_of(project, contents.mesh);
  if (live && project.pictures.series.reference_update > 0)
    throw project.error_at("dic.reference_update",
                           "\"dic.reference_update\" needs to know how many pictures will share the errors "
                           "of another reference: it is for recorded pictures, not for `serve`");
  if (live) {
    imaging::SeriesOptions options = live_series_options(project);
    options.mesh = mesh_of(project, contents.mesh);
    series_ = std::make_unique<imaging::PictureSeries>(std::move(options));
    gamma_ = series_->known_noise();
    if (!(gamma_ > 0))
      throw project.error_at("dic",
                             "the noise of pictures that are still to come must be known: give "
                             "\"dic.noise\", or two reference pictures or more");
  } else {
    read_series(project, contents);
  }
  measurements_.time = series_->options().times;
  imaging::observation_places(series_->correlation().mesh(), frame_, points_, component_);
  imaging::add_drift_places(series_->options().drift, points_, component_);
  const auto n = std::ssize(component_);
  measurements_.sensors = model::Sensors({points_, component_});
  measurements_.values.setConstant(n, std::ssize(measurements_.time),
                                   std::numeric_limits<double>::quiet_NaN());
  const likelihood::NoiseModel whole =
      noise_of(series_->precision(series_->correlation().usable_elements(), gamma_).matrix);
  measurements_.noise =
      whole.with_shared_reference(series_->reference_count()).with_scale_error(frame_.relative_scale_std);
  correlate_ahead();
}

void PictureMeasurements::correlate_ahead() {
  if (next_ == results_.size() && !series_->done())
    ahead_ = std::async(std::launch::async, [this] { return series_->next(); });
}

likelihood::GaussianNoise PictureMeasurements::noise_of(Eigen::SparseMatrix<double> in_pixels) const {
  Eigen::SparseMatrix<double> precision = frame_.to_model(series_->correlation().mesh(), in_pixels);
  const auto& options = series_->options();
  precision =
      imaging::with_drift(precision, options.drift, points_, component_, options.drift_std * frame_.scale());
  precision.prune(0.0, 0.0);
  return likelihood::GaussianNoise::correlated(precision);
}

PictureDatum PictureMeasurements::next() {
  const auto wait_start = monotonic_now();
  if (ahead_.valid()) results_.push_back(ahead_.get());
  if (next_ == results_.size()) throw UsageError("the pictures of the project are all used");
  const double wait_us = microseconds_since(wait_start);
  PictureDatum datum = as_datum(results_[next_]);
  datum.wait_us = wait_us;
  measurements_.values.col(next_) = datum.values;
  predict_next(datum.picture);
  ++next_;
  correlate_ahead();
  return datum;
}

/// Where the picture after this one begins, by the model: what is measured now and the model's increment, in
/// which most of its error has gone.
void PictureMeasurements::predict_next(const imaging::PictureResult& last) {
  const Eigen::VectorXd increment = std::exchange(increment_, {});
  const Eigen::Index count = last.correlation.displacement.size();
  series_->set_prediction({});  // not that of an earlier picture
  if (last.missing || increment.size() < count || !increment.allFinite()) return;
  series_->set_prediction(last.correlation.displacement +
                          frame_.to_picture(series_->correlation().mesh(), increment.head(count)));
}

PictureDatum PictureMeasurements::measure(const files::Picture& picture, const std::string& name,
                                          Eigen::VectorXd increment) {
  increment_ = std::move(increment);
  series_->set_prediction({});
  if (last_live_) predict_next(*last_live_);
  last_live_.reset();  // what cannot be correlated predicts nothing
  return as_datum(last_live_.emplace(series_->correlate(picture, name)));
}

PictureDatum PictureMeasurements::as_datum(const imaging::PictureResult& picture) {
  PictureDatum datum;
  datum.picture = picture;
  datum.correlation_us = 1e3 * datum.picture.elapsed_ms;
  const auto precision_start = monotonic_now();
  datum.values.setConstant(std::ssize(component_), std::numeric_limits<double>::quiet_NaN());
  datum.values.head(2 * series_->correlation().mesh().node_count()) =
      imaging::observed_values(series_->correlation().mesh(), datum.picture, frame_);
  const auto& valid = datum.picture.correlation.element_valid;
  const bool accumulated = datum.picture.accumulated.has_value();
  if (!datum.picture.missing && (accumulated || valid != series_->correlation().usable_elements())) {
    if (!last_noise_ || last_valid_ != valid || accumulated)
      last_noise_ = noise_of(series_->precision(datum.picture, gamma_).matrix), last_valid_ = valid;
    datum.noise = last_noise_;
  }
  datum.precision_us = microseconds_since(precision_start);
  return datum;
}

}  // namespace knothe::project
