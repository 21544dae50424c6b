#include "knothe/project/field_measurements.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <filesystem>
#include <limits>
#include <numbers>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/data/field_series.hpp"
#include "knothe/model/observe/observation_operator.hpp"
#include "knothe/project/field_steps.hpp"

namespace knothe::project {
namespace {

using Complex = std::complex<double>;
using files::ExportedField;

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();
constexpr double k_max_misfit = 0.02;  // of a registration, relative to its extent
constexpr double k_max_outside = 0.1;  // of the points

/// Whether the project says of a file among the fields that it is something else.
bool is_no_field(const Project& project, const std::string& path) {
  std::vector<std::string> others = {project.fields.reference, project.fields.steps};
  for (const DataSource& source : project.sources) others.push_back(source.file);
  return std::any_of(others.begin(), others.end(), [&](const std::string& other) {
    std::error_code ignored;
    return !other.empty() && std::filesystem::equivalent(path, other, ignored);
  });
}

/// All fields of the project in their common form, those of the body at rest apart.
struct ReadFields {
  std::vector<ExportedField> fields, at_rest;
};

/// A stage of which only positions were exported has no displacement of any point.
void lose_all(ExportedField& field) {
  field.u.assign(field.x.size(), k_nan), field.v = field.u;
}

ReadFields read_all(const Project& project) {
  const FieldOptions& options = project.fields;
  ReadFields all;
  std::vector<ExportedField> fields;
  for (const std::string& path : list_fields(options.files)) {
    if (is_no_field(project, path)) continue;
    for (ExportedField& field : files::read_exported_fields(path, options.mapping))
      fields.push_back(std::move(field));
  }
  if (fields.empty()) throw DataError(options.files + ": no field is there but the reference");
  std::optional<ExportedField> reference;
  if (!options.reference.empty())
    reference = files::read_exported_fields(options.reference, options.mapping).front();
  const bool some_move =
      std::any_of(fields.begin(), fields.end(), [](const ExportedField& f) { return !f.u.empty(); });
  std::set<std::string> at_rest(options.static_fields.begin(), options.static_fields.end());
  for (ExportedField& field : fields) {
    if (!reference && some_move && field.u.empty()) lose_all(field);
    files::settle_field(options.mapping, reference ? &*reference : nullptr, field);
    const bool rests = at_rest.erase(std::filesystem::path(field.path).filename().string()) > 0;
    (rests ? all.at_rest : all.fields).push_back(std::move(field));
  }
  if (!at_rest.empty())
    throw DataError(
        fmt::format("{}: no file {} there (data.fields.static)", options.files, *at_rest.begin()));
  if (all.fields.empty()) throw DataError(options.files + ": all files are those of data.fields.static");
  for (const ExportedField& field : all.fields)
    if (field.displacement_unit != all.fields[0].displacement_unit ||
        field.position_unit != all.fields[0].position_unit)
      throw DataError(fmt::format("{}: it is in {}, {} in {}", field.path, field.displacement_unit,
                                  all.fields[0].path, all.fields[0].displacement_unit));
  return all;
}

/// A place as written in the project, in the common form of `field`: y down, px or mm.
std::array<double, 2> in_common_form(const ExportedField& field, const std::array<double, 2>& place) {
  return {field.position_factor * place[0], (*field.is_up ? -1 : 1) * field.position_factor * place[1]};
}

double coordinate_of_face(const FieldOptions& options, const model::ModelContents& model) {
  if (options.plane) return *options.plane;
  const std::vector<double>& points = model.mesh ? model.mesh->points : model.dofs.points;
  const bool side = options.view == imaging::View::side;
  double plane = points.empty() ? 0 : points[side ? 2 : 1];
  for (std::size_t i = side ? 2 : 1; i < points.size(); i += 3)
    plane = side ? std::max(plane, points[i]) : std::min(plane, points[i]);
  return plane;
}

/// The frame in which the points of the project are where it says in the model; with `scale` (m per unit of
/// the common form) that is kept.
imaging::PictureFrame fitted_frame(const Project& project, const ExportedField& field,
                                   const std::optional<double>& scale) {
  const FieldOptions& o = project.fields;
  const auto fail = [&](const std::string& text) { return project.error_at("data.fields.points", text); };
  // Numbers of pixels' size, for what the fit takes for one place.
  constexpr double k_large = 1e6;
  std::vector<std::array<double, 2>> places;
  std::vector<Complex> at, wanted;
  Complex mean, wanted_mean;
  const double count = o.points.size();
  for (std::size_t k = 0; k < o.points.size(); ++k) {
    const auto place = in_common_form(field, o.points[k]);
    places.push_back({k_large * place[0], k_large * place[1]});
    at.emplace_back(place[0], -place[1]), wanted.emplace_back(o.model_points[k][0], o.model_points[k][1]);
    mean += at.back() / count, wanted_mean += wanted.back() / count;
  }
  imaging::PictureFrame frame;
  try {
    frame = imaging::fit_picture_frame(places, o.model_points, 0.5 * k_large);
  } catch (const UsageError& error) {
    throw fail(error.what());
  }
  frame.slope *= k_large;
  double misfit = 0, extent = 0;
  for (std::size_t k = 0; k < at.size(); ++k) {
    misfit = std::max(misfit, std::abs(frame.slope * at[k] + frame.offset - wanted[k]));
    extent = std::max(extent, std::abs(wanted[k] - wanted_mean));
  }
  if (misfit > k_max_misfit * extent)
    throw fail(
        fmt::format("the points do not fit each other: one is off by {:.3g} m. Their order, or the "
                    "direction of y (data.fields.y)?",
                    misfit));
  if (!scale) return frame;
  if (std::abs(frame.scale() / *scale - 1) > k_max_misfit)
    throw fail(fmt::format(
        "the points are {:.4g} times as far apart in the model as in the field: check the unit ({}) and the "
        "points",
        frame.scale() / *scale, field.position_unit == "px" ? "data.fields.scale" : "data.fields.units"));
  frame.relative_scale_std = 0, frame.slope *= *scale / frame.scale();
  frame.offset = wanted_mean - frame.slope * mean;
  return frame;
}

/// Where the fields are in the model. Lengths keep their scale; of pixels it is given or fitted.
imaging::PictureFrame frame_of(const Project& project, const ExportedField& field,
                               const model::ModelContents& model) {
  const FieldOptions& o = project.fields;
  const bool pixels = field.position_unit == "px";
  const std::optional<double> scale = pixels ? o.scale : std::optional(1e-3);
  if (!pixels && o.scale)
    throw project.error_at("data.fields.scale",
                           fmt::format("\"data.fields.scale\" is of pixels; {} has lengths", field.path));
  if (o.points.empty() && !scale)
    throw project.error_at("data.fields",
                           fmt::format("{} is in pixels: give data.fields.scale, metres per pixel, or points "
                                       "and model_points",
                                       field.path));
  imaging::PictureFrame frame;
  if (o.points.empty()) {
    frame = imaging::picture_frame(*scale, in_common_form(field, *o.origin));
    const Complex turn = std::polar(1.0, o.angle * std::numbers::pi / 180);
    frame.slope *= turn, frame.offset *= turn;
  } else {
    frame = fitted_frame(project, field, scale);
  }
  frame.view = o.view, frame.plane = coordinate_of_face(o, model);
  frame.relative_scale_std = std::hypot(frame.relative_scale_std, o.relative_scale_std);
  return frame;
}

bool is_inside(const std::array<double, 4>& region, double right, double up) {
  const auto [left, right_end] = std::minmax(region[0], region[2]);
  const auto [low, high] = std::minmax(region[1], region[3]);
  return right >= left && right <= right_end && up >= low && up <= high;
}

/// Where a series' points are in the model, NaN for those that are not used: outside the region, or outside
/// the mesh, as those are whose subset or triangle reaches over an edge of the specimen.
struct Places {
  Eigen::Matrix3Xd points;
  Index outside = 0;  ///< the mesh
};

Places places_of(const FieldOptions& o, const likelihood::FieldSeries& series,
                 const imaging::PictureFrame& frame, const std::optional<model::Mesh>& mesh) {
  Places places{Eigen::Matrix3Xd(3, std::ssize(series.points))};
  Eigen::Matrix3Xd& points = places.points;
  for (Index i = 0; i < points.cols(); ++i) {
    const auto at = frame.model_point(series.points[i][0], series.points[i][1]);
    const bool used = !o.region || is_inside(*o.region, at[0], at[frame.components()[1]]);
    points.col(i) = used ? Eigen::Vector3d(at[0], at[1], at[2]) : Eigen::Vector3d::Constant(k_nan);
  }
  const Index wanted = points.cols() - points.row(0).array().isNaN().count();
  if (wanted == 0)
    throw DataError(
        fmt::format("{}: {}", o.files,
                    series.points.empty() ? "all points are lost" : "no point is in data.fields.region"));
  if (!mesh) return places;
  const std::vector<bool> inside = model::are_inside(*mesh, {points.data(), std::size_t(points.size())});
  for (Index i = 0; i < points.cols(); ++i) {
    if (inside[i] || std::isnan(points(0, i))) continue;
    points.col(i).setConstant(k_nan);
    ++places.outside;
  }
  if (double(places.outside) > k_max_outside * double(wanted))
    throw DataError(fmt::format(
        "{}: {} of {} points lie outside the model's mesh: check data.fields.points and model_points (or "
        "origin, angle, y), or give the part that is in the model as data.fields.region",
        o.files, places.outside, wanted));
  return places;
}

/// Displacements of the points in the model, x then y of each.
void place_points(const likelihood::FieldSeries& series, const Eigen::Matrix3Xd& places,
                  const imaging::PictureFrame& frame, double displacement_scale,
                  likelihood::Measurements& m) {
  std::vector<Index> used;
  for (Index i = 0; i < places.cols(); ++i) {
    if (std::isnan(places(0, i))) continue;
    used.push_back(i);
    for (const int component : frame.components())
      m.sensors.add(std::array{places(0, i), places(1, i), places(2, i)}, component);
  }
  m.values.resize(2 * std::ssize(used), series.u.cols());
  const Eigen::Matrix2d turn = frame.displacement_matrix() / frame.scale() * displacement_scale;
  for (Index k = 0; k < std::ssize(used); ++k)
    for (Index t = 0; t < series.u.cols(); ++t)
      m.values.block<2, 1>(2 * k, t) = turn * Eigen::Vector2d(series.u(used[k], t), series.v(used[k], t));
}

void add_stated_series(const Project& project, const std::vector<ExportedField>& fields,
                       likelihood::Measurements& m) {
  for (const auto& [name, column] : project.fields.series) {
    likelihood::MeasuredSeries& series = m.series[name];
    bool is_there = false;
    std::set<std::string> others;
    for (const ExportedField& field : fields) {
      const auto found = field.scalars.find(column);
      is_there = is_there || found != field.scalars.end();
      series.values.push_back(found == field.scalars.end() ? k_nan : found->second);
      for (const auto& [other, value] : field.scalars) others.insert(other);
    }
    if (!is_there)
      throw project.error_at(
          "data.fields.series." + name,
          fmt::format("neither the fields nor data.fields.steps state \"{}\"; they state {}", column,
                      others.empty() ? "none" : fmt::format("{}", fmt::join(others, ", "))));
  }
}

}  // namespace

FieldMeasurements measure_fields(const Project& project, const model::ModelContents& model) {
  const FieldOptions& o = project.fields;
  ReadFields all = read_all(project);
  FieldMeasurements result;
  tell_times(o, model.time, all.fields);
  likelihood::Measurements& m = result.measurements;
  for (const ExportedField& field : all.fields) {
    m.time.push_back(*field.time);
    result.read.push_back(fmt::format("{}: {}, time {}", field.path, field.found, *field.time));
  }
  const ExportedField& first = all.fields.front();
  const imaging::PictureFrame frame = frame_of(project, first, model);
  // Displacements in mm beside positions in pixels have a scale of their own.
  const double displacement_scale = first.displacement_unit == "px" ? frame.scale() : 1e-3;
  likelihood::FieldSeries series = likelihood::join_fields(all.fields);
  const std::size_t all_points = series.points.size();
  const Index outliers = o.outliers > 0 ? likelihood::lose_outliers(o.outliers, series) : 0;
  series = likelihood::thinned(series, o.min_distance / frame.scale());
  const Places places = places_of(o, series, frame, model.mesh);
  place_points(series, places.points, frame, displacement_scale, m);
  const auto tell = [&](const char* what, Index count) {
    if (count > 0)
      result.read.push_back(
          fmt::format("{}: not used, as {}: {} of {} points", o.files, what, count, all_points));
  };
  tell("they stand out from their neighbours", outliers);
  tell("they lie outside the model's mesh", places.outside);
  const double std = o.std ? *o.std : displacement_scale * likelihood::static_std(all.at_rest);
  m.noise = likelihood::NoiseModel::independent(Eigen::VectorXd::Constant(m.values.rows(), std));
  if (first.displacement_unit == "px" || o.relative_scale_std > 0)
    m.noise = m.noise.with_scale_error(frame.relative_scale_std);
  add_stated_series(project, all.fields, m);
  return result;
}

likelihood::NoiseModel with_motion(const FieldOptions& fields, const likelihood::Measurements& m) {
  const double shift = fields.motion_std[0], turn = fields.motion_std[1] * std::numbers::pi / 180,
               towards = fields.motion_std[2];
  if (!(shift > 0 || turn > 0 || towards > 0)) return m.noise;
  const Index n = std::ssize(m.sensors.components);
  const int up = fields.view == imaging::View::side ? 1 : 2;
  const Eigen::Map<const Eigen::Matrix3Xd> points(m.sensors.points.data(), 3, n);
  const Eigen::Vector3d middle = points.rowwise().mean();
  Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(m.noise.size(), 4);
  for (Index i = 0; i < n; ++i) {
    const Eigen::Vector3d arm = points.col(i) - middle;
    const bool along = m.sensors.components[i] == 0;
    factor(i, along ? 0 : 1) = shift;
    factor(i, 2) = turn * (along ? -arm[up] : arm[0]);
    factor(i, 3) = towards * (along ? arm[0] : arm[up]);
  }
  likelihood::NoiseModel noise = m.noise;
  for (std::size_t t = 0; t < m.time.size(); ++t) noise = noise.with_step_error(t, factor);
  return noise;
}

}  // namespace knothe::project
