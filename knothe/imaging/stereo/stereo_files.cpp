#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/vtu.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/imaging/stereo/stereo_series.hpp"

namespace knothe::imaging {
namespace {

std::vector<PictureResult> of_camera(Index camera, const std::vector<StereoResult>& results) {
  std::vector<PictureResult> pictures;
  for (const StereoResult& r : results) pictures.push_back(r.pictures[camera]);
  return pictures;
}

/// Whether each camera measured the same elements, so that the precision is the same.
bool same_elements(const StereoResult& a, const StereoResult& b) {
  return std::equal(a.pictures.begin(), a.pictures.end(), b.pictures.begin(),
                    [](const auto& p, const auto& q) {
                      return p.correlation.element_valid == q.correlation.element_valid;
                    });
}

/// The precisions, one matrix at a time: of the first set that was measured, and of each whose elements are
/// others.
void write_stereo_precisions(files::Hdf5Writer& file, const StereoSeries& series,
                             const std::vector<StereoResult>& results) {
  std::vector<double> noise;
  for (Index c = 0; c < std::ssize(series.options().cameras); ++c)
    noise.push_back(std::max(k_quantisation_noise, series_noise(series.camera(c), of_camera(c, results))));
  const StereoResult* first = nullptr;
  for (Index t = 0; t < std::ssize(results); ++t) {
    if (results[t].missing || (first != nullptr && same_elements(results[t], *first))) continue;
    const std::string name =
        first == nullptr ? "/noise/precision" : fmt::format("/noise/precision_steps/{}", t);
    write_symmetric(file, name, series.precision(results[t], noise), "1/m2");
    if (first != nullptr) continue;
    file.integer_attribute(name, "shared_reference", series.camera(0).reference_count());
    file.number_attribute(name, "noise_grey_levels", noise.front());
    first = &results[t];
  }
}

/// What the errors of the calibration do to the values: they are the same errors at all times.
void write_calibration_errors(files::Hdf5Writer& file, const StereoSeries& series,
                              const std::vector<StereoResult>& results) {
  const std::vector<std::string>& names = series.options().calibration.names;
  if (names.empty()) return;
  const std::size_t n = 3 * series.surface().points.cols(), q = names.size();
  std::vector<double> effects;
  for (const StereoResult& r : results) {
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> effect = r.calibration;
    if (r.missing) effect.setZero(n, q);
    effects.insert(effects.end(), effect.data(), effect.data() + effect.size());
  }
  file.write("/noise/shared_errors", effects, {results.size(), n, q},
             {"m", "what errors of the calibration do, by their standard deviations"});
  file.texts_attribute("/noise/shared_errors", "names", names);
}

std::vector<double> in_order(const SurfacePoints& points) {
  return {points.data(), points.data() + points.size()};
}

}  // namespace

void write_stereo_displacements(const std::string& path, const StereoSeries& series,
                                const std::vector<StereoResult>& results, const std::string& project) {
  constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();
  const StereoSurface& surface = series.surface();
  const std::size_t n = surface.points.cols(), n_t = results.size();
  const std::vector<double> points = in_order(surface.points);
  std::vector<double> time, values, std, places, epipolar, chi_square;
  std::vector<std::int64_t> component;
  std::vector<std::string> names, messages;
  for (std::size_t i = 0; i < 3 * n; ++i) {
    const auto point = points.begin() + 3 * (i / 3);
    places.insert(places.end(), point, point + 3), component.push_back(i % 3);
  }
  for (const StereoResult& r : results) {
    time.push_back(time_of(series.camera(0), r.index));
    names.push_back(r.pictures.front().picture), messages.push_back(r.message);
    epipolar.push_back(r.missing ? k_nan : r.motion.epipolar_rms);
    chi_square.push_back(r.missing ? k_nan : r.motion.chi_square / r.motion.redundancy);
    const Eigen::VectorXd deviation = r.missing ? Eigen::VectorXd() : r.std();
    for (std::size_t i = 0; i < 3 * n; ++i) {
      const bool there = !r.missing && r.motion.measured[i / 3] != 0;
      values.push_back(there ? r.motion.displacement[i] : k_nan);
      std.push_back(there ? deviation[i] : k_nan);
    }
  }
  const FileCells cells = file_cells(surface.meshes.front());
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    file.write("/time", time, {n_t},
               {"1", series.camera(0).options().times.empty() ? "index of the picture" : "model time"});
    write_stereo_precisions(file, series, results);
    write_calibration_errors(file, series, results);
    file.write("/values", values, {n_t, 3 * n}, {"m", "measured displacement"});
    file.write("/displacement_std", std, {n_t, 3 * n},
               {"m", "standard deviation of each picture's values: noise and calibration"});
    file.write("/dofs/points", places, {3 * n, 3}, {"m", "nodes of the surface"});
    file.write_integers("/dofs/component", component, {3 * n},
                        {"1", "displacement component: 0 x, 1 y, 2 z"});
    file.write("/mesh/points", points, {n, 3}, {"m", "nodes"});
    file.write_integers("/mesh/cells", cells.nodes, {cells.element.size(), cells.nodes_per_cell},
                        {"1", "nodes of each cell"});
    file.text_attribute("/mesh/cells", "type", cells.nodes_per_cell == 4 ? "VTK_QUAD" : "VTK_TRIANGLE");
    file.write("/pictures/epipolar_rms", epipolar, {n_t},
               {"px", "root mean square by which the cameras' displacements contradict each other"});
    file.write("/pictures/chi_square", chi_square, {n_t},
               {"1", "the same, by the noise, squared: 1 if all is well"});
    for (Index c = 0; c < std::ssize(series.options().cameras); ++c)
      write_pictures(file, fmt::format("/cameras/{}", c), series.camera(c), of_camera(c, results));
    file.texts_attribute("/pictures", "names", names);
    file.texts_attribute("/pictures", "messages", messages);
    file.number_attribute("/mesh", "epipolar_rms", surface.epipolar_rms);
    file.text_attribute("/", "created_by", k_created_by);
    file.text_attribute("/", "project", project);
    file.text_attribute("/", "length_unit", "m");
    file.close();
  });
}

std::vector<StereoResult> resume_from(const std::string& path, StereoSeries& series) {
  std::vector<std::vector<PictureResult>> measured;
  for (Index c = 0; c < std::ssize(series.options().cameras); ++c)
    measured.push_back(read_results(path, series.camera(c), fmt::format("/cameras/{}", c)));
  return series.resume(measured);
}

void write_stereo_vtu(const std::string& path, const StereoSeries& series, const StereoResult& result) {
  const StereoSurface& surface = series.surface();
  const FileCells cells = file_cells(surface.meshes.front());
  const std::vector<double> points = in_order(surface.points);
  const Eigen::VectorXd& u = result.motion.displacement;
  const Eigen::VectorXd std = result.std();
  const std::vector<char> valid = series.valid_elements(result);
  const Eigen::MatrixXd strain =
      surface_strains(surface.points, result.motion, surface.meshes.front().elements);
  std::vector<double> seen;
  for (const std::size_t e : cells.element) seen.push_back(valid[e]);
  files::VtuGrid grid{
      points, cells.nodes, cells.nodes_per_cell, cells.nodes_per_cell == 4 ? "VTK_QUAD" : "VTK_TRIANGLE",
      {},     {}};
  grid.point_fields = {{"displacement", 3, {u.begin(), u.end()}, "m"},
                       {"displacement_std", 3, {std.begin(), std.end()}, "m"},
                       {"green_strain", 6, {strain.data(), strain.data() + strain.size()}, "1"},
                       {"measured", 1, {result.motion.measured.begin(), result.motion.measured.end()}}};
  grid.cell_fields = {{"valid", 1, seen}};
  grid.time = time_of(series.camera(0), result.index);
  files::write_vtu(grid, path);
}

}  // namespace knothe::imaging
