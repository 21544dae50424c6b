#pragma once
/// @file From pictures to measurements, one by one: what `knothe assimilate` takes instead of a data file.
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/mesh/outline_registration.hpp"
#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/picture_series.hpp"
#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

/// The faces of a mesh of hexahedra that lie in the plane a camera sees, in picture coordinates. Errors:
/// ProjectError for a mesh without such faces.
[[nodiscard]] imaging::ImageMesh surface_mesh(const model::Mesh& mesh, const imaging::PictureFrame& frame,
                                              const Project& project);

/// The frame of the project with its plane: given, or the model's outermost face. Errors: ProjectError where
/// the project has neither scale nor registration.
[[nodiscard]] imaging::PictureFrame picture_frame_of(const Project& project,
                                                     const std::optional<model::Mesh>& mesh);

/// The face of the body in metres, y down.
[[nodiscard]] imaging::PictureFrame model_face(const Project& project,
                                               const std::optional<model::Mesh>& mesh);

/// A frame with the plane that the project gives, or the model's outermost face.
[[nodiscard]] imaging::PictureFrame with_plane(imaging::PictureFrame frame, const Project& project,
                                               const std::optional<model::Mesh>& mesh);

/// The series of a project, with the model's surface mesh if that is asked for.
[[nodiscard]] imaging::SeriesOptions series_options(const Project& project,
                                                    const std::optional<model::Mesh>& mesh);

/// One picture as a datum.
struct PictureDatum {
  imaging::PictureResult picture;
  Eigen::VectorXd values;                          ///< n_obs, m; NaN where nothing was measured
  std::optional<likelihood::GaussianNoise> noise;  ///< where elements are missing
  double correlation_us = 0, precision_us = 0;
  double wait_us =
      0;  ///< until the picture was there: correlation runs ahead, while the one before is assimilated
};

/// The pictures of a project as a stream of data. While one is assimilated the next is correlated, on a
/// thread of its own. γ is known from the options or from repeated references; else it is estimated from the
/// first picture that converges, and kept.
class PictureMeasurements {
 public:
  /// `live`: there are no pictures yet but the references; `measure` is given each, `next` has none. Then γ
  /// must be known. Errors: ProjectError for what the project lacks, DataError for pictures, UsageError for
  /// the mesh.
  PictureMeasurements(const Project& project, const model::SeparatedModel& model, bool live = false);

  /// Times, places and noise; values are NaN until pictures have come. Times that the pictures do not have
  /// are the model's, one by one.
  [[nodiscard]] const likelihood::Measurements& measurements() const { return measurements_; }
  [[nodiscard]] const imaging::PictureSeries& series() const { return *series_; }
  [[nodiscard]] const imaging::PictureFrame& frame() const { return frame_; }
  [[nodiscard]] const std::vector<imaging::PictureResult>& results() const { return results_; }
  [[nodiscard]] double noise() const { return gamma_; }  ///< γ, grey levels
  /// Where the pictures were registered by the outline of the body.
  [[nodiscard]] const std::optional<imaging::OutlineFit>& registration() const { return registration_; }
  PictureDatum next();
  /// What a model says that displacements change by from the picture that `next` will give to the one after
  /// it (the observations, m): that one then starts from what it predicts, if it fits better than the picture
  /// before it.
  void set_increment(Eigen::VectorXd increment) { increment_ = std::move(increment); }
  /// A picture that is not one of the project's, `increment` (may be empty) from the last to this one.
  /// DataError where it cannot be of this series.
  [[nodiscard]] PictureDatum measure(const files::Picture& picture, const std::string& name,
                                     Eigen::VectorXd increment = {});
  /// In place of `measure`: the picture is missing, so the next one is not predicted from it.
  void skip() { last_live_.reset(); }

 private:
  void read_series(const Project& project, const model::ModelContents& contents);
  [[nodiscard]] PictureDatum as_datum(const imaging::PictureResult& picture);
  [[nodiscard]] likelihood::GaussianNoise noise_of(Eigen::SparseMatrix<double> in_pixels) const;
  void correlate_ahead();
  void predict_next(const imaging::PictureResult& last);

  imaging::PictureFrame frame_;
  std::optional<imaging::OutlineFit> registration_;
  std::unique_ptr<imaging::PictureSeries> series_;
  likelihood::Measurements measurements_;
  std::vector<imaging::PictureResult> results_;
  std::optional<imaging::PictureResult> last_live_;  ///< of `measure`
  std::size_t next_ = 0;
  Eigen::VectorXd increment_;
  double gamma_ = 0;
  std::vector<char> last_valid_;
  std::optional<likelihood::GaussianNoise> last_noise_;
  std::vector<double> points_;  ///< of the observations, m, 3 each; those of a camera's drift at the end
  std::vector<std::int64_t> component_;
  std::future<imaging::PictureResult>
      ahead_;  ///< the picture after the last; declared last, so that it ends first
};

}  // namespace knothe::project
