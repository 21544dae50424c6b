#include "knothe/posterior/quadrature/tensor_quadrature.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/quadrature/lattice_rule.hpp"

namespace knothe::posterior {
namespace {

using Eigen::Index;
using numerics::GridRun;
using numerics::k_quantile_levels;

/// Spacing of the first grid in standard deviations of the narrowest mode along its axes, others held. Half
/// of it resolves a Gaussian to 1e-5 with every other node, and to rounding with all.
constexpr double k_coarse_spacing = 1.2;
constexpr int k_max_zooms = 8, k_max_growths = 60;
constexpr double k_no_zoom = 0.55;  ///< a window that shrinks to more than this share of its width stays
constexpr Index k_enough_points = 40'000;
constexpr Index k_max_refinement = 32;  ///< fine intervals in a coarse one

/// Where the grid lies, and how its window is looked for.
struct Frame {
  Eigen::VectorXd centre;       ///< z = centre + axes u
  Eigen::MatrixXd axes;         ///< empty: z = u
  Eigen::VectorXd first, last;  ///< u, the window looked at first
  Index coarse_nodes;           ///< per axis
  double limit;                 ///< of |u|, that the window may grow to

  [[nodiscard]] Eigen::MatrixXd to_z(Eigen::MatrixXd u) const {
    if (axes.size() == 0) return u;
    return (u * axes.transpose()).rowwise() + centre.transpose();
  }
  [[nodiscard]] Eigen::VectorXd to_u(const Eigen::VectorXd& z) const {
    if (axes.size() == 0) return z;
    return axes.partialPivLu().solve(z - centre);
  }
  [[nodiscard]] double log_volume() const {
    return axes.size() == 0 ? 0 : std::log(std::abs(axes.determinant()));
  }
};

Frame frame_of_range(Index d, Index coarse_nodes) {
  return {{},
          {},
          Eigen::VectorXd::Constant(d, -k_lattice_range),
          Eigen::VectorXd::Constant(d, k_lattice_range),
          coarse_nodes,
          k_lattice_range};
}

/// An orthogonal matrix (a reflection) whose rows have incommensurable entries. Nodes of a lattice along the
/// axes of the parameters share coordinates, and a marginal quantile of such a lattice is one of its few
/// values; seen along this one's axes every node has coordinates of its own. Moments do not mind the turn.
Eigen::MatrixXd turned_axes(Index d) {
  // Of some twenty tried the best: plain weighted quantiles of 25³ nodes are within 0.014 standard deviations
  // of a Gaussian's.
  static constexpr double k_squares[] = {1, 0.106, 0.708};
  const Eigen::VectorXd v = Eigen::Map<const Eigen::VectorXd>(k_squares, d).cwiseSqrt();
  return Eigen::MatrixXd::Identity(d, d) - 2 / v.squaredNorm() * v * v.transpose();
}

/// Six and a half standard deviations around every mode that counts.
Frame frame_of_modes(CheckedDensity& target, const QuadratureOptions& options, ModeSearch& search) {
  constexpr double k_spreads = 6.5, k_negligible = 14;  ///< the latter of a mode's log-mass
  constexpr Index k_min_nodes = 13, k_max_nodes = 257;
  const Index d = target.dimension();
  std::vector<Mode> modes;
  search.run(target, true, modes);
  const bool own_axes = options.axes == QuadratureOptions::Axes::parameters;
  Frame frame{{}, {}, {}, {}, options.coarse_nodes, own_axes ? k_lattice_range : 1e300};
  if (!own_axes) {
    frame.centre = modes[0].point;
    frame.axes = modes[0].lower * turned_axes(d);
  }
  Eigen::VectorXd narrowest = Eigen::VectorXd::Constant(d, std::numeric_limits<double>::infinity());
  frame.first = narrowest, frame.last = -narrowest;
  for (const Mode& mode : modes) {
    if (mode.log_mass < modes[0].log_mass - k_negligible) continue;
    const Eigen::VectorXd u = frame.to_u(mode.point).cwiseMax(-frame.limit).cwiseMin(frame.limit);
    const Eigen::MatrixXd factor = own_axes ? mode.lower : frame.axes.partialPivLu().solve(mode.lower);
    const Eigen::VectorXd spread = factor.rowwise().norm().cwiseMax(k_min_spread);
    narrowest = narrowest.cwiseMin(factor.inverse().colwise().norm().cwiseInverse().transpose());
    frame.first = frame.first.cwiseMin(u - k_spreads * spread).cwiseMax(-frame.limit);
    frame.last = frame.last.cwiseMax(u + k_spreads * spread).cwiseMin(frame.limit);
  }
  if (frame.coarse_nodes > 0) return frame;
  const double intervals = (frame.last - frame.first).cwiseQuotient(k_coarse_spacing * narrowest).maxCoeff();
  frame.coarse_nodes = std::clamp(static_cast<Index>(std::min(intervals, 1e6)) + 2, k_min_nodes, k_max_nodes);
  return frame;
}

/// A uniform grid of `count`^d nodes of u; node numbers have the last coordinate fastest. A row lies along
/// the last axis.
struct Grid {
  Eigen::VectorXd first, spacing;
  Index count = 0;

  [[nodiscard]] Index dimension() const { return first.size(); }
  [[nodiscard]] Index rows() const { return dimension() == 1 ? 1 : dimension() == 2 ? count : count * count; }
  [[nodiscard]] Index size() const { return rows() * count; }
  [[nodiscard]] double node(Index i, Index k) const { return first[k] + i * spacing[k]; }
  /// The nodes of each axis, count × d.
  [[nodiscard]] Eigen::MatrixXd axes() const {
    Eigen::MatrixXd nodes(count, dimension());
    for (Index i = 0; i < count; ++i) nodes.row(i) = (first + i * spacing).transpose();
    return nodes;
  }
  /// Node of axis k < d − 1 at which row `row` lies.
  [[nodiscard]] Index place(Index row, Index k) const {
    return dimension() == 3 && k == 0 ? row / count : row % count;
  }
  /// Whether a row lies on every `stride`-th line of all axes but the last.
  [[nodiscard]] bool is_every(Index stride, Index row) const {
    for (Index k = 0; k + 1 < dimension(); ++k)
      if (place(row, k) % stride != 0) return false;
    return true;
  }
};

Grid make_grid(const Eigen::VectorXd& first, const Eigen::VectorXd& last, Index count) {
  return {first, (last - first) / (count - 1), count};
}

std::vector<GridRun> all_nodes(const Grid& grid) {
  std::vector<GridRun> runs;
  for (Index row = 0; row < grid.rows(); ++row) runs.push_back({row, 0, grid.count, row * grid.count});
  return runs;
}

/// The target on grids of one frame.
class GridDensity {
 public:
  GridDensity(LogDensity& target, const QuadratureOptions& options, ModeSearch& search)
      : checked_(target),
        by_rows_(dynamic_cast<numerics::GridEvaluator*>(&target)),
        frame_(options.whole_range ? frame_of_range(target.dimension(), options.coarse_nodes)
                                   : frame_of_modes(checked_, options, search)) {}

  [[nodiscard]] const Frame& frame() const { return frame_; }
  [[nodiscard]] std::int64_t evaluations() const { return evaluations_ + checked_.evaluations(); }

  /// Log-density at these nodes, where the target knows no rows block by block.
  [[nodiscard]] Eigen::VectorXd evaluate(const Grid& grid, const std::vector<GridRun>& runs) {
    Eigen::VectorXd values(size_of(runs));
    const Eigen::MatrixXd axes = grid.axes();
    if (by_rows_ != nullptr && grid.dimension() == 2 && frame_.axes.size() == 0) {
      by_rows_->set_grid(axes);
      by_rows_->evaluate_runs(runs, values);
      evaluations_ += values.size();
      return values;
    }
    evaluate_in_blocks(checked_, frame_.to_z(numerics::nodes_of(axes, runs)), batch_, values);
    return values;
  }

 private:
  CheckedDensity checked_;
  numerics::GridEvaluator* by_rows_;
  Frame frame_;
  std::int64_t evaluations_ = 0;
  LogDensityBatch batch_;
};

/// First and last node, of each axis, whose log-density is above `floor`.
struct Extent {
  std::array<Index, 3> low, high{};

  Extent(const Grid& grid, const Eigen::VectorXd& values, double floor) {
    low.fill(grid.count - 1);
    const Index d = grid.dimension();
    const auto widen = [&](Index axis, Index at) {
      const std::size_t k = axis;
      low[k] = std::min(low[k], at);
      high[k] = std::max(high[k], at);
    };
    for (Index row = 0, node = 0; row < grid.rows(); ++row) {
      for (Index i = 0; i < grid.count; ++i, ++node) {
        if (!(values[node] > floor)) continue;
        for (Index k = 0; k + 1 < d; ++k) widen(k, grid.place(row, k));
        widen(d - 1, i);
      }
    }
  }
};

/// Whether so many nodes, and those of a finer grid between them, are numbers of their own.
bool has_room(const Eigen::VectorXd& first, const Eigen::VectorXd& last, Index count) {
  const Eigen::ArrayXd rounding =
      std::numeric_limits<double>::epsilon() * first.cwiseAbs().cwiseMax(last.cwiseAbs()).array();
  return ((last - first).array() > 4.0 * k_max_refinement * count * rounding).all();
}

/// A coarse grid as large as the mass, and its values: grown where the mass comes up to a face, then zoomed
/// in.
Grid find_window(GridDensity& target, Eigen::VectorXd& values) {
  const Frame& frame = target.frame();
  const Index d = frame.first.size(), count = frame.coarse_nodes;
  Grid grid = make_grid(frame.first, frame.last, count);
  for (int zooms = 0, growths = 0;;) {
    values = target.evaluate(grid, all_nodes(grid));
    const Extent extent(grid, values, mask_floor(values.maxCoeff()));
    Eigen::VectorXd first(d), last(d);
    double shrink = 1;  // of the axis that shrinks most
    bool grown = false;
    for (Index k = 0; k < d; ++k) {
      const std::size_t axis = k;
      Index from = std::max<Index>(extent.low[axis] - 1, 0);
      Index to = std::min<Index>(extent.high[axis] + 1, count - 1);
      if (extent.low[axis] == 0 && grid.first[k] > -frame.limit) from = -count / 4, grown = true;
      if (extent.high[axis] == count - 1 && grid.node(count - 1, k) < frame.limit)
        to = count - 1 + count / 4, grown = true;
      first[k] = std::max(grid.node(from, k), -frame.limit);
      last[k] = std::min(grid.node(to, k), frame.limit);
      shrink = std::min(shrink, (to - from) / static_cast<double>(count - 1));
    }
    if (grown ? ++growths > k_max_growths : shrink > k_no_zoom || zooms++ == k_max_zooms) return grid;
    if (!grown && !has_room(first, last, count)) return grid;
    grid = make_grid(first, last, count);
  }
}

/// Nodes of the fine grid (`factor` times as many intervals) within one coarse interval of a coarse node that
/// is not empty.
std::vector<GridRun> nodes_near_mass(const Grid& coarse, const Eigen::VectorXd& values, const Grid& fine,
                                     Index factor) {
  const Index d = coarse.dimension(), n = coarse.count;
  using Mask = Eigen::Array<char, Eigen::Dynamic, 1>;
  const Mask has_mass = (values.array() > mask_floor(values.maxCoeff())).cast<char>();
  /// First and last coarse line within one interval of a fine one; without such an axis the only one.
  const auto near = [&](Index row, Index axis) -> std::pair<Index, Index> {
    if (axis < 0) return {0, 0};
    const Index i = fine.place(row, axis);
    return {std::max<Index>((i + factor - 1) / factor - 1, 0), std::min(i / factor + 1, n - 1)};
  };
  std::vector<GridRun> runs;
  Mask of_row(n);  // the coarse lines of a row together
  Index at = 0;
  for (Index row = 0; row < fine.rows(); ++row) {
    of_row.setZero();
    const auto [first_plane, last_plane] = near(row, d - 3);
    const auto [first_line, last_line] = near(row, d - 2);
    for (Index plane = first_plane; plane <= last_plane; ++plane)
      for (Index line = first_line; line <= last_line; ++line)
        of_row = of_row.max(has_mass.segment((plane * n + line) * n, n));
    for (Index i = 0; i < n; ++i) {
      if (of_row[i] == 0) continue;
      const Index begin = std::max<Index>((i - 1) * factor, 0);
      const Index end = std::min((i + 1) * factor + 1, fine.count);
      if (!runs.empty() && runs.back().row == row && begin <= runs.back().end) {
        at += end - runs.back().end;
        runs.back().end = end;
      } else {
        runs.push_back({row, begin, end, at});
        at += end - begin;
      }
    }
  }
  return runs;
}

/// Of every `stride`-th node along each axis.
Marginals marginals(const Grid& grid, const std::vector<GridRun>& runs, const Eigen::VectorXd& weights,
                    Index stride) {
  const Index d = grid.dimension();
  Marginals result(grid.count, d);
  std::array<Index, 3> row{};
  for (const GridRun& run : runs) {
    if (!grid.is_every(stride, run.row)) continue;
    for (Index k = 0; k + 1 < d; ++k) row[k] = grid.place(run.row, k);
    result.add(run, weights, (run.begin + stride - 1) / stride * stride, stride, std::span(row).first(d - 1));
  }
  return result;
}

/// The rule on the nodes given: evidence, errors, weights of all nodes; no points, no quantiles.
QuadraturePosterior integrate(const Grid& grid, const std::vector<GridRun>& runs,
                              const Eigen::VectorXd& values, double log_volume, Marginals& all) {
  QuadraturePosterior result;
  const Index d = grid.dimension();
  const double top = values.maxCoeff();
  result.weights = (values.array() - top).exp();
  all = marginals(grid, runs, result.weights, 1);
  const Marginals half = marginals(grid, runs, result.weights, 2);
  const double sum = all.sum;
  result.weights /= sum;
  result.log_evidence = top + std::log(sum) + grid.spacing.array().log().sum() + log_volume;
  result.evidence_change = std::abs(std::log(half.sum * std::pow(2.0, d) / sum));
  for (Index k = 0; k < d; ++k) {
    result.moment_change = std::max(result.moment_change, all.change_from(half, k));
    result.mass_at_border += (all.mass(0, k) + all.mass(grid.count - 1, k)) / sum;
  }
  result.per_axis = grid.count;
  return result;
}

/// Nodes along each axis from a point to the next: forecasts look at every point there is. More than one
/// where there are more than enough nodes and the rule on the points says the same as that on all.
Index stride_of_points(const Grid& grid, const std::vector<GridRun>& runs, const Eigen::VectorXd& weights,
                       const Marginals& all) {
  constexpr double k_same = 1e-6;  ///< log-evidence; moments in standard deviations
  const Index d = grid.dimension();
  Index stride = 1;
  for (Index nodes = size_of(runs); nodes > k_enough_points; nodes >>= d, stride *= 2) {
    const Marginals coarser = marginals(grid, runs, weights, 2 * stride);
    const double cell = std::pow(2 * stride, d);
    bool same = std::abs(std::log(coarser.sum * cell)) < k_same;
    for (Index k = 0; k < d && same; ++k) same = all.change_from(coarser, k) < k_same;
    if (!same) break;
  }
  return stride;
}

/// Every `stride`-th node as a point, but those that carry nothing (together less than 1e-6 of the mass).
void set_points(QuadraturePosterior& posterior, const Frame& frame, const Grid& grid,
                std::vector<GridRun> runs, Index stride) {
  const bool has_lattice = grid.dimension() == 2 && frame.axes.size() == 0;
  Eigen::VectorXd& weights = posterior.weights;
  const double floor = 1e-6 / weights.size();
  std::vector<Index> kept;
  kept.reserve(weights.size());
  if (has_lattice) posterior.lattice.places.reserve(kept.capacity());
  double sum = 0;
  for (const GridRun& run : runs) {
    if (!grid.is_every(stride, run.row)) continue;
    const bool is_every_other = grid.is_every(2 * stride, run.row);
    for (Index i = (run.begin + stride - 1) / stride * stride; i < run.end; i += stride) {
      const Index node = run.at + i - run.begin;
      if (weights[node] <= floor) continue;
      if (has_lattice) posterior.lattice.places.push_back({run.row, i, 0});
      if (is_every_other && i % (2 * stride) == 0) posterior.every_other.push_back(std::ssize(kept));
      kept.push_back(node);
      sum += weights[node];
    }
  }
  Eigen::VectorXd of_points = weights(kept) / sum;
  if (has_lattice) {
    posterior.lattice.axes = grid.axes();
    posterior.lattice.weights = std::move(weights);
    posterior.lattice.runs = std::move(runs);
  } else {
    posterior.turned_points = frame.to_z(numerics::nodes_of(grid.axes(), runs)(kept, Eigen::all));
  }
  weights = std::move(of_points);
  posterior.cell = 2.0 * stride * grid.spacing.asDiagonal().toDenseMatrix();
  if (frame.axes.size() > 0) posterior.cell = (frame.axes * posterior.cell).eval();
}

/// Marginal quantiles of z, d × levels.
Eigen::MatrixXd quantiles(const QuadraturePosterior& posterior, const Frame& frame, const Grid& grid,
                          const Marginals& all) {
  const Index d = grid.dimension();
  Eigen::MatrixXd result(d, std::ssize(k_quantile_levels));
  const Eigen::MatrixXd lines = grid.axes();
  const std::size_t n = posterior.weights.size();
  for (Index k = 0; k < d; ++k) {
    LineNodes line;
    if (frame.axes.size() == 0) {
      const std::size_t count = lines.rows();
      line.add({lines.col(k).data(), count}, {all.mass.col(k).data(), count}, lines(1, k) - lines(0, k));
    } else {
      const double spacing = 0.5 * posterior.cell.row(k).norm();
      line.add({posterior.turned_points.col(k).data(), n}, {posterior.weights.data(), n}, spacing);
    }
    result.row(k) = line.quantiles();
  }
  return result;
}

}  // namespace

Eigen::MatrixXd QuadraturePosterior::Lattice::points_on(const Eigen::MatrixXd& nodes) const {
  Eigen::MatrixXd points(std::ssize(places), nodes.cols());
  for (std::size_t i = 0; i < places.size(); ++i)
    for (Index k = 0; k < nodes.cols(); ++k) points(i, k) = nodes(places[i][k], k);
  return points;
}

QuadraturePosterior tensor_quadrature(LogDensity& target, const QuadratureOptions& options) {
  ModeSearch search;
  return tensor_quadrature(target, options, search);
}

QuadraturePosterior tensor_quadrature(LogDensity& target, const QuadratureOptions& options,
                                      ModeSearch& search) {
  const Index d = target.dimension();
  if (d < 1 || d > 3)
    throw UsageError(
        fmt::format("a grid takes 1 to 3 parameters, not {}: use \"transport\", \"mcmc\" or \"smc\"", d));
  GridDensity density(target, options, search);
  const Frame& frame = density.frame();
  if (std::pow(frame.coarse_nodes, d) > 2 * static_cast<double>(options.max_nodes)) {
    QuadraturePosterior unresolved;
    unresolved.evidence_change = std::numeric_limits<double>::infinity();
    return unresolved;
  }
  Eigen::VectorXd coarse_values;
  const Grid coarse = find_window(density, coarse_values);
  Grid grid = coarse;
  std::vector<GridRun> runs = all_nodes(coarse);
  Marginals all(0, d);
  QuadraturePosterior result = integrate(grid, runs, coarse_values, frame.log_volume(), all);
  const auto settled = [&] {
    return result.evidence_change < options.evidence_tolerance &&
           result.moment_change < options.moment_tolerance;
  };
  for (Index factor = 1, done = 1;; factor *= 2) {
    if (factor > 1) {
      grid.count = (coarse.count - 1) * factor + 1;
      grid.spacing = coarse.spacing / factor;
      runs = nodes_near_mass(coarse, coarse_values, grid, factor);
      result = integrate(grid, runs, density.evaluate(grid, runs), frame.log_volume(), all);
      done = factor;
    }
    const Index next = size_of(runs) << d;
    if (settled() || done == k_max_refinement || next > options.max_nodes) break;
  }
  const Index stride = stride_of_points(grid, runs, result.weights, all);
  set_points(result, frame, grid, std::move(runs), stride);
  result.quantiles = quantiles(result, frame, grid, all);
  result.evaluations = density.evaluations();
  return result;
}

}  // namespace knothe::posterior
