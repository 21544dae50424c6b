#include "knothe/numerics/statistics/weighted_statistics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::numerics {
namespace {

/// M(x) = ∫ K from −∞ to x (`lattice_quantiles`), K = φ Σ_{j<8} (−1)ʲ He_{2j}/(2ʲ j!), from a table: cubic
/// pieces between its nodes, to 1e-9.
class SpreadMass {
 public:
  static constexpr double k_reach = 9;  ///< K is nothing beyond

  SpreadMass() {
    for (Index i = 0; i < std::ssize(nodes_); ++i) {
      const double x = -k_reach + 1.0 * i / k_per_unit;
      double mass = 0, density = 1, factor = 1, before = 1, here = x;  // He_{2j−2}, He_{2j−1}
      for (int j = 1; j < 8; ++j) {
        factor *= -0.5 / j;
        mass += factor * here;
        before = x * here - (2 * j - 1) * before;
        density += factor * before;
        here = x * before - 2 * j * here;
      }
      const double phi = normal_pdf(x);
      nodes_[i] = {0.5 * std::erfc(-x * std::numbers::sqrt2 / 2) - phi * mass, phi * density / k_per_unit};
    }
  }
  /// M(x), and K(x) to 1e-4.
  [[nodiscard]] std::pair<double, double> operator()(double x) const {
    const double at = (x + k_reach) * k_per_unit;
    const std::size_t i = std::clamp(at, 0.0, k_count - 2.0);
    const double t = at - i;
    const auto& [left, slope] = nodes_[i];
    const auto& [right, right_slope] = nodes_[i + 1];
    const double rise = right - left;
    return {
        left + t * (slope + t * (3 * rise - 2 * slope - right_slope + t * (slope + right_slope - 2 * rise))),
        std::lerp(slope, right_slope, t) * k_per_unit};
  }

 private:
  static constexpr int k_per_unit = 128;
  static constexpr std::size_t k_count = 2 * 9 * k_per_unit + 1;
  std::array<std::pair<double, double>, k_count> nodes_;  ///< M, and M′ per interval
};

/// The points at the cumulative weights (k + ½)/count, in this order of the points.
std::vector<Index> draws_in_order(const Eigen::Ref<const Eigen::VectorXd>& weights,
                                  const std::vector<Index>& order, Index count) {
  const double share = weights.sum() / count;
  std::vector<Index> chosen;
  chosen.reserve(count);
  std::size_t i = 0;
  double passed = weights[order[0]];
  for (Index k = 0; k < count; ++k) {
    while (passed < (k + 0.5) * share && i + 1 < order.size()) passed += weights[order[++i]];
    chosen.push_back(order[i]);
  }
  return chosen;
}

}  // namespace

void mean_and_covariance(const Eigen::Ref<const Eigen::MatrixXd>& points,
                         const Eigen::Ref<const Eigen::VectorXd>& weights, Eigen::VectorXd& mean,
                         Eigen::MatrixXd& covariance) {
  assert(points.rows() == weights.size());
  mean.noalias() = points.transpose() * weights;
  const Eigen::MatrixXd centred = points.rowwise() - mean.transpose();
  const Eigen::MatrixXd weighted = weights.asDiagonal() * centred;
  const Eigen::MatrixXd product = centred.transpose() * weighted;
  covariance = 0.5 * (product + product.transpose());
}

Moments moments_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                   const Eigen::Ref<const Eigen::VectorXd>& weights) {
  const Index n = points.rows(), d = points.cols();
  if (n < 1 || weights.size() != n)
    throw UsageError(
        fmt::format("moments: {} points and {} weights; at least one point is needed, and one weight each", n,
                    weights.size()));
  const double sum = weights.sum();
  if (!(weights.minCoeff() >= 0) || !(sum > 0) || !std::isfinite(sum))
    throw UsageError("moments: the weights must be finite and not negative, and not all zero");
  const Eigen::VectorXd w = weights / sum;
  Moments m;
  mean_and_covariance(points, w, m.mean, m.covariance);
  m.skewness.setZero(d);
  m.kurtosis.setConstant(d, 3);
  for (Index k = 0; k < d; ++k) {
    const double std = std::sqrt(m.covariance(k, k));
    if (!(std > 0)) continue;
    const Eigen::ArrayXd u = (points.col(k).array() - m.mean[k]) / std;
    m.skewness[k] = (w.array() * u.cube()).sum();
    m.kurtosis[k] = (w.array() * u.square().square()).sum();
  }
  return m;
}

double log_sum(const Eigen::Ref<const Eigen::VectorXd>& values) {
  const double largest = values.maxCoeff();
  return std::isfinite(largest) ? largest + std::log((values.array() - largest).exp().sum()) : largest;
}

double effective_share(const Eigen::Ref<const Eigen::VectorXd>& log_weight) {
  const Eigen::ArrayXd weight = (log_weight.array() - log_weight.maxCoeff()).exp();
  return weight.sum() * weight.sum() / (weight.size() * weight.square().sum());
}

void WeightedQuantiles::compute(std::span<const double> values, std::span<const double> weights,
                                std::span<const double> levels, std::span<double> quantiles) {
  constexpr int k_bins = 512;
  if (values.empty() || values.size() != weights.size() || levels.size() != quantiles.size())
    throw UsageError(
        fmt::format("weighted quantiles: {} values, {} weights, {} levels, room for {} quantiles",
                    values.size(), weights.size(), levels.size(), quantiles.size()));
  double low = 0, high = 0, total = 0;
  for (Index i = 0; i < std::ssize(values); ++i) {  // points without weight do not count
    if (!(weights[i] > 0)) continue;
    low = total == 0 ? values[i] : std::min(low, values[i]);
    high = total == 0 ? values[i] : std::max(high, values[i]);
    total += weights[i];
  }
  if (!(total > 0)) throw UsageError("weighted quantiles: no weight is positive");
  bins_.assign(k_bins, Bin{});
  const double scale = high > low ? k_bins / (high - low) : 0;
  const auto bin_of = [&](double x) { return std::min<int>(k_bins - 1, (x - low) * scale); };
  for (Index i = 0; i < std::ssize(values); ++i)
    if (weights[i] > 0) {
      Bin& bin = bins_[bin_of(values[i])];
      bin.weight += weights[i];
      ++bin.count;
    }
  int begin = 0;
  for (Bin& bin : bins_) bin.begin = bin.fill = begin, begin += bin.count;
  entries_.resize(begin);
  for (Index i = 0; i < std::ssize(values); ++i)
    if (weights[i] > 0) entries_[bins_[bin_of(values[i])].fill++] = {values[i], weights[i] / total};

  const auto sort_bin = [&](Bin& bin) {
    if (bin.sorted) return;
    std::sort(entries_.begin() + bin.begin, entries_.begin() + bin.begin + bin.count);
    bin.sorted = true;
  };
  for (Index q = 0; q < std::ssize(levels); ++q) {
    double before = 0;  // weight of the bins below
    std::size_t at = 0;
    for (; at + 1 < bins_.size(); ++at) {
      if (before + bins_[at].weight / total >= levels[q]) break;
      before += bins_[at].weight / total;
    }
    // Walk over the entries from the last nonempty bin below to the first beyond the level; remember the
    // point before.
    std::size_t first = at;
    while (first > 0) {
      --first;
      if (bins_[first].count > 0) {
        before -= bins_[first].weight / total;
        break;
      }
    }
    double cumulative = before, previous_c = 0, previous_value = 0, result = high;
    bool have_previous = false, found = false;
    for (std::size_t k = first; k < bins_.size() && !found; ++k) {
      sort_bin(bins_[k]);
      for (int e = bins_[k].begin; e < bins_[k].begin + bins_[k].count; ++e) {
        const Entry& entry = entries_[e];
        const double c = cumulative + 0.5 * entry.weight;
        if (c >= levels[q]) {
          result = !have_previous ? entry.value
                                  : previous_value +
                                        (entry.value - previous_value) *
                                            std::clamp((levels[q] - previous_c) / (c - previous_c), 0.0, 1.0);
          found = true;
          break;
        }
        cumulative += entry.weight;
        previous_c = c;
        previous_value = entry.value;
        have_previous = true;
      }
    }
    quantiles[q] = result;
  }
}

Eigen::MatrixXd weighted_quantiles(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights) {
  WeightedQuantiles workspace;
  Eigen::MatrixXd quantiles;
  weighted_quantiles(points, weights, workspace, quantiles);
  return quantiles;
}

void weighted_quantiles(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights,
                        WeightedQuantiles& workspace, Eigen::MatrixXd& quantiles) {
  const std::size_t n = points.rows();
  std::array<double, k_quantile_levels.size()> of_column;
  quantiles.resize(points.cols(), std::ssize(of_column));
  for (Index k = 0; k < points.cols(); ++k) {
    workspace.compute({points.col(k).data(), n}, std::span(weights.data(), weights.size()), k_quantile_levels,
                      of_column);
    quantiles.row(k) = Eigen::Map<const Eigen::RowVectorXd>(of_column.data(), quantiles.cols());
  }
}

void lattice_quantiles(std::span<const double> nodes, std::span<const double> weights,
                       std::span<const double> widths, std::span<const double> levels,
                       std::span<double> quantiles) {
  if (nodes.empty() || nodes.size() != weights.size() || nodes.size() != widths.size() ||
      levels.size() != quantiles.size())
    throw UsageError(
        fmt::format("lattice quantiles: {} nodes, {} weights, {} widths, {} levels, room for {} quantiles",
                    nodes.size(), weights.size(), widths.size(), levels.size(), quantiles.size()));
  struct Node {
    double at, weight, width, before;  // before: weight of the nodes below
  };
  std::vector<Node> sorted;
  sorted.reserve(nodes.size());
  for (Index i = 0; i < std::ssize(nodes); ++i)
    if (weights[i] > 0) sorted.push_back({nodes[i], weights[i], widths[i], 0});
  if (sorted.empty()) throw UsageError("lattice quantiles: no weight is positive");
  const auto below = [](const Node& a, const Node& b) { return a.at < b.at; };
  if (!std::is_sorted(sorted.begin(), sorted.end(), below)) std::sort(sorted.begin(), sorted.end(), below);
  double total = 0;
  for (Node& node : sorted) {
    node.before = total;
    total += node.weight;
  }
  // Nodes that rounding has nearly made one are spread over what it leaves.
  double width = 4 * std::numeric_limits<double>::epsilon() *
                     std::max(std::abs(sorted.front().at), std::abs(sorted.back().at)) +
                 std::numeric_limits<double>::min();
  for (Node& node : sorted) node.width = std::max(node.width, width);
  for (const Node& node : sorted) width = std::max(width, node.width);
  static const SpreadMass spread_mass;
  const double reach = SpreadMass::k_reach * width;
  const auto below_and_density = [&](double x) {
    auto it = std::lower_bound(sorted.begin(), sorted.end(), Node{x - reach, 0, 0, 0}, below);
    double sum = it == sorted.end() ? total : it->before, density = 0;
    for (; it != sorted.end() && it->at <= x + reach; ++it) {
      const auto [share, slope] = spread_mass((x - it->at) / it->width);
      sum += it->weight * share;
      density += it->weight * slope / it->width;
    }
    return std::pair(sum, density);
  };
  const auto excess_below = [&](double x, double mass) { return below_and_density(x).first - mass; };
  const double accuracy = 1e-10 * total;
  /// Newton's steps from x; false where they lead away.
  const auto polish = [&](double& x, double mass) {
    for (double first = x; std::abs(x - first) <= 3 * width;) {
      const auto [sum, density] = below_and_density(x);
      if (std::abs(sum - mass) <= accuracy) return true;
      const double next = x - (sum - mass) / density;
      if (!(density > 0) || next == x) return false;
      x = next;
    }
    return false;
  };
  for (Index q = 0; q < std::ssize(levels); ++q) {
    const double mass = levels[q] * total;
    const auto near =
        std::lower_bound(sorted.begin(), std::prev(sorted.end()), mass,
                         [](const Node& node, double m) { return node.before + node.weight < m; });
    double& x = quantiles[q] = near->at;
    if (polish(x, mass)) continue;
    double low = near->at - width, high = near->at + width;
    double at_low = excess_below(low, mass), at_high = excess_below(high, mass);
    while (at_low > 0) at_low = excess_below(low -= 2 * width, mass);
    while (at_high < 0) at_high = excess_below(high += 2 * width, mass);
    // Regula falsi, Illinois: an end that stays twice counts half.
    x = 0.5 * (low + high);
    for (int step = 0, side = 0; step < 60 && at_high > at_low; ++step) {
      x = high - at_high * (high - low) / (at_high - at_low);
      const double at_x = excess_below(x, mass);
      if (std::abs(at_x) <= accuracy) break;
      if (at_x < 0) {
        low = x, at_low = at_x;
        if (side == -1) at_high *= 0.5;
        side = -1;
      } else {
        high = x, at_high = at_x;
        if (side == 1) at_low *= 0.5;
        side = 1;
      }
    }
  }
}

std::vector<Index> equal_draws(const Eigen::Ref<const Eigen::VectorXd>& weights, Index count) {
  return draws_in_order(weights, reversed_bits(weights.size()), count);
}

std::vector<Index> equal_draws_along(const Eigen::Ref<const Eigen::VectorXd>& values,
                                     const Eigen::Ref<const Eigen::VectorXd>& weights, Index count) {
  // Sorted into bins: 256 to a standard deviation.
  constexpr std::size_t k_bins = 4096;
  constexpr double k_deviations = 8;
  const double mean = weights.dot(values) / weights.sum();
  const double deviation =
      std::sqrt((weights.array() * (values.array() - mean).square()).sum() / weights.sum());
  const double low = mean - k_deviations * deviation, per_unit = k_bins / (2 * k_deviations * deviation);
  const auto bin_of = [&](Index i) {
    const double place = (values[i] - low) * per_unit;
    return place > 0 ? static_cast<std::size_t>(std::min(place, k_bins - 1.0)) : 0;
  };
  std::vector<std::size_t> next(k_bins + 1, 0);
  for (Index i = 0; i < values.size(); ++i) ++next[bin_of(i) + 1];
  std::partial_sum(next.begin(), next.end(), next.begin());
  std::vector<Index> order(values.size());
  for (Index i = 0; i < values.size(); ++i) order[next[bin_of(i)]++] = i;
  return draws_in_order(weights, order, count);
}

Eigen::MatrixXd resample(const Eigen::Ref<const Eigen::MatrixXd>& points,
                         const Eigen::Ref<const Eigen::VectorXd>& weights, Index count, std::uint64_t seed) {
  std::vector<Index> chosen = equal_draws(weights, count);
  std::mt19937_64 random(seed);
  // Not std::shuffle, whose order is the library's affair.
  for (std::size_t k = chosen.size(); k > 1; --k) std::swap(chosen[k - 1], chosen[random() % k]);
  return points(chosen, Eigen::all);
}

}  // namespace knothe::numerics
