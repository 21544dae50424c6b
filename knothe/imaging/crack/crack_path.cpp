#include "knothe/imaging/crack/crack_path.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_stretched = 4;      // robust deviations above the median stretch: what counts
constexpr double k_min_open = 0.2;     // px: an element taken out counts at least as much
constexpr double k_sideways = 0.3;     // of a wide-open element, for each half element sideways
constexpr int k_max_sideways = 2;      // half elements from row to row
constexpr double k_slope_scale = 0.3;  // px sideways per px along, of the prior on the refined path
constexpr double k_clip = 2.5;         // residuals count up to so many times the picture's: torn grains
constexpr double k_steepest = 1.5;     // px sideways per px along: more is impossible
constexpr double k_reach_of_side = 3;  // elements
constexpr double k_open_beside = 0.4;  // root of the share of the widest opening: another crack
constexpr double k_beside = 1.6;       // elements from the path: not part of it
constexpr double k_min_length = 2.9;   // elements

/// How much longer an element became along its largest principal strain, px, beyond what is usual; elements
/// taken out as much as the most stretched. 0 for elements that were never measured.
std::vector<double> stretches(const ImageCorrelation& correlation, const CorrelationResult& result,
                              double size) {
  const ImageMesh& mesh = correlation.mesh();
  std::vector<double> stretch(mesh.elements.size(), 0), seen;
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    if (result.element_valid[e] == 0) continue;
    const auto& nodes = mesh.elements[e];
    double x = 0, y = 0;
    const int n = ImageMesh::nodes_of(nodes);
    for (Index a = 0; a < n; ++a) {
      const std::size_t node = nodes[a];
      x += mesh.x[node] / n, y += mesh.y[node] / n;
    }
    const auto gradients = mesh.shape_functions(nodes, x, y).gradients(x, y);
    std::array<double, 4> g{};  // du/dx, du/dy, dv/dx, dv/dy at the centre
    for (Index a = 0; a < n; ++a)
      for (int k = 0; k < 2; ++k) {
        const double u = result.displacement[2 * nodes[a] + k];
        g[2 * k] += gradients[a][0] * u;
        g[2 * k + 1] += gradients[a][1] * u;
      }
    stretch[e] = size * (0.5 * (g[0] + g[3]) + std::hypot(0.5 * (g[0] - g[3]), 0.5 * (g[1] + g[2])));
    seen.push_back(stretch[e]);
  }
  const double middle = numerics::upper_median(seen);
  for (double& s : seen) s = std::abs(s - middle);
  const double floor = middle + k_stretched * 1.4826 * numerics::upper_median(seen);
  double widest = k_min_open;
  for (Index e = 0; e < std::ssize(stretch); ++e) {
    if (result.element_valid[e] != 0) stretch[e] = std::max(0.0, stretch[e] - floor);
    widest = std::max(widest, stretch[e]);
  }
  for (Index e = 0; e < std::ssize(stretch); ++e)
    if (result.element_valid[e] == 0 && correlation.usable_elements()[e] != 0) stretch[e] = widest;
  for (double& s : stretch) s = std::sqrt(s / widest);  // narrow openings lead the path too
  return stretch;
}

}  // namespace

std::optional<double> CrackScene::residual(int t, int s, const std::array<double, 2>& motion) const {
  if (!inside(t, s)) return std::nullopt;
  const std::size_t i = index(t, s);
  if (!reference.counts(i)) return std::nullopt;
  const auto at = view.swap(t + motion[0], s + motion[1]);
  if (!deformed->contains(at[0], at[1])) return std::nullopt;
  return reference.value[i] - result->gain * deformed->at(at[0], at[1]).value - result->offset;
}

std::optional<SideMotion> CrackScene::side(double t, double s, int sign, double margin) const {
  Eigen::Matrix3d gram = Eigen::Matrix3d::Zero();
  Eigen::Matrix<double, 3, 2> right = Eigen::Matrix<double, 3, 2>::Zero();
  int count = 0;
  for (const auto& node : nodes) {
    const double away = sign * (node[0] - t), beside = node[1] - s;
    if (away < margin || away > margin + k_reach_of_side * element || std::abs(beside) > 1.6 * element)
      continue;
    const Eigen::Vector3d row(1, (node[0] - t) / element, beside / element);
    gram += row * row.transpose();
    right += row * Eigen::RowVector2d(node[2], node[3]);
    ++count;
  }
  if (count < 4) return std::nullopt;
  gram += 1e-6 * Eigen::Matrix3d::Identity();  // nodes in one line: no slope across it
  const Eigen::Matrix<double, 3, 2> c = gram.llt().solve(right);
  SideMotion motion;
  motion.t0 = t, motion.s0 = s;
  motion.a = {c(0, 0), c(1, 0) / element, c(2, 0) / element};
  motion.b = {c(0, 1), c(1, 1) / element, c(2, 1) / element};
  return motion;
}

CrackScene crack_scene(const ImageCorrelation& correlation, const CorrelationResult& result, bool across) {
  CrackScene scene;
  const ImageMesh& mesh = correlation.mesh();
  scene.mesh = &mesh, scene.result = &result;
  scene.reference = correlation.reference_rows(), scene.deformed = &correlation.deformed_image();
  scene.view.across = across;
  std::vector<double> sizes;
  for (const auto& e : correlation.pixels().elements()) sizes.push_back(std::sqrt(e.pixel_count));
  scene.element = std::max(3.0, numerics::upper_median(sizes));
  const auto measured = measured_nodes(mesh, result.element_valid);
  for (Index a = 0; a < std::ssize(mesh.x); ++a) {
    if (measured[a] == 0) continue;
    const Index i = 2 * a;
    const auto place = scene.view.swap(mesh.x[a], mesh.y[a]);
    const auto motion = scene.view.swap(result.displacement[i], result.displacement[i + 1]);
    scene.nodes.push_back({place[0], place[1], motion[0], motion[1]});
  }
  return scene;
}

double RoughPath::at(double s) const {
  const double position = std::clamp((s - first) / step, 0.0, t.size() - 1.0);
  const auto i = std::min<std::size_t>(position, t.size() - 1), j = std::min(i + 1, t.size() - 1);
  const double share = position - i;
  return (1 - share) * t[i] + share * t[j];
}

OtherOpenings other_openings(const ImageCorrelation& correlation, const CrackScene& scene,
                             const RoughPath& path) {
  const ImageMesh& mesh = correlation.mesh();
  const auto stretch = stretches(correlation, *scene.result, scene.element);
  const std::size_t count = mesh.elements.size();
  std::vector<std::array<double, 2>> middle(count);  // t, s
  std::vector<char> open(count, 0);
  std::vector<std::vector<std::size_t>> around(mesh.x.size());
  for (std::size_t e = 0; e < count; ++e) {
    const int n = ImageMesh::nodes_of(mesh.elements[e]);
    double x = 0, y = 0;
    for (Index a = 0; a < n; ++a) {
      const std::size_t node = mesh.elements[e][a];
      x += mesh.x[node] / n, y += mesh.y[node] / n;
      around[node].push_back(e);
    }
    middle[e] = scene.view.swap(x, y);
    double nearest = 1e300;
    for (Index i = 0; i < std::ssize(path.t); ++i)
      nearest =
          std::min(nearest, std::hypot(middle[e][0] - path.t[i], middle[e][1] - path.first - path.step * i));
    open[e] = stretch[e] > k_open_beside && nearest > k_beside * scene.element ? 1 : 0;
  }
  OtherOpenings result;
  double largest = 0;
  for (std::size_t first = 0; first < count; ++first) {
    if (open[first] == 0) continue;
    std::vector<std::size_t> members{first};
    open[first] = 0;
    for (Index k = 0; k < std::ssize(members); ++k)
      for (int a = 0; a < ImageMesh::nodes_of(mesh.elements[members[k]]); ++a)
        for (const std::size_t e : around[mesh.elements[members[k]][a]])
          if (open[e] != 0) open[e] = 0, members.push_back(e);
    double low_t = 1e300, high_t = -1e300, low_s = 1e300, high_s = -1e300;
    for (const std::size_t e : members) {
      low_t = std::min(low_t, middle[e][0]), high_t = std::max(high_t, middle[e][0]);
      low_s = std::min(low_s, middle[e][1]), high_s = std::max(high_s, middle[e][1]);
    }
    const double length = std::hypot(high_t - low_t, high_s - low_s) + scene.element;
    if (length < k_min_length * scene.element) continue;
    ++result.count;
    if (length <= largest) continue;
    largest = length;
    result.middle = scene.view.swap(0.5 * (low_t + high_t), 0.5 * (low_s + high_s));
  }
  return result;
}

RoughPath stretched_path(const ImageCorrelation& correlation, const CrackScene& scene) {
  const auto stretch = stretches(correlation, *scene.result, scene.element);
  const PointLocator locator(*scene.mesh);
  const Region bounds = scene.mesh->bounds();
  const auto low = scene.view.swap(bounds.x0, bounds.y0), high = scene.view.swap(bounds.x1, bounds.y1);
  const double step = 0.5 * scene.element;
  const int rows = std::max<int>(2, (high[1] - low[1]) / step),
            columns = std::max<int>(2, (high[0] - low[0]) / step);
  const double ds = (high[1] - low[1]) / rows, dt = (high[0] - low[0]) / columns;
  std::vector<double> best(columns, 0), next(best);
  std::vector<int> from(rows * best.size(), 0);
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const auto at = scene.view.swap(low[0] + (i + 0.5) * dt, low[1] + (j + 0.5) * ds);
      const int element = locator.find(at[0], at[1]).element;
      double score = j == 0 ? 0 : -std::numeric_limits<double>::infinity();
      int origin = i;
      for (int k = std::max(0, i - k_max_sideways); j > 0 && k <= std::min(columns - 1, i + k_max_sideways);
           ++k)
        if (const double s = best[k] - k_sideways * std::abs(k - i); s > score) score = s, origin = k;
      next[i] = score + (element < 0 ? 0 : stretch[element]);
      from[j * best.size() + i] = origin;
    }
    std::swap(best, next);
  }
  RoughPath path;
  path.first = low[1] + 0.5 * ds, path.step = ds;
  path.t.resize(rows);
  int at = std::max_element(best.begin(), best.end()) - best.begin();
  path.score = best[at];
  for (int j = rows - 1; j >= 0; --j) {
    path.t[j] = low[0] + (at + 0.5) * dt;
    at = from[j * best.size() + at];
  }
  return path;
}

namespace {

/// Cost of the crack being left of candidate k, for 2 `search` + 1 candidates about `centre`: −log
/// likelihood.
std::vector<double> change_costs(const CrackScene& scene, double from, double to, int centre, int search,
                                 double margin) {
  std::vector<double> cost(2 * search + 1, 0);
  const double middle = 0.5 * (from + to);
  const auto left = scene.side(centre, middle, -1, margin), right = scene.side(centre, middle, 1, margin);
  if (!left || !right) return cost;
  const double variance = std::max(1e-6, scene.result->residual_rms * scene.result->residual_rms),
               limit = k_clip * k_clip * variance;
  // Pixel k belongs to the left side when the crack is to the right of it. Difference of its two costs,
  // summed.
  double sum = 0;
  for (int k = 0; k < 2 * search; ++k) {
    const int t = centre - search + k;
    for (int s = std::ceil(from); s < to; ++s) {
      const auto l = scene.residual(t, s, left->at(t, s)), r = scene.residual(t, s, right->at(t, s));
      if (l && r) sum += 0.5 * (std::min(*l * *l, limit) - std::min(*r * *r, limit)) / variance;
    }
    cost[k + 1] = sum;  // the crack between pixel k and k + 1
  }
  return cost;
}

/// The bands of a path and what each says of it.
struct Bands {
  std::vector<int> centre;
  std::vector<std::vector<double>> cost;
  int search = 0;
  double scale = 1, steepest = 1;  ///< px, of the Laplace prior; limit

  /// −log of the prior from candidate k of band b − 1 to candidate i of band b.
  [[nodiscard]] double turn(std::size_t b, int k, int i) const {
    const double sideways = std::abs(centre[b] + i - centre[b - 1] - k);
    return sideways > steepest ? 1e6 : sideways / scale;
  }
  [[nodiscard]] int candidates() const { return 2 * search + 1; }
};

std::vector<int> most_probable(const Bands& bands) {
  const std::size_t n = bands.candidates();
  std::vector<double> cost = bands.cost.front(), next(n);
  std::vector<std::vector<int>> from(bands.cost.size(), std::vector<int>(n, 0));
  for (Index b = 1; b < std::ssize(bands.cost); ++b) {
    for (std::size_t i = 0; i < n; ++i) {
      double least = std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < n; ++k)
        if (const double c = cost[k] + bands.turn(b, k, i); c < least) least = c, from[b][i] = k;
      next[i] = least + bands.cost[b][i];
    }
    std::swap(cost, next);
  }
  std::vector<int> path(bands.cost.size());
  path.back() = std::min_element(cost.begin(), cost.end()) - cost.begin();
  for (std::size_t b = path.size(); b-- > 1;) path[b - 1] = from[b][path[b]];
  return path;
}

/// Messages of the sum over all paths, each band's scaled to a largest of 1.
std::vector<std::vector<double>> messages(const Bands& bands, bool forward) {
  const std::size_t n = bands.candidates();
  const std::size_t count = bands.cost.size();
  std::vector<std::vector<double>> message(count, std::vector<double>(n, 1));
  for (std::size_t m = 1; m < count; ++m) {
    const std::size_t b = forward ? m : count - 1 - m, before = forward ? b - 1 : b + 1;
    const auto& cost = bands.cost[before];
    const double least = *std::min_element(cost.begin(), cost.end());
    std::vector<double> arriving(n);
    for (std::size_t k = 0; k < n; ++k) arriving[k] = message[before][k] * std::exp(least - cost[k]);
    double largest = 0;
    for (std::size_t i = 0; i < n; ++i) {
      double sum = 0;
      for (std::size_t k = 0; k < n; ++k)
        sum += arriving[k] * std::exp(-(forward ? bands.turn(b, k, i) : bands.turn(before, i, k)));
      message[b][i] = sum, largest = std::max(largest, sum);
    }
    for (double& v : message[b]) v = largest > 0 ? v / largest : 1;
  }
  return message;
}

}  // namespace

RoughPath refined_path(const CrackScene& scene, const RoughPath& rough, double band, double margin,
                       double search) {
  RoughPath path;
  const double begin = rough.first - 0.5 * rough.step, end = begin + rough.step * rough.t.size();
  const int count = std::max<int>(2, std::round((end - begin) / band));
  path.step = (end - begin) / count, path.first = begin + 0.5 * path.step, path.score = rough.score;
  Bands bands;
  bands.search = std::ceil(search), bands.scale = std::max(1.0, k_slope_scale * path.step);
  bands.steepest = std::max(2.0, k_steepest * path.step);
  for (int b = 0; b < count; ++b) {
    const double s = path.first + b * path.step;
    bands.centre.push_back(std::round(rough.at(s)));
    bands.cost.push_back(change_costs(scene, s - 0.5 * path.step, s + 0.5 * path.step, bands.centre.back(),
                                      bands.search, margin));
  }
  const auto best = most_probable(bands);
  const auto forward = messages(bands, true), backward = messages(bands, false);
  for (Index b = 0; b < std::ssize(bands.cost); ++b) {
    // Candidate k: the crack runs half a pixel before pixel centre − search + k.
    const double origin = bands.centre[b] - bands.search - 0.5;
    path.t.push_back(origin + best[b]);
    const double least = *std::min_element(bands.cost[b].begin(), bands.cost[b].end());
    double mass = 0, mean = 0, square = 0;
    for (Index k = 0; k < std::ssize(bands.cost[b]); ++k) {
      const double p = forward[b][k] * backward[b][k] * std::exp(least - bands.cost[b][k]);
      const double x = k;
      mass += p, mean += p * x, square += p * x * x;
    }
    mean /= mass;
    path.std.push_back(mass > 0 ? std::sqrt(std::max(0.0, square / mass - mean * mean) + 1.0 / 12)
                                : bands.search / std::sqrt(3.0));
  }
  return path;
}

}  // namespace knothe::imaging
