#include "knothe/imaging/correlation/matched_motion.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/imaging/correlation/spline_image.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_fine = 1.2, k_coarse = 2.4;  // px: the Gaussians whose difference shows blobs
constexpr int k_rings = 6, k_angles = 20;       // points that are read around a feature
constexpr float k_ring_step = 2;                // px from ring to ring
constexpr int k_reach = 13;                     // px from a feature to the last pixel that is read
constexpr double k_features = 400;              // in the reference, and as many per area in the other picture
constexpr Index k_max_features = 2400;
constexpr Index k_min_pairs = 8;  // that must agree
constexpr int k_trials = 4000;
constexpr double k_agrees = 3;                          // px between a pair and a motion
constexpr double k_min_area = 200;                      // px² of the triangle of three features
constexpr double k_min_change = 0.5, k_max_change = 2;  // of an area
constexpr double k_max_shear = 0.5;                     // difference of the two stretches

struct Feature {
  int x, y;
  float strength;
};

/// Features and how they look: one a column, of mean 0 and length 1.
struct Described {
  std::vector<Feature> features;
  Eigen::MatrixXf look;
};

struct Pair {
  Eigen::Vector2d from, to;
};

files::Picture smoothed(const files::Picture& picture, double sigma, int threads) {
  files::Picture out = picture;
  filter_picture(picture.pixels.data(), picture.width, picture.height, gaussian_taps(sigma),
                 out.pixels.data(), picture.width, threads);
  return out;
}

bool is_extremal(const files::Picture& band, int x, int y) {
  const float value = band.at(x, y);
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      const float other = band.at(x + dx, y + dy);
      if ((dx != 0 || dy != 0) && !(value > 0 ? value > other : value < other)) return false;
    }
  return true;
}

/// The strongest `count` extrema.
std::vector<Feature> features_of(const files::Picture& band, const files::Picture& mask, Index count) {
  std::vector<Feature> found;
  for (int y = k_reach; y < band.height - k_reach; ++y)
    for (int x = k_reach; x < band.width - k_reach; ++x)
      if ((mask.pixels.empty() || mask.at(x, y) > 0) && is_extremal(band, x, y))
        found.push_back({x, y, std::abs(band.at(x, y))});
  std::stable_sort(found.begin(), found.end(),
                   [](const Feature& a, const Feature& b) { return a.strength > b.strength; });
  if (std::ssize(found) > count) found.resize(count);
  return found;
}

/// Bilinear.
float between_pixels(const files::Picture& picture, float x, float y) {
  const int i = x, j = y;
  const float s = x - i, t = y - j, *upper = picture.row(j) + i, *lower = picture.row(j + 1) + i;
  return (1 - t) * ((1 - s) * upper[0] + s * upper[1]) + t * ((1 - s) * lower[0] + s * lower[1]);
}

using Direction = std::array<float, 2>;  // cosine and sine
const std::array<Direction, k_angles>& directions() {
  static const auto made = [] {
    std::array<Direction, k_angles> circle{};
    for (Index a = 0; a < k_angles; ++a) {
      const float angle = 2 * std::numbers::pi_v<float> * a / k_angles;
      circle[a] = {std::cos(angle), std::sin(angle)};
    }
    return circle;
  }();
  return made;
}

/// Calls `read(radius, direction, level)` for the points around a feature, turned by `first`.
template <class Read>
void each_point_around(const files::Picture& picture, const Feature& f, const Direction& first,
                       const Read& read) {
  for (int ring = 1; ring <= k_rings; ++ring) {
    const float radius = k_ring_step * ring;
    for (const Direction& d : directions()) {
      const float x = d[0] * first[0] - d[1] * first[1], y = d[1] * first[0] + d[0] * first[1];
      read(radius, d, between_pixels(picture, f.x + radius * x, f.y + radius * y));
    }
  }
}

/// Where the first harmonic of the levels around a feature points to.
Direction orientation(const files::Picture& picture, const Feature& feature) {
  float c = 0, s = 0;
  each_point_around(picture, feature, {1, 0},
                    [&](float, const Direction& d, float level) { c += level * d[0], s += level * d[1]; });
  const float length = std::hypot(c, s);
  return length > 0 ? Direction{c / length, s / length} : Direction{1, 0};
}

Described described(const files::Picture& picture, const files::Picture& mask, Index count, int threads) {
  const files::Picture fine = smoothed(picture, k_fine, threads);
  files::Picture band = smoothed(picture, k_coarse, threads);
  for (Index i = 0; i < std::ssize(band.pixels); ++i) band.pixels[i] = fine.pixels[i] - band.pixels[i];
  Described made{features_of(band, mask, count), {}};
  made.look.resize(k_rings * k_angles, std::ssize(made.features));
  for (Index k = 0; k < std::ssize(made.features); ++k) {
    const Feature& feature = made.features[k];
    auto look = made.look.col(k);
    Index i = 0;
    // A point stands for an area that grows with the radius.
    each_point_around(
        fine, feature, orientation(fine, feature),
        [&](float radius, const Direction&, float level) { look[i++] = std::sqrt(radius) * level; });
    look.array() -= look.mean();
    look.normalize();
  }
  return made;
}

/// Features that are each other's best match.
std::vector<Pair> pairs_of(const Described& f, const Described& g) {
  const Eigen::MatrixXf likeness = g.look.transpose() * f.look;
  std::vector<Index> best_of_g(g.features.size());
  for (Index j = 0; j < std::ssize(g.features); ++j) likeness.row(j).maxCoeff(&best_of_g[j]);
  std::vector<Pair> pairs;
  for (Index i = 0; i < std::ssize(f.features); ++i) {
    Index j = 0;
    likeness.col(i).maxCoeff(&j);
    const Feature &from = f.features[i], &to = g.features[j];
    if (best_of_g[j] == i) pairs.push_back({Eigen::Vector2d(from.x, from.y), Eigen::Vector2d(to.x, to.y)});
  }
  return pairs;
}

bool agrees(const AffineMotion& motion, const Pair& pair) {
  return (motion.moved(pair.from) - pair.to).squaredNorm() < k_agrees * k_agrees;
}

/// The motion of three pairs, where a surface may move like that.
std::optional<AffineMotion> motion_of(const Pair& a, const Pair& b, const Pair& c) {
  Eigen::Matrix2d from, to;
  from << b.from - a.from, c.from - a.from;
  to << b.to - a.to, c.to - a.to;
  if (!(std::abs(from.determinant()) > 2 * k_min_area)) return std::nullopt;
  AffineMotion motion;
  motion.gradient = to * from.inverse();
  // With the stretches s₁, s₂: det F = s₁ s₂ and |F|² = s₁² + s₂².
  const double area = motion.gradient.determinant(), shear = motion.gradient.squaredNorm() - 2 * area;
  if (!(area > k_min_change && area < k_max_change && shear < k_max_shear * k_max_shear)) return std::nullopt;
  motion.shift = a.to - motion.gradient * a.from;
  return motion;
}

/// Least squares over the pairs that agree with a motion.
AffineMotion refitted(const AffineMotion& motion, const std::vector<Pair>& pairs) {
  Eigen::Matrix2Xd from(2, std::ssize(pairs)), to = from;
  Index count = 0;
  for (const Pair& pair : pairs)
    if (agrees(motion, pair)) from.col(count) = pair.from, to.col(count++) = pair.to;
  return fitted_motion(from.leftCols(count), to.leftCols(count));
}

/// Numbers 0 … n − 1, the same every time (Knuth's linear congruential generator).
class Drawing {
 public:
  explicit Drawing(std::size_t n) : n_(n) {}
  std::size_t operator()() {
    state_ = state_ * 6364136223846793005U + 1442695040888963407U;
    return (state_ >> 33) % n_;
  }

 private:
  std::size_t n_;
  std::uint64_t state_ = 1;
};

}  // namespace

std::optional<AffineMotion> matched_motion(const PyramidLevel& reference, const files::Picture& deformed,
                                           int threads) {
  const double pixels = deformed.pixels.size(),
               seen = reference.mask.pixels.empty() ? pixels
                                                    : pixels - std::count(reference.mask.pixels.begin(),
                                                                          reference.mask.pixels.end(), 0.0F);
  if (!(seen > 0)) return std::nullopt;
  const Index in_both = std::min(1.0 * k_max_features, k_features * pixels / seen);
  const Described f = described(reference.picture, reference.mask, k_features, threads),
                  g = described(deformed, {}, in_both, threads);
  if (std::min(std::ssize(f.features), std::ssize(g.features)) < k_min_pairs) return std::nullopt;
  const std::vector<Pair> pairs = pairs_of(f, g);
  if (std::ssize(pairs) < k_min_pairs) return std::nullopt;
  AffineMotion best;
  Index most = 0;
  Drawing draw(pairs.size());
  for (int trial = 0; trial < k_trials; ++trial) {
    const std::size_t a = draw(), b = draw(), c = draw();
    const auto motion = motion_of(pairs[a], pairs[b], pairs[c]);
    if (!motion) continue;
    const Index agreeing =
        std::count_if(pairs.begin(), pairs.end(), [&](const Pair& pair) { return agrees(*motion, pair); });
    if (agreeing > most) most = agreeing, best = *motion;
  }
  if (most < k_min_pairs) return std::nullopt;
  for (int round = 0; round < 3; ++round) best = refitted(best, pairs);
  return best;
}

}  // namespace knothe::imaging
