#pragma once
/// @file Many pictures of one test: each is correlated with the reference, started from the one before; a bad
/// one is named, marked missing, and the series goes on.
#include <cstddef>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/correlation/correlation_noise.hpp"
#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/correlation/moved_reference.hpp"
#include "knothe/imaging/crack/crack_measurement.hpp"

namespace knothe::imaging {

/// Motions of the camera against the body, of each picture by itself, that the likelihood is not to take for
/// deformation.
enum class Drift { none, shift, rigid };  ///< rigid: shift and turn

struct SeriesOptions {
  /// The unloaded surface; several pictures of it are averaged, and their differences tell the noise.
  std::vector<std::string> references;
  std::vector<std::string> pictures;  ///< deformed, in the order of time
  std::vector<double> times;          ///< one per picture, or empty: 0, 1, 2 …
  std::string mask;                   ///< picture file; empty: none
  /// px; otherwise the mask's, or what is textured (textured_region.hpp), or the picture less a margin.
  std::optional<Region> region;
  files::Colour colour = files::Colour::refuse;  ///< of pictures in colour
  double element_size = 25;                      ///< px
  /// A mesh of its own, px, instead of one over the region; of its elements those are used that lie in the
  /// region, if one is given, and in the picture.
  std::optional<ImageMesh> mesh;
  double outline_margin =
      4;  ///< px along the outline of such a mesh that are not looked at (without_outline)
  ElementShape shape = ElementShape::quadrilateral;
  double noise = 0;  ///< standard deviation of a picture's noise, grey levels; 0: from repeats or residuals
  CorrelationOptions correlation{.threads = 0};
  /// correlation.prefilter_sigma is found: 1 px where speckles of the reference are aliased, else 0.
  bool find_prefilter = false;
  Drift drift = Drift::none;
  double drift_std = 10;  ///< px, of such a motion before anything is measured (camera_drift.hpp)
  /// A picture that does not converge, whose residual is so many times that of the first picture of the
  /// reference, or in which a tenth more of the elements are out, is measured against the last good picture
  /// instead, and so are those after it, if that is better; 0: never.
  double reference_update = 0;
  /// Look for a crack in every picture. On a mesh of its own (the model's) the default gap is half an element
  /// and 2 px: a model's crack is a band of damage, one element wide.
  std::optional<CrackSearchOptions> crack;
};

/// Noise of displacements that were measured from reference to reference.
struct AccumulatedNoise {
  double gamma = 0;  ///< the noise of one picture that it is for, grey levels
  /// For a likelihood of the series, 1/px²: what was measured since the last reference was taken, made less
  /// by so much that all pictures which share that reference's error together say no more than that allows.
  Eigen::SparseMatrix<double> precision;
  Eigen::VectorXd std;  ///< px, of this picture's displacements; 0 where nothing was measured
};

/// What came of one picture.
struct PictureResult {
  std::size_t index = 0;  ///< in the series
  std::string picture;    ///< as named in the options
  bool missing = false;   ///< unusable: `message` says why, names the picture, and what to do
  std::string message;
  CorrelationResult correlation;  ///< all zero, and no element valid, if missing
  std::string reference;          ///< picture that took the reference's place; empty: the reference itself
  std::optional<AccumulatedNoise> accumulated;  ///< then
  double noise = 0;       ///< γ: given, from repeats, or from this picture's residual; grey levels
  double elapsed_ms = 0;  ///< reading not counted, nor the crack
  std::optional<CrackMeasurement> crack;  ///< where it was asked for and the picture is not missing
  double crack_ms = 0;
};

/// Smallest γ that is believed: rounding to whole grey levels alone makes 1/√12.
inline constexpr double k_quantisation_noise = 0.288675134594812882;

/// The correlation of a series, picture by picture. While one is correlated the next is read.
class PictureSeries {
 public:
  /// Reads reference and mask, makes the mesh. Errors: DataError for a reference or mask that cannot be read,
  /// UsageError for what the options lack or what does not fit together.
  explicit PictureSeries(SeriesOptions options);
  ~PictureSeries();
  PictureSeries(const PictureSeries&) = delete;
  PictureSeries& operator=(const PictureSeries&) = delete;

  [[nodiscard]] const SeriesOptions& options() const { return options_; }
  /// What was found of the options that were not given, and what is doubtful about the pictures so far, in
  /// words for the user. Empty where there is nothing to say.
  [[nodiscard]] const std::vector<std::string>& remarks() const { return remarks_; }
  [[nodiscard]] const ImageCorrelation& correlation() const { return *correlation_; }
  [[nodiscard]] double reference_count() const { return options_.references.size(); }
  /// γ from the options or repeat pictures, grey levels; 0: each picture's residual has to tell.
  [[nodiscard]] double known_noise() const { return known_noise_; }
  [[nodiscard]] bool done() const { return next_ == options_.pictures.size(); }
  /// The next picture's result. Never throws for a bad picture.
  PictureResult next();
  /// The same for a picture that is in memory; the series of files stays where it is.
  PictureResult correlate(files::Picture picture, const std::string& name);
  /// The series goes on at picture `index`, started from what an earlier run measured in the one before it.
  void resume(std::size_t index, const CorrelationResult& last);
  /// Displacements that a model predicts for the next picture, px: it starts from them if they fit better
  /// than those of the last picture.
  void set_prediction(Eigen::VectorXd prediction) { prediction_ = std::move(prediction); }

  /// Precision of a result's displacements for noise γ (grey levels) of one picture. Where the noise is so
  /// strong against the texture that the correction for the gradient's own noise has no meaning, without it.
  [[nodiscard]] DisplacementPrecision precision(const std::vector<char>& element_valid, double gamma,
                                                double gain = 1) const;
  /// The same of a picture, whatever its reference.
  [[nodiscard]] DisplacementPrecision precision(const PictureResult& result, double gamma,
                                                double gain = 1) const;
  /// Standard deviation of a picture's displacements for its own noise, px; empty for a missing one.
  [[nodiscard]] Eigen::VectorXd displacement_std(const PictureResult& result) const;

 private:
  [[nodiscard]] CorrelationResult track(const files::Picture& picture);
  [[nodiscard]] bool is_foreign(const CorrelationResult& result) const;
  void try_other_reference(const files::Picture& picture, CorrelationResult& best);
  void note_noise(PictureResult& result);
  void prefetch(std::size_t index);
  void remark(const std::string& text);
  [[nodiscard]] Region find_region(const files::Picture& reference);
  void find_noise(const std::vector<files::Picture>& references);
  void find_prefilter(const files::Picture& reference, const Region& region);
  [[nodiscard]] files::Picture with_levels_of(const files::Picture& reference, files::Picture picture,
                                              const std::string& name);
  [[nodiscard]] std::string what_to_try() const;
  [[nodiscard]] std::string fault(const files::Picture& picture, std::size_t mark,
                                  const std::string& name) const;

  SeriesOptions options_;
  std::vector<std::string> remarks_;
  std::unique_ptr<ImageCorrelation> correlation_;
  double known_noise_ = 0, contrast_ = 0;
  std::size_t next_ = 0;
  std::future<files::Picture> reading_;
  Eigen::VectorXd start_, prediction_;
  std::vector<char> start_valid_;
  std::size_t latest_mark_ = 0;  ///< of the last picture's pixels: a copy is told by it
  std::string latest_name_;
  double last_residual_ = 0;
  int last_rejected_ = 0;
  std::unique_ptr<MovedReference> moved_;  ///< where the reference has been replaced
  std::string moved_name_;
  double sharing_ = 0;           ///< pictures that share its error
  files::Picture last_picture_;  ///< of the good ones; kept where it may become the reference
  PictureResult last_good_;      ///< in it; its displacement is empty before the first
  double first_residual_ = 0;
  int first_rejected_ = 0;
};

/// A mask as it was drawn: what a lossy format (which its remark names) has blurred is black or bright again.
/// Errors: DataError.
[[nodiscard]] files::Picture read_mask(const std::string& path);

/// The mean of pictures of one surface at rest. Errors: UsageError for different sizes, naming the file.
[[nodiscard]] files::Picture averaged(const std::vector<files::Picture>& pictures,
                                      const std::vector<std::string>& names);

}  // namespace knothe::imaging
