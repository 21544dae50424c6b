#include "knothe/imaging/crack/crack_measurement.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/imaging/crack/crack_opening.hpp"
#include "knothe/imaging/crack/crack_path.hpp"
#include "knothe/imaging/crack/crack_tip.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_min_evidence = 10;  // natural log: 1 : 22,000, since many places were searched
constexpr double k_default_gap = 3;    // px
constexpr double k_resolution = 0.25;  // of a window's reach: the motion around a tip is not linear over it
constexpr double k_path_std = 1;       // px: interpolation mixes the sides within about two pixels
constexpr double k_closing = -0.5;   // component across the path of the opening's direction: less is closing
constexpr double k_significant = 4;  // standard deviations of a jump that tells the direction

/// Unit vector (t, s) along which the sides part: that of the jumps that stand out, the largest counting
/// most.
std::array<double, 2> opening_direction(const std::vector<SideJump>& jumps) {
  std::array<double, 2> sum{};
  for (const auto& j : jumps) {
    const double size = std::hypot(j.jump[0], j.jump[1]);
    if (!j.measured || size < k_significant * std::sqrt(j.covariance[0] + j.covariance[2])) continue;
    sum[0] += j.jump[0], sum[1] += j.jump[1];
  }
  const double norm = std::hypot(sum[0], sum[1]);
  return norm > 0 ? std::array<double, 2>{sum[0] / norm, sum[1] / norm} : std::array<double, 2>{1, 0};
}

double variance_along(const SideJump& j, double t, double s) {
  return t * t * j.covariance[0] + 2 * t * s * j.covariance[1] + s * s * j.covariance[2];
}

/// The path's points with their openings, in the order of `jumps` or the other way round.
std::vector<CrackPoint> points_of(const std::vector<SideJump>& jumps, const RoughPath& path,
                                  const CrackView& view, const std::array<double, 2>& d, bool reversed) {
  std::vector<CrackPoint> points;
  double along = 0;
  for (Index k = 0; k < std::ssize(jumps); ++k) {
    const std::size_t i = reversed ? jumps.size() - 1 - k : k;
    const SideJump& j = jumps[i];
    CrackPoint p;
    const auto place = view.swap(j.t, j.s);
    p.x = place[0], p.y = place[1], p.position_std = std::hypot(path.std[i], k_path_std);
    along += points.empty() ? 0.5 * path.step : std::hypot(p.x - points.back().x, p.y - points.back().y);
    p.along = along, p.measured = j.measured;
    if (j.measured) {
      p.opening = d[0] * j.jump[0] + d[1] * j.jump[1], p.sliding = d[0] * j.jump[1] - d[1] * j.jump[0];
      p.opening_std = std::sqrt(std::max(1e-16, variance_along(j, d[0], d[1])));
    }
    points.push_back(p);
  }
  return points;
}

TipPosterior tip_of(const std::vector<CrackPoint>& points, double band) {
  std::vector<OpeningDatum> data;
  for (const auto& p : points)
    if (p.measured) data.push_back({p.along, band, p.opening, p.opening_std});
  return crack_tip(data);
}

std::array<double, 2> place_at(const std::vector<CrackPoint>& path, double along) {
  for (Index i = 1; i < std::ssize(path); ++i)
    if (path[i].along >= along || i + 1 == std::ssize(path)) {
      const double share =
          std::clamp((along - path[i - 1].along) / (path[i].along - path[i - 1].along), -0.5, 1.0);
      return {path[i - 1].x + share * (path[i].x - path[i - 1].x),
              path[i - 1].y + share * (path[i].y - path[i - 1].y)};
    }
  return path.empty() ? std::array<double, 2>{} : std::array<double, 2>{path[0].x, path[0].y};
}

/// Lengths from the point of the path that is nearest to a place.
void count_from(const std::array<double, 2>& origin, CrackMeasurement& crack) {
  double nearest = 1e300, start = 0;
  for (double along = 0; !crack.path.empty() && along <= crack.path.back().along; along += 0.5) {
    const auto at = place_at(crack.path, along);
    const double distance = std::hypot(at[0] - origin[0], at[1] - origin[1]);
    if (distance < nearest) nearest = distance, start = along;
  }
  for (auto& p : crack.path) p.along -= start;
  crack.length -= start, crack.interval[0] -= start, crack.interval[1] -= start;
}

/// One of the two ways a crack may run, measured.
CrackMeasurement measured_along(const CrackScene& scene, const RoughPath& rough,
                                const CrackSearchOptions& options, double variance) {
  const double gap = options.gap > 0 ? options.gap : k_default_gap,
               reach = options.reach > 0 ? options.reach : 1.5 * scene.element,
               band = options.band > 0 ? options.band : std::max(6.0, 0.5 * scene.element);
  // The elements tell the path to about one of them; then nearer, with nodes from nearer to it.
  RoughPath path = refined_path(scene, rough, band, std::max(1.5 * scene.element, gap), 1.5 * scene.element);
  path = refined_path(scene, path, band, std::max(1.05 * scene.element, gap), 0.5 * scene.element);
  const auto jumps = side_jumps(scene, path, gap, reach, std::max(1.05 * scene.element, gap), variance);
  const auto direction = opening_direction(jumps);
  CrackMeasurement result;
  TipPosterior tip;
  for (const bool reversed : {false, true}) {
    auto points = points_of(jumps, path, scene.view, direction, reversed);
    const TipPosterior candidate = tip_of(points, path.step);
    if (reversed && candidate.log_evidence <= tip.log_evidence) continue;
    tip = candidate, result.path = std::move(points);
  }
  const auto first =
      std::find_if(result.path.begin(), result.path.end(), [](const auto& p) { return p.measured; });
  // Sides that come together are not a crack's, but a pressed joint's or a mistake.
  result.log_evidence = direction[0] > k_closing ? tip.log_evidence : 0;
  result.direction = scene.view.swap(direction[0], direction[1]);
  result.mouth = place_at(result.path, 0);
  result.mouth_opening = first == result.path.end() ? 0 : first->opening;
  const double resolution = k_resolution * reach;
  result.length = tip.mean, result.length_std = std::hypot(tip.std, resolution);
  result.interval = {tip.mean - std::hypot(tip.mean - tip.interval[0], 1.96 * resolution),
                     tip.mean + std::hypot(tip.interval[1] - tip.mean, 1.96 * resolution)};
  result.tip_in_view = tip.beyond < 0.5;
  result.tip = place_at(result.path, tip.mean);
  if (options.origin) count_from(*options.origin, result);
  return result;
}

}  // namespace

CrackMeasurement measure_crack(const ImageCorrelation& correlation, const CorrelationResult& result,
                               double gamma, double reference_count, const CrackSearchOptions& options) {
  if (!(gamma > 0))
    throw UsageError(
        fmt::format("crack from a picture: the noise is {} grey levels; it must be positive", gamma));
  if (options.gap < 0 || options.reach < 0 || options.band < 0)
    throw UsageError("crack from a picture: gap, reach and band are lengths in px, not negative");
  CrackMeasurement none;
  if (!result.converged) {
    none.message = "the picture was not measured";
    return none;
  }
  CrackScene scenes[2];
  RoughPath paths[2];
  for (int k = 0; k < 2; ++k) {
    scenes[k] = crack_scene(correlation, result, k == 1);
    paths[k] = stretched_path(correlation, scenes[k]);
  }
  const int way = paths[1].score > paths[0].score ? 1 : 0;
  if (!(paths[way].score > 0)) {
    none.message = "no element is stretched more than its neighbours";
    return none;
  }
  const double variance = correlation.difference_variance(gamma, reference_count, result.gain);
  CrackMeasurement measured = measured_along(scenes[way], paths[way], options, variance);
  measured.found = measured.log_evidence > k_min_evidence && measured.mouth_opening > 0;
  if (measured.found) {
    const OtherOpenings others = other_openings(correlation, scenes[way], paths[way]);
    measured.others = others.count, measured.other = others.middle;
    if (others.count > 0)
      measured.message = fmt::format(
          "{} more place{} open like a crack, the largest around ({:.0f}, {:.0f}) px: a branch or a second "
          "crack, which is not measured; path and tip are those of the widest alone",
          others.count, others.count == 1 ? " is" : "s are", others.middle[0], others.middle[1]);
  }
  if (!measured.found)
    measured.message = fmt::format("no opening that grows from a side of the mesh (log evidence {:.1f})",
                                   measured.log_evidence);
  return measured;
}

}  // namespace knothe::imaging
