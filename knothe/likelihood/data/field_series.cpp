#include "knothe/likelihood/data/field_series.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

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
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy) {
        const auto entries = squares_.find(square(point, dx, dy));
        if (entries == squares_.end()) continue;
        for (const auto& [other, index] : entries->second)
          if (const double d = distance(point, other); d < closest) closest = d, found = index;
      }
    return found;
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

/// About how far apart the points of a field are.
double mean_distance(const std::vector<ExportedField>& fields) {
  for (const ExportedField& field : fields) {
    std::size_t count = 0;
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (std::size_t i = 0; i < field.x.size(); ++i) {
      if (is_lost(field, i)) continue;
      ++count;
      const double at[2] = {field.x[i], field.y[i]};
      for (int k = 0; k < 2; ++k) low[k] = std::min(low[k], at[k]), high[k] = std::max(high[k], at[k]);
    }
    if (count < 2) continue;
    const double width = high[0] - low[0], height = high[1] - low[1];
    return std::max(std::sqrt(width * height / double(count)), std::max(width, height) / double(count));
  }
  return 1;
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

FieldSeries join_fields(const std::vector<ExportedField>& fields, double min_distance) {
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
  std::vector<Index> row(joiner.points().size(), -1);
  Places kept(min_distance > 0 ? min_distance : 1);
  for (std::size_t i = 0; i < row.size(); ++i) {
    const Point& point = joiner.points()[i];
    if (min_distance > 0 && kept.near(point)) continue;
    if (min_distance > 0) kept.add(point, i);
    row[i] = std::ssize(series.points);
    series.points.push_back(point);
  }
  series.u.setConstant(std::ssize(series.points), std::ssize(fields),
                       std::numeric_limits<double>::quiet_NaN());
  series.v = series.u;
  for (const Entry& entry : entries)
    if (const Index i = row[entry.point]; i >= 0)
      series.u(i, entry.step) = entry.u, series.v(i, entry.step) = entry.v;
  return series;
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
