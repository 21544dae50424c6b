#include "knothe/imaging/correlation/image_correlation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"
#include "knothe/imaging/correlation/correlation_stage.hpp"
#include "knothe/imaging/correlation/matched_motion.hpp"
#include "knothe/imaging/correlation/picture_pyramid.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_coarsest = 64;        // px: size of the region in the smallest picture, at most twice that
constexpr double k_coarse_element = 16;  // px of the coarse picture, at least
constexpr double k_far = 0.6;            // of the contrast, as residual: a start is out of reach …
constexpr double k_doubtful = 0.35;      // … or one that was searched may be wrong
constexpr double k_same_start = 0.1;     // px: starts nearer than that are as good as each other
constexpr double k_per_octave = 2;       // of the squared noise, for which variances are found
constexpr double k_coarse_smoothing = 3;  // cut-off wavelength of coarse stages, in elements

/// Pixels of the mesh, as a mask.
files::Picture mesh_mask(const PixelTable& pixels, const ReferenceField& field) {
  const ReferenceRows reference = field.view();
  files::Picture mask;
  mask.width = field.width, mask.height = field.height;
  mask.pixels.assign(static_cast<std::size_t>(field.width) * field.height, 0.0F);
  for (const auto& element : pixels.elements())
    for (const auto& row : pixels.rows(element))
      for (int x = row.x; x < row.x + row.count; ++x)
        if (reference.counts(reference.index(x, row.y))) mask.at(x, row.y) = 1;
  return mask;
}

/// A mesh on a picture of half, quarter … size that helps to find the start.
struct CoarseMesh {
  int level;
  double element;  ///< px of the level
  ImageMesh mesh;
};
/// From the coarsest on. On level 0 there is one only where no picture is coarser: the measurement itself is
/// there.
std::vector<CoarseMesh> coarse_meshes(const ImageMesh& fine, int width, int height) {
  const Region bounds = fine.bounds();
  const double size = std::max(bounds.width(), bounds.height()),
               fine_element = std::sqrt(bounds.width() * bounds.height() / fine.element_count());
  const int top = std::clamp<int>(std::floor(std::log2(size / k_coarsest)), 0, 6);
  std::vector<CoarseMesh> meshes;
  for (int level = top; level >= std::min(1, top); --level) {
    const auto shrink = [level](double x, int pixels) {
      return std::clamp(to_level(x, level), 0.0, (pixels >> level) - 1.0);
    };
    const Region region{shrink(bounds.x0, width), shrink(bounds.y0, height), shrink(bounds.x1, width),
                        shrink(bounds.y1, height)};
    const double least = std::min(region.width(), region.height());
    if (least < 6) continue;
    // The coarsest picture first by one element, which is nearly an affine motion; then ever finer ones.
    std::vector<double> sizes;
    if (level == top) sizes.push_back(std::max(region.width(), region.height()));
    if (level > 0) sizes.push_back(std::max(k_coarse_element, fine_element / std::pow(2.0, level)));
    for (const double element : sizes)
      meshes.push_back({level, element, structured_mesh(region, std::min(element, least))});
  }
  return meshes;
}

CorrelationOptions coarse_options(CorrelationOptions options, double element) {
  options.reject_elements = false;
  options.regularisation_kind = DisplacementRegularisation::tikhonov;
  options.regularisation = k_coarse_smoothing * element;
  if (options.brightness != Brightness::none) options.brightness = Brightness::global;
  options.least_texture = 0;  // coarse pictures have less noise
  options.tolerance = 0.02;
  options.max_iterations = 30;
  return options;
}

/// Nothing where no texture is left at that scale: the finer ones must do.
std::unique_ptr<CorrelationStage> coarse_stage(const PyramidLevel& reference, const CoarseMesh& coarse,
                                               const CorrelationOptions& options) {
  try {
    return std::make_unique<CorrelationStage>(
        reference_field(reference.picture, reference.mask, coarse.mesh.bounds(), 0,
                        std::numeric_limits<double>::max(), options.threads),
        coarse.mesh, coarse_options(options, coarse.element));
  } catch (const UsageError&) {
    return nullptr;
  }
}

void require_same_size(const files::Picture& picture, int width, int height, const char* what) {
  if (picture.width != width || picture.height != height)
    throw UsageError(fmt::format(
        "{} has {} × {} pixels, the reference picture {} × {}: all pictures of a series must be of one size",
        what, picture.width, picture.height, width, height));
}

void require_noise(double gamma) {
  if (!(gamma > 0))
    throw UsageError(fmt::format(
        "precision of displacements: the noise of the pictures is {} grey levels; it must be positive",
        gamma));
}

}  // namespace

Eigen::MatrixXd interpolate(const ImageMesh& mesh, const Eigen::VectorXd& displacement,
                            const Eigen::Ref<const Eigen::MatrixXd>& points, std::vector<char>& inside,
                            const std::vector<char>& element_valid) {
  const PointLocator locator(mesh);
  Eigen::MatrixXd result(points.rows(), 2);
  inside.assign(points.rows(), 0);
  for (Index i = 0; i < points.rows(); ++i) {
    const auto place = locator.find(points(i, 0), points(i, 1));
    result.row(i).setConstant(std::numeric_limits<double>::quiet_NaN());
    if (place.element < 0 || (!element_valid.empty() && element_valid[place.element] == 0)) continue;
    inside[i] = 1;
    result.row(i).setZero();
    const auto& nodes = mesh.elements[place.element];
    for (Index a = 0; a < ImageMesh::nodes_of(nodes); ++a)
      for (int k = 0; k < 2; ++k) result(i, k) += place.shape[a] * displacement[2 * nodes[a] + k];
  }
  return result;
}

std::vector<char> measured_nodes(const ImageMesh& mesh, const std::vector<char>& element_valid) {
  std::vector<char> measured(mesh.x.size(), 0);
  for (Index e = 0; e < std::ssize(mesh.elements); ++e)
    if (element_valid[e] != 0)
      for (int a = 0; a < ImageMesh::nodes_of(mesh.elements[e]); ++a) measured[mesh.elements[e][a]] = 1;
  return measured;
}

struct ImageCorrelation::Work {
  files::Picture reference;
  CorrelationOptions options;
  CorrelationStage fine;
  SplineImage deformed;
  std::optional<double> noise_factor;  ///< of the prefilter; made when first needed
  /// 1 / diag (M − 2aΣN Nᵀ)⁻¹ for a = 2^(index/2), of the elements that were asked for last.
  struct InverseDiagonals {
    std::vector<char> valid;
    std::map<int, Eigen::ArrayXd> at;
  } inverse_diagonals;

  // In braces: the field is made before the mesh is moved away.
  Work(files::Picture f, const files::Picture& mask, ImageMesh mesh, const CorrelationOptions& o)
      : reference(std::move(f)),
        options(o),
        fine{reference_field(reference, mask, mesh.bounds(), o.prefilter_sigma, o.saturation, o.threads),
             std::move(mesh), o} {}

  const Eigen::ArrayXd& inverse_diagonal(const std::vector<char>& valid, int index);
  /// M less what the reference's noise alone adds to it, of those elements that have more texture than that.
  [[nodiscard]] Eigen::SparseMatrix<double> matrix_without_noise(std::vector<char> valid,
                                                                 double of_noise) const {
    for (Eigen::Index e = 0; e < std::ssize(valid); ++e)
      if (!(fine.element_texture()[e] > of_noise)) valid[e] = 0;
    return fine.matrix(valid, -of_noise);
  }
  void look_at(const files::Picture& picture) {
    deformed.assign(picture, options.prefilter_sigma, options.threads);
  }
  /// The motion without a start; seldom needed, so that nothing of it is kept.
  void search(const files::Picture& picture, CorrelationResult& result);
};

/// 0 where nothing was measured.
const Eigen::ArrayXd& ImageCorrelation::Work::inverse_diagonal(const std::vector<char>& valid, int index) {
  if (inverse_diagonals.valid != valid) inverse_diagonals = {valid, {}};
  auto& known = inverse_diagonals.at;
  if (const auto found = known.find(index); found != known.end()) return found->second;
  const Eigen::ArrayXd std =
      imaging::displacement_std(matrix_without_noise(valid, 2 * std::exp2(index / k_per_octave))).array();
  return known[index] = (std > 0).select(std.square().inverse(), 0.0);
}

namespace {

/// Both pictures in all sizes, and the meshes on them that lead from a rough motion to displacements of the
/// nodes.
class MotionSearch {
 public:
  MotionSearch(const files::Picture& reference, const CorrelationStage& fine, const files::Picture& picture,
               const CorrelationOptions& options)
      : reference_(reference),
        picture_(picture),
        fine_(fine),
        options_(options),
        meshes_(coarse_meshes(fine.mesh(), reference.width, reference.height)),
        top_(meshes_.empty() ? 0 : meshes_.front().level),
        before_(picture_pyramid(reference, mesh_mask(fine.pixels(), fine.reference()), top_)),
        after_(picture_pyramid(picture, {}, top_)) {}

  /// From coarse to fine pictures, beginning with `motion`, or where there is none with the best shift of the
  /// coarsest.
  void refine(const std::optional<AffineMotion>& motion, CorrelationResult& result) const;
  /// From features in both pictures.
  [[nodiscard]] std::optional<AffineMotion> matched() const;

 private:
  const files::Picture &reference_, &picture_;
  const CorrelationStage& fine_;
  const CorrelationOptions& options_;
  std::vector<CoarseMesh> meshes_;
  int top_;
  std::vector<PyramidLevel> before_, after_;
};

void MotionSearch::refine(const std::optional<AffineMotion>& motion, CorrelationResult& result) const {
  CorrelationResult last;
  const CoarseMesh* coarser = nullptr;
  SplineImage image;
  int image_level = -1;
  for (const CoarseMesh& coarse : meshes_) {
    const auto& reference_level = before_[coarse.level];
    const auto& picture_level = after_[coarse.level].picture;
    const auto stage = coarse_stage(reference_level, coarse, options_);
    if (!stage) continue;
    CorrelationResult now;
    if (coarser != nullptr) {
      transfer(coarser->mesh, last.displacement, coarser->level, coarse.mesh, coarse.level, now.displacement);
      now.gain = last.gain, now.offset = last.offset;
    } else if (motion) {
      now.displacement = nodal_displacement(at_level(*motion, 0, coarse.level), coarse.mesh);
    } else {
      const auto shift = best_shift(reference_level, picture_level);
      now.displacement = Eigen::Vector2d(shift[0], shift[1]).replicate(coarse.mesh.node_count(), 1);
    }
    if (image_level != coarse.level)
      image.assign(picture_level, 0, options_.threads), image_level = coarse.level;
    const Eigen::VectorXd start = now.displacement;
    stage->correlate(image, now);
    if (!now.displacement.allFinite() || now.displacement.isZero(0))
      now.displacement = start;  // did not help
    coarser = &coarse;
    last = std::move(now);
  }
  if (coarser == nullptr) return;
  transfer(coarser->mesh, last.displacement, coarser->level, fine_.mesh(), 0, result.displacement);
  result.gain = last.gain, result.offset = last.offset;
}

std::optional<AffineMotion> MotionSearch::matched() const {
  const Region bounds = fine_.mesh().bounds();
  const double size = std::sqrt(bounds.width() * bounds.height());
  const int level = std::clamp<int>(std::ceil(std::log2(size / k_matched_size)), 0, top_);
  const auto motion = level > 0 ? matched_motion(before_[level], after_[level].picture, options_.threads)
                                : matched_motion({reference_, mesh_mask(fine_.pixels(), fine_.reference())},
                                                 picture_, options_.threads);
  if (!motion) return std::nullopt;
  return at_level(*motion, level, 0);
}

}  // namespace

/// The search from coarse to fine pictures reaches some tens of pixels and a few degrees. Where what it finds
/// explains the picture badly features may find more.
void ImageCorrelation::Work::search(const files::Picture& picture, CorrelationResult& result) {
  const MotionSearch search(reference, fine, picture, options);
  search.refine(std::nullopt, result);
  look_at(picture);
  result.searched = true;
  CorrelationResult found = result;
  const bool close = fine.correlate(deformed, found, k_doubtful);
  if (!close || !found.converged) {
    if (const auto motion = search.matched()) {
      CorrelationResult other = result;
      search.refine(motion, other);
      const double misfit = fine.misfit(deformed, result);
      if (fine.misfit(deformed, other) < misfit) {
        other.element_valid = fine.seen();
        fine.correlate(deformed, other);
        result = std::move(other);
        return;
      }
    }
    if (!close) fine.correlate(deformed, found);
  }
  result = std::move(found);
}

ImageCorrelation::ImageCorrelation(files::Picture reference, ImageMesh mesh, CorrelationOptions options,
                                   const files::Picture& mask) {
  if (!mask.pixels.empty()) require_same_size(mask, reference.width, reference.height, "the mask");
  work_ = std::make_unique<Work>(std::move(reference), mask, std::move(mesh), options);
}
ImageCorrelation::~ImageCorrelation() = default;
ImageCorrelation::ImageCorrelation(ImageCorrelation&&) noexcept = default;
ImageCorrelation& ImageCorrelation::operator=(ImageCorrelation&&) noexcept = default;

const ImageMesh& ImageCorrelation::mesh() const {
  return work_->fine.mesh();
}
const CorrelationOptions& ImageCorrelation::options() const {
  return work_->options;
}
Eigen::SparseMatrix<double> ImageCorrelation::matrix(const std::vector<char>& element_valid) const {
  return work_->fine.matrix(element_valid);
}
Eigen::SparseMatrix<double> ImageCorrelation::matrix() const {
  return work_->fine.matrix(work_->fine.usable());
}
Eigen::SparseMatrix<double> ImageCorrelation::precision(const std::vector<char>& element_valid, double gamma,
                                                        double reference_count, double gain) const {
  require_noise(gamma);
  const double of_noise = texture_of_noise(gamma, reference_count, work_->options.prefilter_sigma);
  return work_->matrix_without_noise(element_valid, of_noise) /
         difference_variance(gamma, reference_count, gain);
}
Eigen::VectorXd ImageCorrelation::displacement_std(const std::vector<char>& element_valid, double gamma,
                                                   double reference_count, double gain) const {
  if (!(work_->options.regularisation > 0)) return plain_std(element_valid, gamma, reference_count, gain);
  const Eigen::SparseMatrix<double> p = precision(element_valid, gamma, reference_count, gain);
  // M and A in units of the precision; P = (M − 2D)/v, so that A_t = M − D + R = (M + v P)/2 + R.
  const double v = difference_variance(gamma, reference_count, gain);
  const Eigen::SparseMatrix<double> m = matrix(element_valid) / v,
                                    a = 0.5 * (m + p) + work_->fine.penalty(element_valid) / v;
  // diag(A⁻¹ M A⁻¹) = −d/dt diag((A + t M)⁻¹): two selected inversions instead of a dense inverse.
  constexpr double k_step = 1e-3;
  const Eigen::VectorXd less = imaging::displacement_std(a - k_step * m),
                        more = imaging::displacement_std(a + k_step * m);
  Eigen::VectorXd std =
      ((less.array().square() - more.array().square()) / (2 * k_step)).max(0.0).sqrt().matrix();
  const auto measured = measured_nodes(mesh(), element_valid);
  for (int n = 0; n < mesh().node_count(); ++n)
    if (measured[n] == 0) std.segment<2>(2 * n).setZero();
  return std;
}
/// Between two noises 1/(P⁻¹)_kk goes linearly with γ² to 1e-4 of it (exactly, if nodes did not share
/// elements), so that it need not be found again for every picture; the two are from a fixed list, so that it
/// does not matter which pictures there were before.
Eigen::VectorXd ImageCorrelation::plain_std(const std::vector<char>& element_valid, double gamma,
                                            double reference_count, double gain) const {
  require_noise(gamma);
  const double a = gamma * gamma / reference_count * gradient_noise_variance(work_->options.prefilter_sigma);
  const int below = std::floor(k_per_octave * std::log2(a));
  const double left = std::exp2(below / k_per_octave), right = std::exp2((below + 1) / k_per_octave),
               share = (a - left) / (right - left);
  const Eigen::ArrayXd inverse = (1 - share) * work_->inverse_diagonal(element_valid, below) +
                                 share * work_->inverse_diagonal(element_valid, below + 1);
  const double variance = difference_variance(gamma, reference_count, gain);
  return (inverse > 0).select((variance / inverse).sqrt(), 0.0).matrix();
}
double ImageCorrelation::difference_variance(double gamma, double reference_count, double gain) const {
  if (!work_->noise_factor)
    work_->noise_factor =
        prefilter_noise_factor(reference_rows(), mesh().bounds(), work_->options.prefilter_sigma);
  return gamma * gamma * (1 / reference_count + gain * gain) * *work_->noise_factor;
}
ReferenceRows ImageCorrelation::reference_rows() const {
  return work_->fine.reference().view();
}
const SplineImage& ImageCorrelation::deformed_image() const {
  return work_->deformed;
}
const std::vector<char>& ImageCorrelation::usable_elements() const {
  return work_->fine.usable();
}
const files::Picture& ImageCorrelation::reference() const {
  return work_->reference;
}
double ImageCorrelation::contrast() const {
  return work_->fine.contrast();
}
const PixelTable& ImageCorrelation::pixels() const {
  return work_->fine.pixels();
}
const std::vector<double>& ImageCorrelation::element_gradient() const {
  return work_->fine.element_gradient();
}

CorrelationResult ImageCorrelation::correlate(const files::Picture& deformed, const Eigen::VectorXd& start,
                                              const std::vector<char>& start_valid,
                                              const Eigen::VectorXd& prediction) {
  require_same_size(deformed, work_->reference.width, work_->reference.height, "the deformed picture");
  const Index dofs = 2 * mesh().node_count();
  for (const Eigen::VectorXd* given : {&start, &prediction})
    if (given->size() != 0 && given->size() != dofs)
      throw UsageError(fmt::format("image correlation: {} displacements to start with, the mesh has {}",
                                   given->size(), dofs));
  CorrelationResult result;
  result.displacement = start.size() != 0 ? start : Eigen::VectorXd(Eigen::VectorXd::Zero(dofs));
  // The first two that differ are soon found in a picture of something.
  const auto other =
      std::adjacent_find(deformed.pixels.begin(), deformed.pixels.end(), std::not_equal_to<>());
  if (other == deformed.pixels.end()) {
    result.message =
        fmt::format("the picture is uniform (every pixel is {:.0f}): nothing can be followed in it",
                    static_cast<double>(deformed.pixels.front()));
    result.displacement.setZero();
    result.element_valid.assign(mesh().elements.size(), 0);
    result.element_residual.assign(mesh().elements.size(), 0);
    result.elements_rejected = mesh().element_count();
    return result;
  }
  if (start.size() != 0) {
    work_->look_at(deformed);
    if (start_valid.size() == mesh().elements.size()) result.element_valid = start_valid;
    if (prediction.size() != 0 && (prediction - start).cwiseAbs().maxCoeff() > k_same_start) {
      const double misfit = work_->fine.misfit(work_->deformed, result);
      result.displacement = prediction;
      result.predicted = work_->fine.misfit(work_->deformed, result) < misfit;
      if (!result.predicted) result.displacement = start;
    }
    if (work_->fine.correlate(work_->deformed, result, k_far)) {
      work_->fine.remove_regularisation(work_->deformed, result);
      return result;
    }
    result = {};
    result.displacement.setZero(dofs);
  }
  work_->search(deformed, result);
  work_->fine.remove_regularisation(work_->deformed, result);
  return result;
}

void ImageCorrelation::set_deformed(const files::Picture& deformed) {
  work_->look_at(deformed);
}

std::vector<float> ImageCorrelation::residual_picture(const CorrelationResult& result) const {
  const auto& fine = work_->fine;
  const std::size_t width = fine.reference().width;
  std::vector<float> residual(width * fine.reference().height, std::numeric_limits<float>::quiet_NaN());
  for (Index e = 0; e < std::ssize(fine.mesh().elements); ++e)
    residual_pixels(fine.pixels(), fine.pixels().elements()[e], fine.reference().view(), work_->deformed,
                    fine.motion(e, result), residual.data(), width);
  return residual;
}

}  // namespace knothe::imaging
