#include "knothe/assimilation/tensor_quadrature.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <vector>

#include "knothe/assimilation/sequential_update.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr double k_range = 8.5;          ///< |z| looked at first
constexpr double k_window_depth = 40.0;  ///< log-density below the maximum at which the window ends
constexpr double k_mask_depth = 24.0;    ///< … and below which coarse nodes count as empty
constexpr Index k_block = 512;           ///< nodes evaluated at once
constexpr int k_most_zooms = 8;
constexpr double k_refinement_tolerance =
    1e-3;                             ///< on the log-evidence, between every node and every other node
constexpr Index k_most_refined = 32;  ///< fine intervals in a coarse one, at most

/// A uniform grid of `count`^d nodes; node numbers have the last coordinate fastest.
struct Grid {
  Eigen::VectorXd first, spacing;
  Index count = 0;

  [[nodiscard]] Index dimension() const { return first.size(); }
  [[nodiscard]] Index size() const { return dimension() == 1 ? count : count * count; }
  [[nodiscard]] Index along(Index node, Index k) const {
    if (dimension() == 1) return node;
    // node / count, without the slow division of integers: exact, as node is far below 2^52.
    const double inverse = 1 / static_cast<double>(count);
    const auto row = static_cast<Index>((static_cast<double>(node) + 0.5) * inverse);
    return k == 0 ? row : node - row * count;
  }
  [[nodiscard]] double coordinate(Index node, Index k) const {
    return first[k] + static_cast<double>(along(node, k)) * spacing[k];
  }
};

Grid make_grid(const Eigen::VectorXd& first, const Eigen::VectorXd& last, Index count) {
  return {first, (last - first) / static_cast<double>(count - 1), count};
}

/// Log-density at these nodes, block by block, so that the target sees one size of block only.
Eigen::VectorXd evaluate(sampling::LogDensity& target, const Grid& grid, const std::vector<Index>& nodes) {
  Eigen::VectorXd values(static_cast<Index>(nodes.size()));
  Eigen::MatrixXd block(k_block, grid.dimension());
  sampling::LogDensityBatch batch;
  batch.resize(k_block, grid.dimension(), 0);
  for (Index begin = 0; begin < values.size(); begin += k_block) {
    const Index n = std::min(k_block, values.size() - begin);
    for (Index i = 0; i < k_block; ++i) {
      const Index node = nodes[static_cast<std::size_t>(begin + std::min(i, n - 1))];
      for (Index k = 0; k < grid.dimension(); ++k) block(i, k) = grid.coordinate(node, k);
    }
    target.evaluate(block, 0, batch);
    values.segment(begin, n) = batch.value.head(n);
  }
  return values;
}

std::vector<Index> all_nodes(const Grid& grid) {
  std::vector<Index> nodes(static_cast<std::size_t>(grid.size()));
  for (std::size_t i = 0; i < nodes.size(); ++i) nodes[i] = static_cast<Index>(i);
  return nodes;
}

/// Zooms a coarse grid in on the mass; leaves its last values in `values`.
Grid find_window(sampling::LogDensity& target, Index count, Eigen::VectorXd& values) {
  const Index d = target.dimension();
  Grid grid = make_grid(Eigen::VectorXd::Constant(d, -k_range), Eigen::VectorXd::Constant(d, k_range), count);
  for (int zoom = 0;; ++zoom) {
    values = evaluate(target, grid, all_nodes(grid));
    const double floor = values.maxCoeff() - k_window_depth;
    Eigen::VectorXd first(d), last(d);
    double shrink = 1;  // of the axis that shrinks most
    for (Index k = 0; k < d; ++k) {
      Index least = count - 1, most = 0;
      for (Index node = 0; node < grid.size(); ++node) {
        if (!(values[node] > floor)) continue;
        least = std::min(least, grid.along(node, k));
        most = std::max(most, grid.along(node, k));
      }
      least = std::max<Index>(least - 1, 0);
      most = std::min<Index>(most + 1, count - 1);
      first[k] = grid.first[k] + static_cast<double>(least) * grid.spacing[k];
      last[k] = grid.first[k] + static_cast<double>(most) * grid.spacing[k];
      shrink = std::min(shrink, static_cast<double>(most - least) / static_cast<double>(count - 1));
    }
    if (shrink > 0.75 || zoom == k_most_zooms) return grid;
    grid = make_grid(first, last, count);
  }
}

/// Nodes of the fine grid (`factor` times as many intervals) within one coarse interval of a coarse node that
/// is not empty.
std::vector<Index> nodes_near_mass(const Grid& coarse, const Eigen::VectorXd& values, const Grid& fine,
                                   Index factor) {
  const double floor = values.maxCoeff() - k_mask_depth;
  std::vector<char> wanted(static_cast<std::size_t>(fine.size()), 0);
  for (Index node = 0; node < coarse.size(); ++node) {
    if (!(values[node] > floor)) continue;
    const auto low = [&](Index k) { return std::max<Index>((coarse.along(node, k) - 1) * factor, 0); };
    const auto high = [&](Index k) { return std::min((coarse.along(node, k) + 1) * factor, fine.count - 1); };
    if (coarse.dimension() == 1) {
      std::fill(wanted.begin() + low(0), wanted.begin() + high(0) + 1, char{1});
      continue;
    }
    for (Index i = low(0); i <= high(0); ++i) {
      std::fill(wanted.begin() + i * fine.count + low(1), wanted.begin() + i * fine.count + high(1) + 1,
                char{1});
    }
  }
  std::vector<Index> nodes;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (wanted[i]) nodes.push_back(static_cast<Index>(i));
  }
  return nodes;
}

/// Quantiles of the marginal along k, whose mass at each grid line is given: linear between the middles of
/// the lines' masses.
Eigen::VectorXd marginal_quantiles(const Grid& grid, Index k, const Eigen::VectorXd& mass) {
  Eigen::VectorXd quantiles(static_cast<Index>(k_quantile_levels.size()));
  double level = 0;
  std::size_t next = 0;
  for (Index i = 0; i < grid.count && next < k_quantile_levels.size(); ++i) {
    while (next < k_quantile_levels.size() &&
           (level + mass[i] >= k_quantile_levels[next] || i + 1 == grid.count)) {
      const double t = mass[i] > 0 ? (k_quantile_levels[next] - level) / mass[i] : 0.5;
      quantiles[static_cast<Index>(next++)] =
          grid.first[k] + (static_cast<double>(i) - 0.5 + std::clamp(t, 0.0, 1.0)) * grid.spacing[k];
    }
    level += mass[i];
  }
  return quantiles;
}

/// Leaves out the points that carry nothing (together less than 1e-8 of the mass): forecasts look at every
/// point that is left.
void drop_weightless(QuadraturePosterior& posterior) {
  const double floor = 1e-8 / static_cast<double>(posterior.weights.size());
  Index kept = 0;
  for (Index i = 0; i < posterior.weights.size(); ++i) {
    if (!(posterior.weights[i] > floor)) continue;
    posterior.weights[kept] = posterior.weights[i];
    posterior.points.row(kept++) = posterior.points.row(i);
  }
  posterior.weights.conservativeResize(kept);
  posterior.points.conservativeResize(kept, Eigen::NoChange);
  posterior.weights /= posterior.weights.sum();
}

/// The rule on the nodes of `fine` that are given.
QuadraturePosterior integrate(sampling::LogDensity& target, const Grid& fine,
                              const std::vector<Index>& nodes) {
  const Index d = fine.dimension();
  const Eigen::VectorXd values = evaluate(target, fine, nodes);

  QuadraturePosterior result;
  const auto n = static_cast<Index>(nodes.size());
  const double top = values.maxCoeff();
  result.weights = (values.array() - top).exp();
  result.points.resize(n, d);
  Eigen::MatrixXd mass = Eigen::MatrixXd::Zero(fine.count, d);
  double every_other = 0;
  for (Index i = 0; i < n; ++i) {
    bool on_half_grid = true;
    for (Index k = 0; k < d; ++k) {
      const Index along = fine.along(nodes[static_cast<std::size_t>(i)], k);
      result.points(i, k) = fine.first[k] + static_cast<double>(along) * fine.spacing[k];
      mass(along, k) += result.weights[i];
      on_half_grid = on_half_grid && along % 2 == 0;
    }
    if (on_half_grid) every_other += result.weights[i];
  }
  const double sum = result.weights.sum();
  result.weights /= sum;
  result.log_evidence = top + std::log(sum) + fine.spacing.array().log().sum();
  result.refinement_change = std::abs(std::log(every_other * std::pow(2.0, static_cast<double>(d)) / sum));
  result.quantiles.resize(d, static_cast<Index>(k_quantile_levels.size()));
  for (Index k = 0; k < d; ++k) {
    result.quantiles.row(k) = marginal_quantiles(fine, k, mass.col(k) / sum).transpose();
  }
  drop_weightless(result);
  return result;
}

}  // namespace

QuadraturePosterior tensor_quadrature(sampling::LogDensity& target) {
  const Index d = target.dimension();
  assert(d >= 1 && d <= k_most_quadrature_parameters);
  Eigen::VectorXd coarse_values;
  const Grid coarse = find_window(target, d == 1 ? 257 : 49, coarse_values);
  // The trapezoidal rule gains digits exponentially on a smooth density that ends inside its window: the
  // coarse grid has some two nodes per standard deviation, so the first refinement mostly changes nothing.
  for (Index factor = 2;; factor *= 2) {
    Grid fine = coarse;
    fine.count = (coarse.count - 1) * factor + 1;
    fine.spacing /= static_cast<double>(factor);
    QuadraturePosterior result =
        integrate(target, fine, nodes_near_mass(coarse, coarse_values, fine, factor));
    if (result.refinement_change < k_refinement_tolerance || factor == k_most_refined) return result;
  }
}

}  // namespace knothe::assimilation
