#include "knothe/imaging/correlation/edge_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_min_evidence = 0.2;   // of the change point, per sample: speckle by chance makes 0.05
constexpr double k_min_side = 2;         // px on either side of a change point
constexpr double k_blur = 2.5;           // px from an edge where its blur has ended
constexpr double k_level_from = 1.5;     // px beyond an edge from where the grey level beside it is read …
constexpr double k_level_to = 2.5;       // … and to where: farther off the speckle is another
constexpr double k_search = 3;           // px about the change point in which a line crosses
constexpr double k_clear = 5;            // noises of the quiet side that a line must stand out by
constexpr double k_correlation = 4;      // px: lines nearer than that err alike (speckle)
constexpr double k_smallest_std = 0.02;  // px, of a strip
constexpr double k_coarse_std = 1.0;     // px, of a change point alone

/// Mean of the densest half, and the standard deviation that its width says. Not the median: where a dark dot
/// meets a dark background the edge seems to lie inside, never outside.
std::array<double, 2> centre_of(std::vector<double>& values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size(), half = n / 2 + 1;
  std::size_t best = 0;
  for (std::size_t i = 0; i + half <= n; ++i)
    if (values[i + half - 1] - values[i] < values[best + half - 1] - values[best]) best = i;
  double sum = 0;
  for (std::size_t i = best; i < best + half; ++i) sum += values[i];
  return {sum / half, (values[best + half - 1] - values[best]) / 1.349};
}

/// Grey levels on a grid along (columns) and across (rows, from inside out) the strip.
struct Grid {
  int lines = 0, samples = 0;
  double step = 1, first = 0;  // px: of the samples, and where the first is
  std::vector<double> level;
  [[nodiscard]] double at(int line, int k) const { return level[line * samples + k]; }
  [[nodiscard]] double place(double k) const { return first + step * k; }
};

Grid grid_of(const files::Picture& picture, const EdgeStrip& s, double step) {
  Grid g;
  g.step = step, g.first = -s.inside;
  g.lines = std::max<int>(1, s.length), g.samples = static_cast<int>((s.inside + s.outside) / step) + 1;
  g.level.reserve(static_cast<std::size_t>(g.lines) * g.samples);
  for (int l = 0; l < g.lines; ++l)
    for (int k = 0; k < g.samples; ++k) {
      const double t = l - 0.5 * (g.lines - 1), n = g.place(k);
      g.level.push_back(sampled(picture, s.x + n * s.nx - t * s.ny, s.y + n * s.ny + t * s.nx));
    }
  return g;
}

/// Where two normal distributions, one on either side, explain the levels best; −1 where one does as well.
/// Mean and variance may both differ: brighter, darker, or more textured.
int change_point(const Grid& g) {
  std::vector<double> sum{0}, squares{0};
  double low = g.level[0], high = low;
  for (int k = 0; k < g.samples; ++k) {
    double s = 0, q = 0;
    for (int l = 0; l < g.lines; ++l) {
      const double v = g.at(l, k);
      s += v, q += v * v, low = std::min(low, v), high = std::max(high, v);
    }
    sum.push_back(sum.back() + s), squares.push_back(squares.back() + q);
  }
  const double floor = std::pow(std::max(0.3, 0.005 * (high - low)), 2);
  const auto cost = [&](int a, int b) {  // of samples a … b − 1
    const double n = 1.0 * (b - a) * g.lines;
    const double s = sum[b] - sum[a], q = squares[b] - squares[a];
    return n * std::log(std::max(floor, q / n - (s / n) * (s / n)));
  };
  const int least = std::max<int>(2, k_min_side / g.step);
  int best = -1;
  double gain = k_min_evidence * g.lines * g.samples;
  for (int k = least; k + least <= g.samples; ++k) {
    const double now = cost(0, g.samples) - cost(0, k) - cost(k, g.samples);
    if (now > gain) gain = now, best = k;
  }
  return best;
}

struct Level {
  double median = 0, noise = 0;
};
/// Of the samples from a to b (both included, a ≤ b).
Level level_of(const Grid& g, int a, int b) {
  std::vector<double> values;
  for (int k = a; k <= b; ++k)
    for (int l = 0; l < g.lines; ++l) values.push_back(g.at(l, k));
  Level level;
  level.median = numerics::upper_median(values);
  for (double& v : values) v = std::abs(v - level.median);
  level.noise = 1.4826 * numerics::upper_median(values);
  return level;
}

/// Mean level of a line beyond an edge at sample k.
std::optional<double> level_beyond(const Grid& g, int line, int k, int way) {
  const int from = k_level_from / g.step, to = k_level_to / g.step;
  double sum = 0;
  int count = 0;
  for (int n = from; n <= to; ++n) {
    const int at = k + way * n;
    if (at >= 0 && at < g.samples) sum += g.at(line, at), ++count;
  }
  if (2 * count < to - from + 1) return std::nullopt;
  return sum / count;
}

/// Where a line first crosses the mean of two levels, on the way from the first, in samples.
std::optional<double> half_way(const Grid& g, int line, int from, int way, double first, double second) {
  const int search = k_search / g.step;
  for (int n = -2; n <= search; ++n) {
    const int k = from + way * n;
    if (std::min(k, k + way) < 0 || std::max(k, k + way) >= g.samples) continue;
    const double a = (g.at(line, k) - first) / (second - first) - 0.5,
                 b = (g.at(line, k + way) - first) / (second - first) - 0.5;
    if (a < 0 && b >= 0) return k + way * a / (a - b);
  }
  return std::nullopt;
}

/// Line by line: where the grey level is half-way between that of the quieter side and that beside the edge
/// on the other. The quieter side is the background as a rule.
std::vector<double> crossings(const Grid& g, int change) {
  const int blur = k_blur / g.step, search = k_search / g.step;
  if (change <= blur || change + blur >= g.samples) return {};  // no level beside the edge to compare with
  const Level in = level_of(g, 0, change - 1 - blur), out = level_of(g, change + blur, g.samples - 1);
  const bool from_outside = out.noise <= in.noise;
  const Level quiet = from_outside ? out : in;
  const int way = from_outside ? -1 : 1;  // towards the other side
  std::vector<double> found;
  const int first = std::clamp(change - way * search, 0, g.samples - 1);
  for (int l = 0; l < g.lines; ++l) {
    // The edge of a line may lie a pixel or two beside that of the strip: the level beyond it from there on.
    int coarse = -1;
    for (int n = 0; n <= 2 * search && coarse < 0; ++n) {
      const int k = first + way * n;
      if (k < 0 || k >= g.samples) break;
      if (std::abs(g.at(l, k) - quiet.median) > std::max(k_clear * quiet.noise, 1.0)) coarse = k;
    }
    if (coarse < 0) continue;
    // The grey level beyond the edge is read where its blur has ended: from the crossing on, once that is
    // known.
    double crossing = coarse;
    bool crosses = false;
    for (int round = 0; round < 3; ++round) {
      const auto level = level_beyond(g, l, std::lround(crossing), way);
      crosses = level && std::abs(*level - quiet.median) > std::max(2 * k_clear * quiet.noise, 2.0);
      if (!crosses) break;
      const auto at = half_way(g, l, coarse, way, quiet.median, *level);
      crosses = at.has_value();
      if (!crosses) break;
      crossing = *at;
    }
    if (crosses) found.push_back(g.place(crossing));
  }
  return found;
}

}  // namespace

double sampled(const files::Picture& picture, double x, double y) {
  const int i = std::clamp<int>(x, 0, picture.width - 2), j = std::clamp<int>(y, 0, picture.height - 2);
  const double s = x - i, t = y - j;
  const auto at = [&](int a, int b) -> double { return picture.at(a, b); };
  return (1 - t) * ((1 - s) * at(i, j) + s * at(i + 1, j)) +
         t * ((1 - s) * at(i, j + 1) + s * at(i + 1, j + 1));
}

std::optional<EdgeFound> find_edge(const files::Picture& picture, const EdgeStrip& strip, bool fine) {
  const Grid grid = grid_of(picture, strip, fine ? 0.5 : 1);
  const int change = change_point(grid);
  if (change < 0) return std::nullopt;
  const EdgeFound coarse{grid.place(change - 0.5), k_coarse_std};
  if (!fine) return coarse;
  std::vector<double> places = crossings(grid, change);
  if (places.size() < 3 || 4 * places.size() < static_cast<std::size_t>(grid.lines)) return coarse;
  const auto [offset, spread] = centre_of(places);
  // Lines beside each other are not independent; a mean of the densest half is no better than a median.
  const double independent = std::max(1.0, places.size() / k_correlation);
  return EdgeFound{offset, std::max(k_smallest_std, 1.2533 * spread / std::sqrt(independent))};
}

}  // namespace knothe::imaging
