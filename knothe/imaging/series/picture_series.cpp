#include "knothe/imaging/series/picture_series.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <string_view>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"
#include "knothe/imaging/mesh/mesh_field.hpp"
#include "knothe/imaging/series/pattern_report.hpp"
#include "knothe/imaging/series/textured_region.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_margin = 10;    // px left free around the default region, for motions out of the picture
constexpr double k_min_depth = 3;  // bits between a picture and the reference, by which it is multiplied
constexpr double k_residual_growth = 2;    // from one picture to the next, that makes a warm start doubtful
constexpr double k_rejected_growth = 0.1;  // of the elements, the same
constexpr double k_moved = 0.05;  // of the variance of the difference of two references: `share_of_motion`
constexpr double k_foreign_residual = 0.75;  // of the contrast: the picture shows another surface

Region region_of(const files::Picture& mask) {
  const double width = mask.width, height = mask.height;
  Region box{width, height, -1, -1};
  for (int y = 0; y < mask.height; ++y)
    for (int x = 0; x < mask.width; ++x)
      if (mask.at(x, y) > 0)
        box = {std::min<double>(box.x0, x), std::min<double>(box.y0, y), std::max<double>(box.x1, x),
               std::max<double>(box.y1, y)};
  if (box.x1 < 0)
    throw UsageError(
        "the mask is black everywhere: it must be bright (not 0) where the surface is to be measured");
  return box;
}

/// Standard deviation of the grey levels of a picture.
double spread_of(const files::Picture& picture) {
  double sum = 0, squares = 0;
  for (const double level : picture.pixels) sum += level, squares += level * level;
  const double count = picture.pixels.size();
  return std::sqrt(std::max(0.0, squares / count - std::pow(sum / count, 2)));
}

/// Of its pixels; another in another process.
std::size_t mark_of(const files::Picture& picture) {
  return std::hash<std::string_view>()(
      {reinterpret_cast<const char*>(picture.pixels.data()), picture.pixels.size() * sizeof(float)});
}

bool is_better(const CorrelationResult& a, const CorrelationResult& b) {
  if (a.converged != b.converged) return a.converged;
  if (a.converged && a.elements_rejected != b.elements_rejected)
    return a.elements_rejected < b.elements_rejected;
  return a.residual_rms < b.residual_rms;
}

}  // namespace

files::Picture read_mask(const std::string& path) {
  files::Picture mask = files::read_picture(path);
  const float threshold = mask.remark.empty() ? 0 : mask.maximum / 2;
  for (float& level : mask.pixels) level = level > threshold ? mask.maximum : 0;
  return mask;
}

files::Picture averaged(const std::vector<files::Picture>& pictures, const std::vector<std::string>& names) {
  files::Picture mean = pictures.front();
  std::vector<double> sum(mean.pixels.size(), 0);
  for (Index i = 0; i < std::ssize(pictures); ++i) {
    if (pictures[i].width != mean.width || pictures[i].height != mean.height)
      throw UsageError(fmt::format("{} has {} × {} pixels, the reference picture {} has {} × {}", names[i],
                                   pictures[i].width, pictures[i].height, names.front(), mean.width,
                                   mean.height));
    for (Index k = 0; k < std::ssize(sum); ++k) sum[k] += pictures[i].pixels[k];
  }
  for (Index k = 0; k < std::ssize(sum); ++k) mean.pixels[k] = sum[k] / pictures.size();
  return mean;
}

PictureSeries::PictureSeries(SeriesOptions options) : options_(std::move(options)) {
  if (options_.references.empty()) throw UsageError("image correlation needs a reference picture");
  if (!options_.times.empty() && options_.times.size() != options_.pictures.size())
    throw UsageError(
        fmt::format("{} times for {} pictures", options_.times.size(), options_.pictures.size()));
  if (options_.reference_update > 0 && options_.crack)
    throw UsageError(
        "a crack is measured against the reference picture: it cannot be combined with another reference in "
        "between (reference_update)");
  if (options_.correlation.threads <= 0) options_.correlation.threads = default_threads();
  std::vector<files::Picture> references;
  for (const std::string& path : options_.references) {
    files::Picture picture = files::read_picture(path, options_.colour);
    remark(picture.remark);
    references.push_back(references.empty() ? std::move(picture)
                                            : with_levels_of(references.front(), std::move(picture), path));
  }
  files::Picture reference =
      references.size() == 1 ? std::move(references.front()) : averaged(references, options_.references);
  files::Picture mask;
  if (!options_.mask.empty()) mask = read_mask(options_.mask);
  if (!mask.pixels.empty() && (mask.width != reference.width || mask.height != reference.height))
    throw UsageError(fmt::format("the mask {} has {} × {} pixels, the reference picture {} has {} × {}",
                                 options_.mask, mask.width, mask.height, options_.references.front(),
                                 reference.width, reference.height));
  ImageMesh mesh;
  if (options_.mesh) {
    const Region picture{0, 0, reference.width - 1.0, reference.height - 1.0};
    mesh = elements_inside(*options_.mesh, options_.region.value_or(picture), picture);
    options_.region = mesh.bounds();
  } else {
    if (!options_.region) options_.region = mask.pixels.empty() ? find_region(reference) : region_of(mask);
    mesh = structured_mesh(*options_.region, options_.element_size, options_.shape);
  }
  if (options_.find_prefilter) find_prefilter(reference, mesh.bounds());
  if (!mask.pixels.empty()) {
    (void)PixelTable(mesh, reference.width, reference.height);  // outside the picture: the better message
    mesh = masked(mesh, mask);
  }
  if (options_.mesh && options_.outline_margin > 0)
    mask = without_outline(MeshField(*options_.mesh), reference.width, reference.height,
                           options_.outline_margin, mask);
  find_noise(references);
  if (known_noise_ > 0)
    options_.correlation.least_texture =
        texture_of_noise(known_noise_, reference_count(), options_.correlation.prefilter_sigma);
  correlation_ =
      std::make_unique<ImageCorrelation>(std::move(reference), std::move(mesh), options_.correlation, mask);
  contrast_ = correlation_->contrast();
  if (options_.crack && options_.mesh && options_.crack->gap == 0) {
    const Region bounds = correlation_->mesh().bounds();
    options_.crack->gap =
        2 + 0.5 * std::sqrt(bounds.width() * bounds.height() / correlation_->mesh().element_count());
  }
  prefetch(0);
}

/// As it is stated, or from what repeated references differ by; 0: not known.
void PictureSeries::find_noise(const std::vector<files::Picture>& references) {
  known_noise_ = options_.noise;
  if (known_noise_ > 0 || references.size() < 2) return;
  double squares = 0;
  for (Index i = 1; i < std::ssize(references); ++i) {
    squares += std::pow(noise_from_repeat(references[i - 1], references[i], *options_.region), 2);
    if (share_of_motion(references[i - 1], references[i], *options_.region) > k_moved)
      remark(fmt::format(
          "{}: the surface has moved since {}: the noise that their difference tells is too large; "
          "references must all show the surface at rest, without load",
          options_.references[i], options_.references[i - 1]));
  }
  known_noise_ = std::max(k_quantisation_noise, std::sqrt(squares / (references.size() - 1)));
}

void PictureSeries::remark(const std::string& text) {
  if (!text.empty() && std::find(remarks_.begin(), remarks_.end(), text) == remarks_.end())
    remarks_.push_back(text);
}

Region PictureSeries::find_region(const files::Picture& reference) {
  const auto region = textured_region(reference, k_margin);
  if (!region) return {k_margin, k_margin, reference.width - 1 - k_margin, reference.height - 1 - k_margin};
  remark(fmt::format(
      "the pattern fills the region {:.0f},{:.0f},{:.0f},{:.0f}, which is measured (--roi, dic.roi)",
      region->x0, region->y0, region->x1, region->y1));
  return *region;
}

void PictureSeries::find_prefilter(const files::Picture& reference, const Region& region) {
  const auto size = speckle_size(reference, region);
  const double smallest = std::min(size[0], size[1]);
  if (!(smallest > 0 && smallest < k_aliased_speckle)) return;
  options_.correlation.prefilter_sigma = 1;
  remark(fmt::format(
      "speckles of {:.1f} px are aliased: pictures are filtered by a Gaussian of 1 px (--prefilter, "
      "dic.prefilter)",
      smallest));
}

/// A picture of another depth whose levels are several times those of the reference (8 bits against 16, or 8
/// bits stored in 16) is multiplied by a power of two.
files::Picture PictureSeries::with_levels_of(const files::Picture& reference, files::Picture picture,
                                             const std::string& name) {
  if (picture.bit_depth == reference.bit_depth) return picture;
  const double spread = spread_of(picture);
  if (!(spread > 0)) return picture;
  const double power = std::round(std::log2(spread_of(reference) / spread));
  if (std::abs(power) < k_min_depth) return picture;
  const float factor = std::exp2(power);
  remark(fmt::format("{}: {} bits, the reference {}: grey levels are multiplied by {}", name,
                     picture.bit_depth, reference.bit_depth, factor));
  for (float& level : picture.pixels) level *= factor;
  picture.maximum *= factor, picture.bit_depth = reference.bit_depth;
  return picture;
}

/// For a picture that did not converge.
std::string PictureSeries::what_to_try() const {
  std::vector<std::string> advice;
  if (!(options_.correlation.prefilter_sigma > 0))
    advice.emplace_back("a Gaussian on the pictures (--prefilter 1)");
  if (!options_.mesh)
    advice.push_back(fmt::format("larger elements (--element-size {:.0f})", 2 * options_.element_size));
  advice.emplace_back("a region or mask that holds the surface only (--roi, --mask; --maps shows it)");
  if (options_.correlation.regularisation == 0)
    advice.emplace_back("regularisation of some elements' size (dic.regularisation)");
  advice.emplace_back(
      "pictures in between, if more than half of the region has left the picture, or it is stretched by more "
      "than a fifth");
  return fmt::format("try {}", fmt::join(advice, ", or "));
}

PictureSeries::~PictureSeries() {
  if (reading_.valid()) reading_.wait();
}

void PictureSeries::prefetch(std::size_t index) {
  if (index < options_.pictures.size())
    reading_ = std::async(std::launch::async, [path = options_.pictures[index], colour = options_.colour] {
      return files::read_picture(path, colour);
    });
}

/// What makes a picture unusable before it is looked at closely; empty if nothing does.
std::string PictureSeries::fault(const files::Picture& picture, std::size_t mark,
                                 const std::string& name) const {
  const files::Picture& reference = correlation_->reference();
  if (picture.width != reference.width || picture.height != reference.height)
    return fmt::format(
        "{}: error: the picture has {} × {} pixels, the reference picture {} × {}: all pictures of a series "
        "must be of one size",
        name, picture.width, picture.height, reference.width, reference.height);
  const float level = picture.pixels.front();
  if (std::all_of(picture.pixels.begin(), picture.pixels.end(), [&](float v) { return v == level; }))
    return fmt::format("{}: error: the picture is {} (every pixel is {:.0f}): nothing can be followed in it",
                       name, level > 0 ? "uniform" : "black", static_cast<double>(level));
  if (!latest_name_.empty() && mark == latest_mark_)
    return fmt::format(
        "{}: error: the picture is the same as {}, pixel by pixel: a camera never takes that; it is a copy",
        name, latest_name_);
  return {};
}

void PictureSeries::resume(std::size_t index, const CorrelationResult& last) {
  if (index > options_.pictures.size() ||
      (last.displacement.size() != 0 && last.displacement.size() != 2 * correlation_->mesh().node_count()))
    throw UsageError(fmt::format(
        "the series of {} pictures with {} nodes cannot go on at picture {} from {} displacements",
        options_.pictures.size(), correlation_->mesh().node_count(), index, last.displacement.size()));
  if (options_.reference_update > 0 && index > 0)
    throw UsageError(
        "a series with a reference that may be replaced (reference_update) cannot be resumed: start it "
        "again");
  if (reading_.valid()) reading_.wait();
  next_ = index;
  start_ = last.displacement, start_valid_ = last.element_valid;
  last_residual_ = last.residual_rms, last_rejected_ = last.elements_rejected;
  prefetch(next_);
}

PictureResult PictureSeries::next() {
  const std::size_t index = next_++;
  const std::string name = options_.pictures[index];
  PictureResult result;
  try {
    files::Picture picture = reading_.get();
    prefetch(next_);
    result = correlate(std::move(picture), name);
  } catch (const Error& error) {
    if (!reading_.valid()) prefetch(next_);
    result.missing = true, result.message = error.what();
    if (result.message.find(name) == std::string::npos) result.message = name + ": error: " + result.message;
    result.correlation.displacement.setZero(2 * correlation_->mesh().node_count());
    result.correlation.element_valid.assign(correlation_->mesh().elements.size(), 0);
    result.correlation.element_residual.assign(correlation_->mesh().elements.size(), 0);
  }
  result.index = index, result.picture = name;
  return result;
}

bool PictureSeries::is_foreign(const CorrelationResult& result) const {
  return result.residual_rms > k_foreign_residual * contrast_;
}

/// From where the last picture was, against the reference of the time.
CorrelationResult PictureSeries::track(const files::Picture& picture) {
  if (moved_) {
    correlation_->set_deformed(picture);  // for maps of the residual
    return moved_->correlate(picture, start_);
  }
  CorrelationResult best =
      correlation_->correlate(picture, start_, start_valid_, std::exchange(prediction_, {}));
  const double elements = correlation_->mesh().element_count();
  if (!best.searched && (!best.converged || is_foreign(best) ||
                         (last_residual_ > 0 && best.residual_rms > k_residual_growth * last_residual_) ||
                         best.elements_rejected > last_rejected_ + k_rejected_growth * elements)) {
    CorrelationResult again = correlation_->correlate(picture);
    if (is_better(again, best)) best = std::move(again);
  }
  return best;
}

/// Where the reference no longer explains the picture, the last good one may.
void PictureSeries::try_other_reference(const files::Picture& picture, CorrelationResult& best) {
  const double elements = correlation_->mesh().element_count();
  const bool poor = !best.converged || is_foreign(best) ||
                    best.residual_rms > options_.reference_update * first_residual_ ||
                    best.elements_rejected > first_rejected_ + k_rejected_growth * elements;
  const CorrelationResult& base = last_good_.correlation;
  if (!poor || base.displacement.size() == 0 || last_good_.picture == moved_name_) return;
  try {
    auto other = std::make_unique<MovedReference>(last_picture_, correlation_->mesh(), base,
                                                  precision(last_good_, last_good_.noise, base.gain).std,
                                                  options_.correlation);
    CorrelationResult result = other->correlate(picture, base.displacement);
    const bool same = best.converged && !is_foreign(best) && best.residual_rms <= result.residual_rms &&
                      best.elements_rejected <= result.elements_rejected;
    if (!result.converged || is_foreign(result) || same) return;
    moved_ = std::move(other), moved_name_ = last_good_.picture;
    best = std::move(result);
    first_residual_ = 0;
    const auto total = options_.pictures.size(), index = std::max<std::size_t>(next_, 1) - 1;
    sharing_ = total > index ? total - index : 1;
  } catch (const UsageError&) {
    // Nothing that could be followed is left in the last good picture: the reference stays.
  }
}

/// γ of a converged picture, and how errors have added up.
void PictureSeries::note_noise(PictureResult& result) {
  const CorrelationResult& c = result.correlation;
  if (known_noise_ > 0) {
    result.noise = known_noise_;
  } else {
    const double seen = moved_ ? moved_->noise() : noise_from_residual(*correlation_, c, reference_count());
    result.noise = std::max(k_quantisation_noise, seen);
  }
  if (moved_) {
    result.reference = moved_name_;
    auto noise = moved_->noise_of_last(result.noise);
    // The likelihood takes half of a step's covariance for its own (the other half for the reference's): m
    // pictures with own errors I/2 + m B tell as much as one error B allows.
    double own = 0, base = 0;
    for (Index i = 0; i < noise.std.size(); ++i)
      if (noise.std[i] > 0)
        own += std::pow(noise.increment_std[i], 2), base += std::pow(moved_->base_std()[i], 2);
    const double share = own > 0 ? own / (own + 2 * sharing_ * base) : 1;
    result.accumulated = AccumulatedNoise{result.noise, share * noise.increment, std::move(noise.std)};
  }
}

PictureResult PictureSeries::correlate(files::Picture picture, const std::string& name) {
  remark(picture.remark);
  picture = with_levels_of(correlation_->reference(), std::move(picture), name);
  const std::size_t mark = mark_of(picture);
  if (const std::string reason = fault(picture, mark, name); !reason.empty()) throw DataError(reason);
  latest_mark_ = mark, latest_name_ = name;
  const auto begin = std::chrono::steady_clock::now();
  PictureResult result;
  result.picture = name;
  CorrelationResult& best = result.correlation;
  best = track(picture);
  if (options_.reference_update > 0) try_other_reference(picture, best);
  if (best.converged && is_foreign(best)) {
    best.converged = false;
    best.message = fmt::format(
        "the residual of {:.3g} grey levels is nearly the contrast of the reference, {:.3g}: the picture "
        "does not show its surface, or moved farther than the search reaches",
        best.residual_rms, contrast_);
  }
  result.elapsed_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  if (!best.converged) {
    result.missing = true;
    result.message = fmt::format("{}: error: not converged: {}; {}", name, best.message, what_to_try());
    return result;
  }
  start_ = best.displacement, start_valid_ = best.element_valid;
  last_residual_ = best.residual_rms, last_rejected_ = best.elements_rejected;
  note_noise(result);
  if (options_.reference_update > 0) {
    if (!(first_residual_ > 0)) first_residual_ = best.residual_rms, first_rejected_ = best.elements_rejected;
    last_picture_ = std::move(picture), last_good_ = result;
  }
  if (options_.crack) {
    const auto start = std::chrono::steady_clock::now();
    result.crack = measure_crack(*correlation_, best, result.noise, reference_count(), *options_.crack);
    result.crack_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  }
  return result;
}

DisplacementPrecision PictureSeries::precision(const std::vector<char>& element_valid, double gamma,
                                               double gain) const {
  return displacement_precision(*correlation_, element_valid, gamma, reference_count(), gain);
}

Eigen::VectorXd PictureSeries::displacement_std(const PictureResult& result) const {
  if (result.missing) return {};
  if (result.accumulated) return result.accumulated->std * (result.noise / result.accumulated->gamma);
  return imaging::displacement_std(*correlation_, result.correlation.element_valid, result.noise,
                                   reference_count(), result.correlation.gain);
}

DisplacementPrecision PictureSeries::precision(const PictureResult& result, double gamma, double gain) const {
  if (!result.accumulated) return precision(result.correlation.element_valid, gamma, gain);
  const double ratio = gamma / result.accumulated->gamma;
  return {result.accumulated->precision / (ratio * ratio), result.accumulated->std * ratio};
}

}  // namespace knothe::imaging
