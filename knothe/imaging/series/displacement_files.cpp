#include "knothe/imaging/series/displacement_files.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/vtu.hpp"
#include "knothe/imaging/crack/strain.hpp"
#include "knothe/imaging/series/camera_drift.hpp"
#include "knothe/numerics/linear/selected_inverse.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::imaging {

namespace {

using Sparse = Eigen::SparseMatrix<double>;
constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

/// The inverse covariance of the values in a file: of a picture with every usable element, and of each
/// picture whose valid elements are others, in which rows of dofs that were not measured are empty. One
/// matrix at a time: they are larger than everything else in the file.
void write_precisions(files::Hdf5Writer& file, const PictureSeries& series,
                      const std::vector<PictureResult>& results, const std::optional<PictureFrame>& frame,
                      const std::vector<double>& points, const std::vector<std::int64_t>& component) {
  const SeriesOptions& options = series.options();
  const std::string units = frame ? "1/m2" : "1/px2";
  const double noise = std::max(k_quantisation_noise, series_noise(series, results));
  const auto precision_of = [&](const auto& picture) {
    const Sparse in_pixels = series.precision(picture, noise).matrix;
    return with_drift(frame ? frame->to_model(series.correlation().mesh(), in_pixels) : in_pixels,
                      options.drift, points, component, options.drift_std * (frame ? frame->scale() : 1));
  };
  const std::vector<char>& usable = series.correlation().usable_elements();
  write_symmetric(file, "/noise/precision", precision_of(usable), units);
  file.integer_attribute("/noise/precision", "shared_reference", series.reference_count());
  file.number_attribute("/noise/precision", "noise_grey_levels", noise);
  if (frame && frame->relative_scale_std > 0)
    file.number_attribute("/noise/precision", "relative_scale_std", frame->relative_scale_std);
  // The last rows are the camera's motions, never measured: see camera_drift.hpp.
  if (options.drift != Drift::none)
    file.integer_attribute("/noise/precision", "drift_modes", drift_modes(options.drift));
  Sparse last;
  const std::vector<char>* last_valid = nullptr;
  for (Index t = 0; t < std::ssize(results); ++t) {
    const std::vector<char>& valid = results[t].correlation.element_valid;
    const bool accumulated = results[t].accumulated.has_value();
    if (results[t].missing || (valid == usable && !accumulated)) continue;
    if (accumulated || last_valid == nullptr || valid != *last_valid) last = precision_of(results[t]);
    last_valid = accumulated ? nullptr : &valid;
    write_symmetric(file, fmt::format("/noise/precision_steps/{}", t), last, units);
  }
}

}  // namespace

void write_symmetric(files::Hdf5Writer& file, const std::string& name, const Sparse& matrix,
                     const std::string& units) {
  // Symmetric: columns are rows.
  Sparse m = matrix;
  m.prune(0.0, 0.0);  // rows of dofs that were not measured stay empty
  const std::size_t count = m.nonZeros();
  const std::vector<std::int64_t> indices(m.innerIndexPtr(), m.innerIndexPtr() + count),
      rows(m.outerIndexPtr(), m.outerIndexPtr() + m.rows() + 1);
  file.write(name + "/data", {m.valuePtr(), count}, {count}, {units, "inverse of the noise covariance"});
  file.write_integers(name + "/indices", indices, {count}, {"1", "column of each entry"});
  file.write_integers(name + "/indptr", rows, {rows.size()}, {"1", "first entry of each row"});
}

FileCells file_cells(const ImageMesh& mesh) {
  FileCells cells;
  const bool quadrilaterals = std::all_of(mesh.elements.begin(), mesh.elements.end(),
                                          [](const auto& e) { return ImageMesh::nodes_of(e) == 4; });
  cells.nodes_per_cell = quadrilaterals ? 4 : 3;
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    const auto& n = mesh.elements[e];
    if (quadrilaterals) {
      cells.nodes.insert(cells.nodes.end(), n.begin(), n.end()), cells.element.push_back(e);
      continue;
    }
    cells.nodes.insert(cells.nodes.end(), n.begin(), n.begin() + 3), cells.element.push_back(e);
    if (ImageMesh::nodes_of(n) == 4)
      cells.nodes.insert(cells.nodes.end(), {n[0], n[2], n[3]}), cells.element.push_back(e);
  }
  return cells;
}

namespace {

/// A number of each picture.
template <typename Get>
void write_per_picture(files::Hdf5Writer& file, const std::string& name,
                       const std::vector<PictureResult>& results, const files::Labels& labels,
                       const Get& get) {
  std::vector<double> values;
  for (const auto& r : results) values.push_back(get(r));
  file.write(name, values, {values.size()}, labels);
}

void write_records(files::Hdf5Writer& file, const std::string& group,
                   const std::vector<PictureResult>& results) {
  const std::string pictures = group + "/pictures";
  std::vector<std::string> names, messages, replaced;
  for (const auto& r : results)
    names.push_back(r.picture), messages.push_back(r.message), replaced.push_back(r.reference);
  write_per_picture(file, pictures + "/converged", results, {"1", "1 where the correlation converged"},
                    [](const auto& r) { return r.correlation.converged ? 1 : 0; });
  write_per_picture(file, pictures + "/iterations", results, {"1", "Gauss-Newton iterations"},
                    [](const auto& r) { return r.correlation.iterations; });
  write_per_picture(file, pictures + "/residual_rms", results,
                    {"grey levels", "root mean square of f - a g(x + u) - b"},
                    [](const auto& r) { return r.correlation.residual_rms; });
  write_per_picture(file, pictures + "/noise", results,
                    {"grey levels", "standard deviation of a picture's noise"},
                    [](const auto& r) { return r.noise; });
  write_per_picture(file, pictures + "/gain", results, {"1", "a in f = a g(x + u) + b"},
                    [](const auto& r) { return r.correlation.gain; });
  write_per_picture(file, pictures + "/offset", results, {"grey levels", "b in f = a g(x + u) + b"},
                    [](const auto& r) { return r.correlation.offset; });
  write_per_picture(file, pictures + "/elements_rejected", results, {"1", "elements without a measurement"},
                    [](const auto& r) { return r.correlation.elements_rejected; });
  file.texts_attribute(pictures, "names", names);
  file.texts_attribute(pictures, "replaced_reference", replaced);
  file.texts_attribute(pictures, "messages", messages);
}

/// One value for each of the file's cells.
void write_elements(files::Hdf5Writer& file, const std::string& group,
                    const std::vector<PictureResult>& results, const FileCells& cells) {
  std::vector<std::int64_t> valid;
  std::vector<double> residual;
  for (const auto& r : results)
    for (const std::size_t e : cells.element)
      valid.push_back(r.correlation.element_valid[e]), residual.push_back(r.correlation.element_residual[e]);
  const files::Shape shape{results.size(), cells.element.size()};
  file.write_integers(group + "/elements/valid", valid, shape, {"1", "1 where an element was measured"});
  file.write(group + "/elements/residual", residual, shape, {"grey levels", "root mean square residual"});
}

/// A crack of each picture: what belongs to the tip in one row per picture, the paths each by itself.
void write_cracks(files::Hdf5Writer& file, const std::vector<PictureResult>& results) {
  const auto n_t = results.size();
  std::vector<std::int64_t> found, in_view;
  std::vector<double> length, std, interval, tip, evidence;
  for (const auto& r : results) {
    const bool is_found = r.crack && r.crack->found;
    const CrackMeasurement c = is_found ? *r.crack : CrackMeasurement{};
    const auto or_nan = [&](double value) { return is_found ? value : k_nan; };
    found.push_back(is_found ? 1 : 0), in_view.push_back(c.tip_in_view ? 1 : 0);
    length.push_back(or_nan(c.length)), std.push_back(or_nan(c.length_std));
    interval.insert(interval.end(), {or_nan(c.interval[0]), or_nan(c.interval[1])});
    tip.insert(tip.end(), {or_nan(c.tip[0]), or_nan(c.tip[1])});
    evidence.push_back(r.crack ? r.crack->log_evidence : k_nan);
  }
  file.write_integers("/crack/found", found, {n_t}, {"1", "1 where the picture shows a crack"});
  file.write_integers("/crack/tip_in_view", in_view, {n_t}, {"1", "0 where the crack leaves the mesh"});
  file.write("/crack/length", length, {n_t}, {"px", "arc length from mouth or origin to tip"});
  file.write("/crack/length_std", std, {n_t}, {"px", "its posterior standard deviation"});
  file.write("/crack/length_interval", interval, {n_t, 2}, {"px", "its 95 % interval"});
  file.write("/crack/tip", tip, {n_t, 2}, {"px", "tip in the reference picture"});
  file.write("/crack/log_evidence", evidence, {n_t}, {"1", "log evidence of a crack against none"});
  for (std::size_t t = 0; t < n_t; ++t) {
    if (!results[t].crack || !results[t].crack->found) continue;
    std::vector<double> path;
    for (const CrackPoint& p : results[t].crack->path) {
      const double opening = p.measured ? p.opening : k_nan, sliding = p.measured ? p.sliding : k_nan;
      path.insert(path.end(),
                  {p.x, p.y, p.position_std, p.along, opening, p.measured ? p.opening_std : k_nan, sliding});
    }
    file.write(fmt::format("/crack/paths/{}", t), path, {path.size() / 7, 7},
               {"px", "x, y, std across, along, opening, its std, sliding"});
  }
}

}  // namespace

double series_noise(const PictureSeries& series, const std::vector<PictureResult>& results) {
  if (series.known_noise() > 0) return series.known_noise();
  std::vector<double> noise;
  const double k = 1 / series.reference_count();
  for (const auto& r : results)
    if (!r.missing)
      noise.push_back(r.noise * std::sqrt((k + r.correlation.gain * r.correlation.gain) / (k + 1)));
  return numerics::upper_median(std::move(noise));
}

void observation_places(const ImageMesh& mesh, const std::optional<PictureFrame>& frame,
                        std::vector<double>& points, std::vector<std::int64_t>& component) {
  const std::array<int, 2> components = frame ? frame->components() : std::array<int, 2>{0, 1};
  for (Index a = 0; a < std::ssize(mesh.x); ++a) {
    const auto point =
        frame ? frame->model_point(mesh.x[a], mesh.y[a]) : std::array<double, 3>{mesh.x[a], mesh.y[a], 0};
    for (const int c : components) {
      points.insert(points.end(), point.begin(), point.end());
      component.push_back(c);
    }
  }
}

Eigen::VectorXd observed_values(const ImageMesh& mesh, const PictureResult& result,
                                const std::optional<PictureFrame>& frame) {
  const CorrelationResult& c = result.correlation;
  if (result.missing) return Eigen::VectorXd::Constant(2 * mesh.node_count(), k_nan);
  // The likelihood wants what the pictures say, not what a regularisation adds.
  const Eigen::VectorXd& u = c.unregularised.size() > 0 ? c.unregularised : c.displacement;
  Eigen::VectorXd values = frame ? frame->to_model(mesh, u) : u;
  const auto measured = measured_nodes(mesh, c.element_valid);
  for (int a = 0; a < mesh.node_count(); ++a)
    if (measured[a] == 0) values.segment<2>(2 * a).setConstant(k_nan);
  return values;
}

double time_of(const PictureSeries& series, std::size_t picture) {
  const std::vector<double>& times = series.options().times;
  return times.empty() ? picture : times[picture];
}

void write_pictures(files::Hdf5Writer& file, const std::string& group, const PictureSeries& series,
                    const std::vector<PictureResult>& results) {
  const ImageMesh& mesh = series.correlation().mesh();
  const std::size_t n_t = results.size(), n = mesh.x.size();
  std::vector<double> nodes, in_pixels, unregularised;
  for (std::size_t a = 0; a < n; ++a) nodes.insert(nodes.end(), {mesh.x[a], mesh.y[a]});
  for (const PictureResult& r : results) {
    const auto measured = measured_nodes(mesh, r.correlation.element_valid);
    for (std::size_t i = 0; i < 2 * n; ++i)
      in_pixels.push_back(measured[i / 2] != 0 ? r.correlation.displacement[i] : k_nan);
    const Eigen::VectorXd& free = r.correlation.unregularised;
    for (std::size_t i = 0; i < 2 * n; ++i)
      unregularised.push_back(measured[i / 2] != 0 && free.size() > 0 ? free[i] : k_nan);
  }
  file.write(group + "/picture_frame/nodes", nodes, {n, 2},
             {"px", "nodes in the reference picture, x right, y down"});
  file.write(group + "/picture_frame/displacement", in_pixels, {n_t, n, 2}, {"px", "u right, v down"});
  if (series.options().correlation.regularisation > 0)
    file.write(group + "/picture_frame/unregularised", unregularised, {n_t, n, 2},
               {"px", "the same without the regularisation, which /values are made of"});
  write_records(file, group, results);
  write_elements(file, group, results, file_cells(mesh));
  file.texts_attribute(group.empty() ? "/" : group, "references", series.options().references);
}

void write_displacements(const std::string& path, const PictureSeries& series,
                         const std::vector<PictureResult>& results, const std::optional<PictureFrame>& frame,
                         const std::string& project) {
  const ImageMesh& mesh = series.correlation().mesh();
  const std::string unit = frame ? "m" : "px";
  const std::size_t n_t = results.size(), n = mesh.x.size();
  const Drift drift = series.options().drift;
  std::vector<double> places, values;
  std::vector<std::int64_t> component;
  observation_places(mesh, frame, places, component);
  std::vector<double> time;
  for (std::size_t t = 0; t < n_t; ++t) {
    time.push_back(time_of(series, t));
    const Eigen::VectorXd observed = observed_values(mesh, results[t], frame);
    values.insert(values.end(), observed.begin(), observed.end());
    values.insert(values.end(), drift_modes(drift), k_nan);
  }
  std::vector<double> points;
  for (std::size_t a = 0; a < n; ++a)
    points.insert(points.end(), places.begin() + 6 * a, places.begin() + 6 * a + 3);
  const FileCells cells = file_cells(mesh);
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    file.write("/time", time, {n_t},
               {"1", series.options().times.empty() ? "index of the picture" : "model time"});
    write_precisions(file, series, results, frame, places, component);
    add_drift_places(drift, places, component);
    const std::size_t n_obs = component.size();
    file.write("/values", values, {n_t, n_obs}, {unit, "measured displacement"});
    file.write("/dofs/points", places, {n_obs, 3}, {unit, "nodes of the correlation mesh"});
    file.write_integers("/dofs/component", component, {n_obs},
                        {"1", "displacement component: 0 x, 1 y, 2 z"});
    file.write("/mesh/points", points, {n, 3}, {unit, "nodes"});
    file.write_integers("/mesh/cells", cells.nodes, {cells.element.size(), cells.nodes_per_cell},
                        {"1", "nodes of each cell"});
    file.text_attribute("/mesh/cells", "type", cells.nodes_per_cell == 4 ? "VTK_QUAD" : "VTK_TRIANGLE");
    write_pictures(file, "", series, results);
    if (frame) {
      file.number_attribute("/picture_frame", "scale", frame->scale());
      file.number_attribute("/picture_frame", "relative_scale_std", frame->relative_scale_std);
    }
    if (series.options().crack) write_cracks(file, results);
    file.text_attribute("/", "created_by", k_created_by);
    file.text_attribute("/", "project", project);
    file.text_attribute("/", "length_unit", unit);
    file.close();
  });
}

/// Correlations are those of the precision; standard deviations may also contain a regularisation.
Eigen::MatrixXd point_std(const PictureSeries& series, const PictureResult& result,
                          const Eigen::MatrixXd& points) {
  const ImageMesh& mesh = series.correlation().mesh();
  const Eigen::VectorXd std = series.displacement_std(result);
  Sparse precision = series.precision(result, result.noise).matrix;
  for (int i = 0; i < precision.rows(); ++i)
    if (!(precision.coeff(i, i) > 0)) precision.coeffRef(i, i) = 1;  // not measured
  const numerics::SelectedInverse covariance(precision);
  const PointLocator locator(mesh);
  Eigen::MatrixXd at = Eigen::MatrixXd::Constant(points.rows(), 2, k_nan);
  for (Index p = 0; p < points.rows(); ++p) {
    const auto place = locator.find(points(p, 0), points(p, 1));
    if (place.element < 0 || result.correlation.element_valid[place.element] == 0) continue;
    const auto& nodes = mesh.elements[place.element];
    for (int k = 0; k < 2; ++k) {
      double variance = 0;
      for (Index a = 0; a < ImageMesh::nodes_of(nodes); ++a)
        for (Index b = 0; b < ImageMesh::nodes_of(nodes); ++b) {
          const int i = 2 * nodes[a] + k, j = 2 * nodes[b] + k;
          const double scale = std::sqrt(covariance.diagonal()[i] * covariance.diagonal()[j]);
          variance += place.shape[a] * place.shape[b] * std[i] * std[j] * covariance.entry(i, j) / scale;
        }
      at(p, k) = std::sqrt(std::max(0.0, variance));
    }
  }
  return at;
}

void write_at_points(const std::string& path, const ImageMesh& mesh, const PictureResult& result,
                     const Eigen::MatrixXd& points, const Eigen::MatrixXd& std) {
  std::vector<char> inside;
  const Eigen::MatrixXd at =
      interpolate(mesh, result.correlation.displacement, points, inside, result.correlation.element_valid);
  std::vector<std::string> header{"x", "y", "u", "v", "inside"};
  if (std.size() > 0) header.insert(header.end(), {"u_std", "v_std"});
  files::CsvWriter csv(header);
  for (Index i = 0; i < points.rows(); ++i) {
    std::vector<double> row{points(i, 0), points(i, 1), at(i, 0), at(i, 1), 1.0 * inside[i]};
    if (std.size() > 0) row.insert(row.end(), {std(i, 0), std(i, 1)});
    csv.add_row(row);
  }
  csv.write(path);
}

void write_displacement_vtu(const std::string& path, const PictureSeries& series, const PictureResult& result,
                            const Eigen::VectorXd& std, const std::optional<PictureFrame>& frame) {
  const ImageMesh& mesh = series.correlation().mesh();
  const CorrelationResult& c = result.correlation;
  const PictureFrame upright = frame.value_or(PictureFrame{});
  const std::array<int, 2> components = upright.components();
  const auto measured = measured_nodes(mesh, c.element_valid);
  const Eigen::VectorXd u = upright.to_model(mesh, c.displacement);
  const Eigen::MatrixXd strain = nodal_strains(mesh, c.displacement, c.element_valid);
  std::vector<double> points, displacement, deviation, strains, seen;
  for (int a = 0; a < mesh.node_count(); ++a) {
    const std::size_t i = a;
    const auto point = upright.model_point(mesh.x[i], mesh.y[i]);
    points.insert(points.end(), point.begin(), point.end());
    std::array<double, 3> field{}, spread{};
    for (int k = 0; k < 2 && measured[i] != 0; ++k) {
      field[components[k]] = u[2 * a + k];
      spread[components[k]] = std[2 * a + k] * upright.scale();
    }
    displacement.insert(displacement.end(), field.begin(), field.end());
    deviation.insert(deviation.end(), spread.begin(), spread.end());
    strains.insert(strains.end(), {strain(a, 0), strain(a, 1), -strain(a, 2)});  // y up
    seen.push_back(measured[i]);
  }
  const FileCells cells = file_cells(mesh);
  std::vector<double> residual, valid;
  for (const std::size_t e : cells.element)
    residual.push_back(c.element_residual[e]), valid.push_back(c.element_valid[e]);
  files::VtuGrid grid{
      points, cells.nodes, cells.nodes_per_cell, cells.nodes_per_cell == 4 ? "VTK_QUAD" : "VTK_TRIANGLE",
      {},     {}};
  const std::string unit = frame ? "m" : "px";
  grid.point_fields = {{"displacement", 3, displacement, unit},
                       {"displacement_std", 3, deviation, unit},
                       {"strain_xx_yy_xy", 3, strains, "1"},
                       {"measured", 1, seen}};
  grid.cell_fields = {{"residual_grey_levels", 1, residual, "grey levels"}, {"valid", 1, valid}};
  grid.time = time_of(series, result.index);
  files::write_vtu(grid, path);
}

}  // namespace knothe::imaging
