#include "knothe/assimilation/update/tensor_quadrature.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <vector>

#include "knothe/assimilation/update/sequential_update.hpp"

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
constexpr double k_too_coarse = 0.3;  ///< the same, on the coarse grid
constexpr Index k_most_refined = 32;  ///< fine intervals in a coarse one, at most

using reduction::GridRun;

/// A uniform grid of `count`^d nodes; node numbers have the last coordinate fastest. With one parameter it is
/// one row.
struct Grid {
  Eigen::VectorXd first, spacing;
  Index count = 0;

  [[nodiscard]] Index dimension() const { return first.size(); }
  [[nodiscard]] Index rows() const { return dimension() == 1 ? 1 : count; }
  [[nodiscard]] Index size() const { return rows() * count; }
  /// The nodes of each axis, count × d.
  [[nodiscard]] Eigen::MatrixXd axes() const {
    Eigen::MatrixXd nodes(count, dimension());
    for (Index i = 0; i < count; ++i) nodes.row(i) = (first + static_cast<double>(i) * spacing).transpose();
    return nodes;
  }
};

Grid make_grid(const Eigen::VectorXd& first, const Eigen::VectorXd& last, Index count) {
  return {first, (last - first) / static_cast<double>(count - 1), count};
}

Index size_of(const std::vector<GridRun>& runs) {
  return runs.empty() ? 0 : runs.back().at + runs.back().end - runs.back().begin;
}

/// Log-density at these nodes; where the target knows no rows, block by block, so that it sees one size of
/// block only.
Eigen::VectorXd evaluate(sampling::LogDensity& target, const Grid& grid, const std::vector<GridRun>& runs) {
  Eigen::VectorXd values(size_of(runs));
  const Eigen::MatrixXd axes = grid.axes();
  auto* const on_grid = dynamic_cast<reduction::GridEvaluator*>(&target);
  if (on_grid != nullptr && grid.dimension() == 2) {
    on_grid->evaluate_on_grid(axes, runs, values);
    return values;
  }
  const Eigen::MatrixXd points = reduction::nodes_of(axes, runs);
  Eigen::MatrixXd block(k_block, grid.dimension());
  sampling::LogDensityBatch batch;
  batch.resize(k_block, grid.dimension(), 0);
  for (Index begin = 0; begin < values.size(); begin += k_block) {
    const Index n = std::min(k_block, values.size() - begin);
    block.topRows(n) = points.middleRows(begin, n);
    for (Index i = n; i < k_block; ++i) block.row(i) = block.row(n - 1);
    target.evaluate(block, 0, batch);
    values.segment(begin, n) = batch.value.head(n);
  }
  return values;
}

std::vector<GridRun> all_nodes(const Grid& grid) {
  std::vector<GridRun> runs;
  for (Index row = 0; row < grid.rows(); ++row) runs.push_back({row, 0, grid.count, row * grid.count});
  return runs;
}

/// Zooms a coarse grid in on the mass; leaves its last values in `values`.
Grid find_window(sampling::LogDensity& target, Index count, Eigen::VectorXd& values) {
  const Index d = target.dimension();
  Grid grid = make_grid(Eigen::VectorXd::Constant(d, -k_range), Eigen::VectorXd::Constant(d, k_range), count);
  for (int zoom = 0;; ++zoom) {
    values = evaluate(target, grid, all_nodes(grid));
    const double floor = values.maxCoeff() - k_window_depth;
    std::vector<Index> least(static_cast<std::size_t>(d), count - 1), most(static_cast<std::size_t>(d), 0);
    const auto widen = [&](std::size_t axis, Index at) {
      least[axis] = std::min(least[axis], at);
      most[axis] = std::max(most[axis], at);
    };
    for (Index row = 0, node = 0; row < grid.rows(); ++row) {
      for (Index i = 0; i < count; ++i, ++node) {
        if (!(values[node] > floor)) continue;
        if (d == 2) widen(0, row);
        widen(static_cast<std::size_t>(d - 1), i);
      }
    }
    Eigen::VectorXd first(d), last(d);
    double shrink = 1;  // of the axis that shrinks most
    for (Index k = 0; k < d; ++k) {
      const Index from = std::max<Index>(least[static_cast<std::size_t>(k)] - 1, 0);
      const Index to = std::min<Index>(most[static_cast<std::size_t>(k)] + 1, count - 1);
      first[k] = grid.first[k] + static_cast<double>(from) * grid.spacing[k];
      last[k] = grid.first[k] + static_cast<double>(to) * grid.spacing[k];
      shrink = std::min(shrink, static_cast<double>(to - from) / static_cast<double>(count - 1));
    }
    if (shrink > 0.75 || zoom == k_most_zooms) return grid;
    grid = make_grid(first, last, count);
  }
}

/// Nodes of the fine grid (`factor` times as many intervals) within one coarse interval of a coarse node that
/// is not empty.
std::vector<GridRun> nodes_near_mass(const Grid& coarse, const Eigen::VectorXd& values, const Grid& fine,
                                     Index factor) {
  const double floor = values.maxCoeff() - k_mask_depth;
  const auto low = [&](Index i) { return std::max<Index>((i - 1) * factor, 0); };
  const auto high = [&](Index i) { return std::min((i + 1) * factor, fine.count - 1); };
  std::vector<char> wanted(static_cast<std::size_t>(fine.size()), 0);
  for (Index row = 0, node = 0; row < coarse.rows(); ++row) {
    const bool one = coarse.dimension() == 1;
    for (Index i = 0; i < coarse.count; ++i, ++node) {
      if (!(values[node] > floor)) continue;
      for (Index at = one ? 0 : low(row); at <= (one ? 0 : high(row)); ++at)
        std::fill(wanted.begin() + at * fine.count + low(i), wanted.begin() + at * fine.count + high(i) + 1,
                  char{1});
    }
  }
  std::vector<GridRun> runs;
  Index at = 0;
  for (Index row = 0; row < fine.rows(); ++row) {
    const auto begin = wanted.begin() + row * fine.count, end = begin + fine.count;
    for (auto from = std::find(begin, end, char{1}); from != end;) {
      const auto to = std::find(from, end, char{0});
      runs.push_back({row, from - begin, to - begin, at});
      at += to - from;
      from = std::find(to, end, char{1});
    }
  }
  return runs;
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

/// The points, but those that carry nothing (together less than 1e-8 of the mass): forecasts look at every
/// point there is.
void take_points(QuadraturePosterior& posterior, const Grid& fine, const std::vector<GridRun>& runs) {
  const Eigen::MatrixXd axes = fine.axes();
  if (fine.dimension() == 2) posterior.nodes = {axes, runs, posterior.weights, {}};
  const double floor = 1e-8 / static_cast<double>(posterior.weights.size());
  std::vector<Index> kept;
  kept.reserve(static_cast<std::size_t>(posterior.weights.size()));
  for (Index i = 0; i < posterior.weights.size(); ++i)
    if (posterior.weights[i] > floor) kept.push_back(i);
  posterior.weights = posterior.weights(kept).eval();
  posterior.points = reduction::nodes_of(axes, runs)(kept, Eigen::all);
  posterior.weights /= posterior.weights.sum();
  if (!posterior.nodes.runs.empty()) posterior.nodes.kept = std::move(kept);
}

/// The rule on the nodes of `fine` that are given; weights of all of them, without their points.
QuadraturePosterior integrate(sampling::LogDensity& target, const Grid& fine,
                              const std::vector<GridRun>& runs) {
  const Index d = fine.dimension();
  const Eigen::VectorXd values = evaluate(target, fine, runs);

  QuadraturePosterior result;
  const double top = values.maxCoeff();
  result.weights = (values.array() - top).exp();
  Eigen::MatrixXd mass = Eigen::MatrixXd::Zero(fine.count, d);
  double every_other = 0;
  for (const GridRun& run : runs) {
    const auto weights = result.weights.segment(run.at, run.end - run.begin);
    mass.col(d - 1).segment(run.begin, weights.size()) += weights;
    if (d == 2) mass(run.row, 0) += weights.sum();
    if (d == 2 && run.row % 2 != 0) continue;
    for (Index i = run.begin % 2; i < weights.size(); i += 2) every_other += weights[i];
  }
  const double sum = result.weights.sum();
  result.weights /= sum;
  result.log_evidence = top + std::log(sum) + fine.spacing.array().log().sum();
  result.refinement_change = std::abs(std::log(every_other * std::pow(2.0, static_cast<double>(d)) / sum));
  result.quantiles.resize(d, static_cast<Index>(k_quantile_levels.size()));
  for (Index k = 0; k < d; ++k) {
    result.quantiles.row(k) = marginal_quantiles(fine, k, mass.col(k) / sum).transpose();
  }
  return result;
}

/// Of the log-evidence, on all nodes of a grid.
double change_without_every_other(const Grid& grid, const Eigen::VectorXd& values) {
  const Eigen::ArrayXd weights = (values.array() - values.maxCoeff()).exp();
  double every_other = 0;
  for (Index row = 0; row < grid.rows(); row += 2)
    for (Index i = 0; i < grid.count; i += 2) every_other += weights[row * grid.count + i];
  return std::abs(
      std::log(every_other * std::pow(2.0, static_cast<double>(grid.dimension())) / weights.sum()));
}

}  // namespace

QuadraturePosterior tensor_quadrature(sampling::LogDensity& target) {
  const Index d = target.dimension();
  assert(d >= 1 && d <= k_most_quadrature_parameters);
  Eigen::VectorXd coarse_values;
  const Grid coarse = find_window(target, d == 1 ? 257 : 49, coarse_values);
  // The trapezoidal rule gains digits exponentially on a smooth density that ends inside its window: the
  // coarse grid has some two nodes per standard deviation, so the first refinement mostly changes nothing.
  // Its error at half the spacing is the fourth power or so: where leaving out every other coarse node
  // changes this much, the first refinement would not do.
  for (Index factor = change_without_every_other(coarse, coarse_values) > k_too_coarse ? 4 : 2;;
       factor *= 2) {
    Grid fine = coarse;
    fine.count = (coarse.count - 1) * factor + 1;
    fine.spacing /= static_cast<double>(factor);
    const std::vector<GridRun> runs = nodes_near_mass(coarse, coarse_values, fine, factor);
    QuadraturePosterior result = integrate(target, fine, runs);
    if (result.refinement_change < k_refinement_tolerance || factor == k_most_refined) {
      take_points(result, fine, runs);
      return result;
    }
  }
}

}  // namespace knothe::assimilation
