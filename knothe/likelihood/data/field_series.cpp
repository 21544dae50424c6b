#include "knothe/likelihood/data/field_series.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::likelihood {
namespace {

using files::ExportedField;
using Point = std::array<double, 2>;

constexpr double k_same_place = 0.1;  // of the mean distance of points

double distance(const Point& a, const Point& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1]);
}

/// Points in squares of a given size, to find those near a place.
class Places {
 public:
  explicit Places(double size) : size_(size) {}

  void add(const Point& point, std::size_t index) {
    squares_[square(point, 0, 0)].emplace_back(point, index);
  }
  /// The nearest that is closer than the size.
  [[nodiscard]] std::optional<std::size_t> near(const Point& point) const {
    std::optional<std::size_t> found;
    double closest = size_;
    visit_near(point, [&](std::size_t index, double d) {
      if (d < closest) closest = d, found = index;
    });
    return found;
  }
  /// Calls `visit` with index and distance of all that are closer than the size, and of some others.
  template <class Visit>
  void visit_near(const Point& point, const Visit& visit) const {
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy) {
        const auto entries = squares_.find(square(point, dx, dy));
        if (entries == squares_.end()) continue;
        for (const auto& [other, index] : entries->second) visit(index, distance(point, other));
      }
  }

 private:
  [[nodiscard]] Point square(const Point& point, int dx, int dy) const {
    return {std::floor(point[0] / size_) + dx, std::floor(point[1] / size_) + dy};
  }
  double size_;
  std::map<Point, std::vector<std::pair<Point, std::size_t>>> squares_;
};

bool is_lost(const ExportedField& field, std::size_t i) {
  return std::isnan(field.u[i]);
}

/// About how far apart points are; nothing for fewer than two.
std::optional<double> mean_distance(const std::vector<Point>& points) {
  if (points.size() < 2) return std::nullopt;
  Point low{INFINITY, INFINITY}, high{-INFINITY, -INFINITY};
  for (const Point& at : points)
    for (std::size_t k = 0; k < 2; ++k) low[k] = std::min(low[k], at[k]), high[k] = std::max(high[k], at[k]);
  const double width = high[0] - low[0], height = high[1] - low[1], count = points.size();
  return std::max(std::sqrt(width * height / count), std::max(width, height) / count);
}

/// The same of the first field that has two.
double mean_distance(const std::vector<ExportedField>& fields) {
  for (const ExportedField& field : fields) {
    std::vector<Point> points;
    for (std::size_t i = 0; i < field.x.size(); ++i)
      if (!is_lost(field, i)) points.push_back({field.x[i], field.y[i]});
    if (const auto found = mean_distance(points)) return *found;
  }
  return 1;
}

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + std::ssize(values) / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

constexpr double k_neighbours_within = 3;  // mean distances
constexpr Index k_min_neighbours = 5;
constexpr double k_max_spread = 3;  // of neighbours, in usual ones: among wrong values it tells nothing
constexpr int k_passes = 5;

/// How far values at points are from a plane in the sense of least absolute deviations, by reweighted least
/// squares.
Eigen::ArrayXd deviations_from_plane(const Eigen::MatrixX3d& places, const Eigen::VectorXd& values) {
  std::vector<double> sorted(values.begin(), values.end());
  Eigen::ArrayXd off = values.array() - median_of(sorted);
  for (int iteration = 0; iteration < 8; ++iteration) {
    const Eigen::ArrayXd size = off.abs();
    if (!(size.maxCoeff() > 0)) break;
    const Eigen::VectorXd weights = size.max(1e-3 * size.mean()).inverse();
    const Eigen::MatrixX3d weighted = weights.asDiagonal() * places;
    const Eigen::Vector3d plane = (places.transpose() * weighted).ldlt().solve(weighted.transpose() * values);
    off = values - places * plane;
  }
  return off;
}

/// How far a value is from the plane through its neighbours, and how far these are from it in the median.
struct Deviation {
  double own, of_neighbours;
};

/// Nothing for a value that is lost or has too few neighbours.
std::optional<Deviation> deviation(const std::vector<Point>& points, const Eigen::VectorXd& values, Index i,
                                   const std::vector<Index>& neighbours) {
  std::vector<Index> there;
  for (const Index k : neighbours)
    if (!std::isnan(values[k])) there.push_back(k);
  if (std::isnan(values[i]) || std::ssize(there) < k_min_neighbours) return std::nullopt;
  there.push_back(i);  // the last: one of many, it moves their plane little
  Eigen::MatrixX3d places(std::ssize(there), 3);
  for (Index row = 0; const Index k : there)
    places.row(row++) << 1, points[k][0] - points[i][0], points[k][1] - points[i][1];
  const Eigen::ArrayXd off = deviations_from_plane(places, values(there)).abs();
  std::vector<double> of_neighbours(off.begin(), off.end() - 1);
  return Deviation{off[off.size() - 1], median_of(of_neighbours)};
}

/// Which values stand out.
std::vector<Index> outliers(const std::vector<Point>& points, const Eigen::VectorXd& values,
                            const std::vector<std::vector<Index>>& neighbours, double factor) {
  std::vector<std::pair<Index, Deviation>> all;
  std::vector<double> spreads;
  for (Index i = 0; i < values.size(); ++i)
    if (const auto d = deviation(points, values, i, neighbours[i]))
      all.emplace_back(i, *d), spreads.push_back(d->of_neighbours);
  std::vector<Index> found;
  if (spreads.empty()) return found;
  const double usual = median_of(spreads);
  for (const auto& [i, d] : all)
    if (d.own > factor * (usual + std::min(d.of_neighbours, k_max_spread * usual))) found.push_back(i);
  return found;
}

/// For each point of each field its place in the series; nothing for a lost one.
class Joiner {
 public:
  Joiner(const std::vector<ExportedField>& fields, double spacing)
      : by_id_(
            std::all_of(fields.begin(), fields.end(), [](const ExportedField& f) { return !f.id.empty(); })),
        spacing_(spacing),
        places_(k_same_place * spacing) {}

  std::size_t place(const ExportedField& field, std::size_t i) {
    const Point at{field.x[i], field.y[i]};
    const std::optional<std::size_t> found = by_id_ ? with_id(field, i, at) : places_.near(at);
    if (found) return *found;
    if (by_id_)
      ids_[field.id[i]] = points_.size();
    else
      places_.add(at, points_.size());
    points_.push_back(at);
    return points_.size() - 1;
  }
  [[nodiscard]] const std::vector<Point>& points() const { return points_; }

 private:
  std::optional<std::size_t> with_id(const ExportedField& field, std::size_t i, const Point& at) const {
    const auto found = ids_.find(field.id[i]);
    if (found == ids_.end()) return std::nullopt;
    const Point& before = points_[found->second];
    if (distance(at, before) > spacing_)
      throw DataError(
          fmt::format("{}: the point {:g} is at ({:.6g}, {:.6g}), in another file at ({:.6g}, {:.6g}): "
                      "its number does not stay with it, or positions are not those of the reference "
                      "(data.fields.columns.id, data.fields.positions)",
                      field.path, field.id[i][0], at[0], at[1], before[0], before[1]));
    return found->second;
  }

  bool by_id_;
  double spacing_;
  Places places_;
  std::map<Point, std::size_t> ids_;
  std::vector<Point> points_;
};

}  // namespace

FieldSeries join_fields(const std::vector<ExportedField>& fields) {
  Joiner joiner(fields, mean_distance(fields));
  struct Entry {
    std::size_t point, step;
    double u, v;
  };
  std::vector<Entry> entries;
  for (std::size_t t = 0; t < fields.size(); ++t) {
    const ExportedField& field = fields[t];
    std::vector<bool> filled(joiner.points().size(), false);
    for (std::size_t i = 0; i < field.x.size(); ++i) {
      if (is_lost(field, i)) continue;
      const std::size_t point = joiner.place(field, i);
      filled.resize(std::max(filled.size(), point + 1), false);
      if (filled[point])
        throw DataError(fmt::format("{}: two points at ({:.6g}, {:.6g}): leave one of them out of the export",
                                    field.path, field.x[i], field.y[i]));
      filled[point] = true;
      entries.push_back({point, t, field.u[i], field.v[i]});
    }
  }
  FieldSeries series;
  series.points = joiner.points();
  series.u.setConstant(std::ssize(series.points), std::ssize(fields),
                       std::numeric_limits<double>::quiet_NaN());
  series.v = series.u;
  for (const Entry& entry : entries)
    series.u(entry.point, entry.step) = entry.u, series.v(entry.point, entry.step) = entry.v;
  return series;
}

Index lose_outliers(double factor, FieldSeries& series) {
  const Index n = std::ssize(series.points);
  const double reach = k_neighbours_within * mean_distance(series.points).value_or(1);
  Places places(reach);
  for (Index i = 0; i < n; ++i) places.add(series.points[i], i);
  std::vector<std::vector<Index>> neighbours(n);
  for (Index i = 0; i < n; ++i)
    places.visit_near(series.points[i], [&](Index other, double d) {
      if (other != i && d < reach) neighbours[i].push_back(other);
    });
  Index lost = 0;
  for (Index t = 0; t < series.u.cols(); ++t) {
    std::set<Index> found = {-1};
    for (int pass = 0; pass < k_passes && !found.empty(); ++pass) {
      found.clear();
      for (const Eigen::MatrixXd* values : {&series.u, &series.v})
        for (const Index i : outliers(series.points, values->col(t), neighbours, factor)) found.insert(i);
      for (const Index i : found) series.u(i, t) = series.v(i, t) = std::numeric_limits<double>::quiet_NaN();
      lost += std::ssize(found);
    }
  }
  return lost;
}

FieldSeries thinned(const FieldSeries& series, double min_distance) {
  std::vector<Index> kept;
  Places places(min_distance > 0 ? min_distance : 1);
  for (Index i = 0; i < std::ssize(series.points); ++i) {
    if (series.u.row(i).array().isNaN().all()) continue;
    if (min_distance > 0 && places.near(series.points[i])) continue;
    if (min_distance > 0) places.add(series.points[i], i);
    kept.push_back(i);
  }
  FieldSeries result;
  for (const Index i : kept) result.points.push_back(series.points[i]);
  result.u = series.u(kept, Eigen::all), result.v = series.v(kept, Eigen::all);
  return result;
}

double static_std(const std::vector<ExportedField>& fields) {
  double squares = 0, count = 0;
  for (const ExportedField& field : fields)
    for (std::size_t i = 0; i < field.u.size(); ++i)
      if (!is_lost(field, i)) squares += field.u[i] * field.u[i] + field.v[i] * field.v[i], count += 2;
  if (!(squares > 0))
    throw DataError(fmt::format(
        "{}: {}: give data.fields.std", fields.empty() ? "data.fields.static" : fields.front().path,
        count > 0 ? "all displacements are exactly 0: it is the reference, and says nothing of noise"
                  : "no point is measured"));
  return std::sqrt(squares / count);
}

}  // namespace knothe::likelihood
