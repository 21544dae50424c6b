#include "knothe/imaging/mesh/outline_registration.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/imaging/correlation/edge_search.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::imaging {

namespace {

using Complex = std::complex<double>;
using Vector4 = Eigen::Vector4d;
using Matrix4 = Eigen::Matrix4d;

constexpr double k_strip = 24;          // px along a side
constexpr double k_shortest_strip = 6;  // px
constexpr double k_longest_side = 1e6;  // px: a scale in another unit
constexpr double k_min_look = 3;        // px to look on either side
constexpr double k_reach_start = 32;    // px: how far edges are looked for at first
constexpr double k_far_share = 0.06;    // of the body's size, where that is more
constexpr double k_side_std = 0.03;     // px: what a side's edges have in common (sharpness, interpolation)
constexpr double k_side_share =
    0.5;  // … of the misfit, where that is more: a pattern that ends darker or brighter
constexpr double k_mask_side_std = 0.29;  // px: 1/√12, in a mask of whole pixels
constexpr double k_tukey = 4.685;         // standard deviations; 95 % efficient for normal errors
constexpr double k_undetermined = 1;      // px at the body's edge: a standard deviation above that is no fit
constexpr double k_worst_misfit = 2;      // px
constexpr double k_min_share = 0.3;       // of the places in view must have an edge that is used
constexpr int k_min_places = 6;

Complex upward(const std::array<double, 2>& p) {
  return {p[0], p[1]};
}

/// Pixels as complex numbers x − i y: w = A (z − z₀) + B.
struct Pose {
  Complex a, b;
  [[nodiscard]] Complex at(Complex centred) const { return a * centred + b; }
};

/// One place of one side; d measured outwards along n.
struct Place {
  std::size_t side = 0;
  Complex z;  // m, from the centre
  double d = 0, std = 1, weight = 0;
  Complex n;    // outwards, in the picture
  Vector4 row;  // d(d)/d(scale, turn, right, up), px each, the first two at the radius
  double x = 0, y = 0;
};

/// The part of the outline that is in view: errors are those of its middle and at its edge.
struct Geometry {
  Complex centre;
  double radius = 0;  // m: root mean square distance of the outline from its centre
};
Geometry geometry_of(const files::Picture& picture, const Outline& outline, const PictureFrame& start,
                     const std::string& name) {
  std::vector<std::pair<Complex, double>> seen;  // with their lengths
  double total = 0;
  for (const auto& s : outline) {
    const Complex p = upward(s.from), q = upward(s.to);
    constexpr int k_parts = 64;
    for (int i = 0; i < k_parts; ++i) {
      const Complex z = p + (i + 0.5) / k_parts * (q - p), w = (z - start.offset) / start.slope;
      if (w.real() < 0 || -w.imag() < 0 || w.real() > picture.width - 1 || -w.imag() > picture.height - 1)
        continue;
      seen.emplace_back(z, std::abs(q - p) / k_parts), total += seen.back().second;
    }
  }
  if (!(total > 0))
    throw DataError(
        fmt::format("{}: error: the outline lies outside the picture; its initial position must be accurate "
                    "to about 20 px (\"dic.scale\", \"dic.origin\")",
                    name));
  Geometry g;
  for (const auto& [z, length] : seen) g.centre += z * (length / total);
  for (const auto& [z, length] : seen) g.radius += std::norm(z - g.centre) * (length / total);
  g.radius = std::sqrt(g.radius);
  return g;
}

/// Distance from a point along a direction to the next other side of the outline, m; infinity if there is
/// none.
double free_way(const Outline& outline, Index own, Complex from, Complex direction) {
  double nearest = std::numeric_limits<double>::infinity();
  for (Index s = 0; s < std::ssize(outline); ++s) {
    if (s == own) continue;
    // from + t direction = p + u (q − p)
    const Complex p = upward(outline[s].from) - from, edge = upward(outline[s].to) - upward(outline[s].from);
    const double det = std::imag(std::conj(direction) * edge);
    if (std::abs(det) < 1e-12 * std::abs(edge)) continue;
    const double t = std::imag(std::conj(p) * edge) / det, u = std::imag(std::conj(p) * direction) / det;
    if (t > 0 && u >= 0 && u <= 1) nearest = std::min(nearest, t);
  }
  return nearest;
}

/// How far a strip may reach along a direction before it leaves the picture, px.
double way_in_picture(const files::Picture& picture, const EdgeStrip& s, double sign) {
  double way = std::numeric_limits<double>::infinity();
  for (const double t : {-0.5 * s.length, 0.5 * s.length}) {
    const std::array<double, 2> at{s.x - t * s.ny, s.y + t * s.nx}, go{sign * s.nx, sign * s.ny};
    const std::array<double, 2> limit{picture.width - 1.0, picture.height - 1.0};
    for (std::size_t k = 0; k < 2; ++k) {
      if (at[k] < 0 || at[k] > limit[k]) return 0;
      if (go[k] > 1e-12) way = std::min(way, (limit[k] - at[k]) / go[k]);
      if (go[k] < -1e-12) way = std::min(way, at[k] / -go[k]);
    }
  }
  return way;
}

/// Looks for edges along every side from a pose; `in_view` counts the places.
std::vector<Place> look(const files::Picture& picture, const Outline& outline, const Geometry& g,
                        const Pose& pose, double reach, bool fine, int& in_view) {
  std::vector<Place> found;
  in_view = 0;
  const double scale = std::abs(pose.a);
  for (Index s = 0; s < std::ssize(outline); ++s) {
    const Complex p = upward(outline[s].from) - g.centre, q = upward(outline[s].to) - g.centre;
    const double length = scale * std::abs(q - p);  // px
    const Complex along = (q - p) / std::abs(q - p), out = along * Complex(0, -1);
    const double free = length - 2 * std::min(reach, 0.25 * length);  // away from the corners
    if (free < k_shortest_strip || length > k_longest_side) continue;
    const int count = std::max<int>(1, free / k_strip);
    for (int i = 0; i < count; ++i) {
      Place place;
      place.side = s;
      place.z = 0.5 * (p + q) + along * (((i + 0.5) / count - 0.5) * free / scale);
      place.n = pose.a * out / scale;
      const Complex w = pose.at(place.z);
      EdgeStrip strip{w.real(), -w.imag(), place.n.real(), -place.n.imag(), std::min(k_strip, free / count),
                      0,        0};
      const double near = 1e-6 * g.radius;  // the side itself does not stand in the way
      const auto limit = [&](double sign) {
        const double other = scale * free_way(outline, s, place.z + g.centre + sign * near * out, sign * out);
        return std::min({reach, 0.5 * other, way_in_picture(picture, strip, sign)});
      };
      strip.inside = limit(-1), strip.outside = limit(1);
      if (strip.inside < k_min_look || strip.outside < k_min_look) continue;
      ++in_view;
      const auto edge = find_edge(picture, strip, fine);
      if (!edge) continue;
      place.d = edge->offset, place.std = edge->std;
      place.x = strip.x + edge->offset * strip.nx, place.y = strip.y + edge->offset * strip.ny;
      const Complex arm = pose.a * place.z / (scale * g.radius);
      const auto part = [&](Complex c) { return std::real(std::conj(place.n) * c); };
      place.row << part(arm), part(Complex(0, 1) * arm), part(1), part(Complex(0, 1));
      found.push_back(place);
    }
  }
  return found;
}

double robust_scale(const std::vector<double>& deviations) {
  return deviations.empty() ? 1 : 1.4826 * numerics::upper_median(deviations);
}

/// Weighted least squares: first as good as least absolute deviations, then Tukey's weights. Returns the
/// step; `normal` is Σ w h hᵀ with the prior of the scale.
Vector4 robust_step(std::vector<Place>& places, double scale_precision, double scale_gap, Matrix4& normal) {
  Vector4 step = Vector4::Zero();
  constexpr int k_absolute = 12, k_rounds = 24;
  for (int round = 0; round < k_rounds; ++round) {
    std::vector<double> deviations;
    for (const Place& p : places)
      deviations.push_back(std::abs(p.d - p.row.dot(step)) / std::hypot(p.std, 0.05));
    const double cut = k_tukey * std::max(1.0, robust_scale(deviations));
    normal.setZero();
    Vector4 right = Vector4::Zero();
    for (Index i = 0; i < std::ssize(places); ++i) {
      Place& p = places[i];
      const double r = deviations[i], inverse = 1 / (p.std * p.std + 0.05 * 0.05);
      const double tukey = r < cut ? std::pow(1 - (r / cut) * (r / cut), 2) : 0;
      p.weight = inverse * (round < k_absolute ? 1 / std::max(r, 0.1) : tukey);
      normal += p.weight * p.row * p.row.transpose();
      right += p.weight * p.d * p.row;
    }
    normal(0, 0) += scale_precision;
    right[0] += scale_precision * scale_gap;
    Matrix4 damped = normal;  // what no side determines stays where it is
    damped.diagonal().array() += 1e-9 * normal.trace() + 1e-12;
    step = damped.ldlt().solve(right);
  }
  return step;
}

/// Covariance with each strip's own error and one that the strips of a side share.
Matrix4 covariance_of(const std::vector<Place>& places, const Matrix4& normal, double scale_precision,
                      double inflation, double side_std) {
  Matrix4 middle = Matrix4::Zero();
  middle(0, 0) = scale_precision;
  std::map<std::size_t, Vector4> of_side;
  for (const Place& p : places) {
    const double own = inflation * inflation * (p.std * p.std + 0.05 * 0.05);
    middle += p.weight * p.weight * own * p.row * p.row.transpose();
    of_side.try_emplace(p.side, Vector4::Zero()).first->second += p.weight * p.row;
  }
  for (const auto& [side, sum] : of_side) middle += side_std * side_std * sum * sum.transpose();
  Matrix4 damped = normal;
  damped.diagonal().array() += 1e-12 * normal.trace();
  const Matrix4 inverse = damped.ldlt().solve(Matrix4::Identity());
  return inverse * middle * inverse.transpose();
}

/// "left", "right", "upper", "lower" by the direction outwards in the picture.
int direction_of(Complex n) {
  return std::abs(n.real()) > std::abs(n.imag()) ? (n.real() < 0 ? 0 : 1) : (n.imag() > 0 ? 2 : 3);
}
constexpr std::array<const char*, 4> k_directions{"left", "right", "upper", "lower"};

std::string listed(const std::vector<std::string>& words, const char* last) {
  std::string text;
  for (Index i = 0; i < std::ssize(words); ++i)
    text += (i == 0 ? "" : i + 1 == std::ssize(words) ? last : ", ") + words[i];
  return text;
}

/// DataError where the edges leave scale, turn or place open.
void require_determined(const std::vector<Place>& places, const Matrix4& normal, const std::string& name) {
  // A motion that no side sees has a deviation of 30 px then, so that one that it hardly has a part in is not
  // named.
  Matrix4 damped = normal;
  damped.diagonal().array() += 1e-3;
  const Matrix4 inverse = damped.ldlt().solve(Matrix4::Identity());
  const double limit = std::max(k_undetermined, 0.2 * std::sqrt(inverse.diagonal().maxCoeff()));
  std::vector<std::string> open;
  constexpr std::array<const char*, 4> k_names{"the scale", "the turn", "the place to the right",
                                               "the place upwards"};
  for (int k = 0; k < 4; ++k)
    if (!(std::sqrt(inverse(k, k)) < limit)) open.emplace_back(k_names[k]);
  if (open.empty()) return;
  std::array<bool, 4> seen{};
  for (const Place& p : places)
    if (p.weight > 0) seen[direction_of(p.n)] = true;
  std::vector<std::string> sides;
  for (std::size_t k = 0; k < 4; ++k)
    if (seen[k]) sides.emplace_back(k_directions[k]);
  throw DataError(
      fmt::format("{}: error: the outline does not tell {}: edges were found on the {} side{} only; three "
                  "sides must be in view (two that are parallel tell the scale across them, not the place "
                  "along them), or register with \"dic.pixels\" and \"dic.points\"{}",
                  name, listed(open, " and "), listed(sides, " and "), sides.size() > 1 ? "s" : "",
                  inverse(0, 0) > limit * limit ? ", or give \"dic.scale\" with \"dic.scale_std\"" : ""));
}

bool is_mask(const files::Picture& picture) {
  const float first = picture.pixels.front();
  float other = first;
  for (const float v : picture.pixels) {
    if (v == first || v == other) continue;
    if (other != first) return false;
    other = v;
  }
  return true;
}

}  // namespace

OutlineFit fit_outline(const files::Picture& picture, const Outline& outline, const OutlineOptions& options,
                       const std::string& name) {
  if (outline.size() < 3) throw UsageError("registration by the outline: it has fewer than three sides");
  const PictureFrame start = options.start ? *options.start : outline_start(picture, outline, name);
  const Geometry g = geometry_of(picture, outline, start, name);
  Pose pose;
  pose.a = 1.0 / start.slope, pose.b = (g.centre - start.offset) / start.slope;
  const double given = std::abs(pose.a);
  double reach = std::max(k_reach_start, k_far_share * g.radius * given);
  std::vector<Place> places;
  Matrix4 normal;
  int in_view = 0;
  double scale_precision = 0;
  for (const bool fine : {false, false, false, true, true, true}) {
    places = look(picture, outline, g, pose, reach, fine, in_view);
    if (std::ssize(places) < k_min_places || places.size() < k_min_share * in_view)
      throw DataError(
          fmt::format("{}: error: no edge of the body near its outline: {} of {} places along it show one; "
                      "the initial outline must be accurate to {:.0f} px (\"dic.scale\", \"dic.origin\"), "
                      "and the body be brighter, darker or more textured than what is behind it",
                      name, places.size(), in_view, reach));
    const double radius = std::abs(pose.a) * g.radius;  // px
    if (options.scale_std > 0) scale_precision = 1 / std::pow(options.scale_std * radius, 2);
    const Vector4 step =
        robust_step(places, scale_precision, radius * std::log(given / std::abs(pose.a)), normal);
    pose.a *= Complex(1, 0) + Complex(step[0], step[1]) / radius;
    pose.b += Complex(step[2], step[3]);
    if (!fine) reach = std::max(8.0, 0.5 * reach);
    if (fine) reach = 7;
    for (Place& p : places) p.d -= p.row.dot(step);
  }
  require_determined(places, normal, name);
  OutlineFit fit;
  fit.picture = name;
  fit.places = in_view;
  std::vector<double> misfits, normalised;
  for (const Place& p : places) {
    fit.edges.push_back({p.x, p.y, p.d, p.weight > 0});
    if (!(p.weight > 0)) continue;
    ++fit.used;
    misfits.push_back(std::abs(p.d)), normalised.push_back(std::abs(p.d) / std::hypot(p.std, 0.05));
  }
  fit.misfit = robust_scale(misfits);
  if (fit.misfit > k_worst_misfit || fit.used < k_min_share * in_view)
    throw DataError(
        fmt::format("{}: error: the edges that were found do not lie on the outline: {} of {} agree, within "
                    "{:.1f} px; its initial position must be accurate to about 20 px (\"dic.scale\", "
                    "\"dic.origin\"), and be that of this body",
                    name, fit.used, in_view, fit.misfit));
  const Matrix4 covariance =
      covariance_of(places, normal, scale_precision, std::max(1.0, robust_scale(normalised)),
                    is_mask(picture) ? k_mask_side_std : std::max(k_side_std, k_side_share * fit.misfit));
  if (!(std::sqrt(covariance.diagonal().maxCoeff()) < k_undetermined))
    throw DataError(
        fmt::format("{}: error: the edges lie {:.1f} px about the outline, which tells scale and place to "
                    "{:.1f} px only; some of its sides are not where it says, or not to be seen: look at it, "
                    "or give \"dic.pixels\" and \"dic.points\"",
                    name, fit.misfit, std::sqrt(covariance.diagonal().maxCoeff())));
  const double radius = std::abs(pose.a) * g.radius;
  fit.frame = start;
  fit.frame.slope = 1.0 / pose.a, fit.frame.offset = g.centre - pose.b / pose.a;
  fit.frame.relative_scale_std = std::sqrt(covariance(0, 0)) / radius;
  fit.angle_std = std::sqrt(covariance(1, 1)) / radius;
  fit.place_std = {std::sqrt(covariance(2, 2)), std::sqrt(covariance(3, 3))};
  for (const OutlineSide& s : outline) {
    const Complex p = pose.at(upward(s.from) - g.centre), q = pose.at(upward(s.to) - g.centre);
    fit.sides.push_back({p.real(), -p.imag(), q.real(), -q.imag()});
  }
  return fit;
}

}  // namespace knothe::imaging
