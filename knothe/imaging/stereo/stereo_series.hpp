#pragma once
/// @file Many sets of pictures of one test, each taken by two or more cameras at once.
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/series/picture_series.hpp"
#include "knothe/imaging/stereo/calibration_error.hpp"
#include "knothe/imaging/stereo/stereo_surface.hpp"

namespace knothe::imaging {

struct StereoOptions {
  std::vector<Camera> cameras;  ///< in metres
  /// Of each camera, as many pictures each; region, mask, mesh and elements are those of the first, in its
  /// px; of a mask the elements that lie wholly in it.
  std::vector<SeriesOptions> series;
  /// Where the nodes of the first camera's mesh are, m, if that is known: those of a model. Otherwise they
  /// are where the references show them.
  std::optional<SurfacePoints> nodes;
  CalibrationError calibration;  ///< no columns: taken as exact
  double epipolar_bound = 0.5;   ///< px; lines of sight that miss each other by more are refused
};

/// The cameras of a calibration in metres, and their error in CSV (empty: none); `unit` of the files, m.
/// Errors: DataError.
[[nodiscard]] StereoOptions cameras_in_metres(const std::string& path, double unit, const std::string& error);

/// What came of one set of pictures.
struct StereoResult {
  std::size_t index = 0;
  bool missing = false;  ///< `message` says why, and what to do
  std::string message;
  std::vector<PictureResult> pictures;  ///< of each camera
  SurfaceMotion motion;                 ///< m; all empty if missing
  /// 3n × q, m: what each error of the calibration, in its standard deviations, does to the displacements.
  Eigen::MatrixXd calibration;
  double elapsed_ms = 0;  ///< reading not counted

  /// Of the displacements: the calibration's part, and with the noise's, m.
  [[nodiscard]] Eigen::VectorXd calibration_std() const { return calibration.rowwise().norm(); }
  [[nodiscard]] Eigen::VectorXd std() const {
    return (motion.std.cwiseAbs2() + calibration_std().cwiseAbs2()).cwiseSqrt();
  }
};

/// The correlation of such a test, set by set.
class StereoSeries {
 public:
  /// Finds the shape of the surface from the references. Errors: those of PictureSeries and find_surface;
  /// UsageError where the cameras' pictures differ in number, and for what is not possible with cameras:
  /// cracks, drift, another reference, regularisation.
  explicit StereoSeries(StereoOptions options);

  [[nodiscard]] const StereoOptions& options() const { return options_; }
  [[nodiscard]] const StereoSurface& surface() const { return surface_; }
  [[nodiscard]] const PictureSeries& camera(Index c) const { return *series_[c]; }
  [[nodiscard]] bool done() const { return series_.front()->done(); }
  /// The next set. Never throws for bad pictures: a set is missing if a picture of it is.
  [[nodiscard]] StereoResult next();
  /// The series goes on behind the first sets, of which an earlier run measured each camera's pictures.
  [[nodiscard]] std::vector<StereoResult> resume(const std::vector<std::vector<PictureResult>>& measured);
  /// Precision (1/m²) of the displacements of a set for noise γ_c (grey levels) of each camera's picture.
  [[nodiscard]] Eigen::SparseMatrix<double> precision(const StereoResult& result,
                                                      const std::vector<double>& gamma) const;
  /// What was found of the options that were not given, and what is doubtful, in words for the user.
  [[nodiscard]] std::vector<std::string> remarks() const;
  /// Elements that all cameras measured.
  [[nodiscard]] std::vector<char> valid_elements(const StereoResult& result) const;

 private:
  [[nodiscard]] StereoResult combined(std::vector<PictureResult> pictures) const;
  [[nodiscard]] std::vector<CameraMotion> motions(const StereoResult& result,
                                                  const std::vector<double>& gamma) const;

  StereoOptions options_;
  StereoSurface surface_;
  std::vector<std::string> first_remarks_;  ///< of the first camera, before the shape was known
  std::vector<std::unique_ptr<PictureSeries>> series_;
};

/// HDF5 in the form of measurements (docs/reference/formats.md): three components a node, m, in the frame of
/// the calibration; an entry of results a time. `project` is the project file's text. Errors: IoError.
void write_stereo_displacements(const std::string& path, const StereoSeries& series,
                                const std::vector<StereoResult>& results, const std::string& project);

/// The results in such a file, of the first sets of this series, which goes on behind them. Errors: those of
/// read_results.
[[nodiscard]] std::vector<StereoResult> resume_from(const std::string& path, StereoSeries& series);

/// Shape, displacement, its standard deviation (m) and validity of one set for ParaView. Errors: IoError.
void write_stereo_vtu(const std::string& path, const StereoSeries& series, const StereoResult& result);

}  // namespace knothe::imaging
