#include "knothe/posterior/quadrature/filled_quadrature.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/quadrature/lattice_rule.hpp"

namespace knothe::posterior {
namespace {

using Eigen::Index;
using numerics::GridRun;

/// Spacing of the first grid in standard deviations of the narrowest mode along its axes, others held:
/// evidence and moments of a Gaussian to 1e-8 and, with every other node of a chequerboard, 1e-3.
constexpr double k_first_spacing = 1;
constexpr Index k_segment = 8;     ///< nodes along a row that are evaluated together where that is cheap
constexpr Index k_scan_every = 4;  ///< lines of the grid between those that are looked at for modes not found
constexpr Index k_max_scan = 100;  ///< of these lines, where modes are far apart for their width
constexpr Index k_max_places = 1 << 26;  ///< segments that a window may have
constexpr int k_max_growths = 60, k_max_refinements = 12;
constexpr double k_line_change = 0.03;   ///< of `Marginals::line_change`
constexpr double k_min_deviation = 0.8;  ///< of a marginal, in spacings

/// Where the grid lies, and where its mass is looked for.
struct Frame {
  Eigen::Vector3d first, last;         ///< z, the window looked at first
  Eigen::Vector3d spacing;             ///< of the first grid
  std::vector<Eigen::Vector3d> modes;  ///< z
};

/// Seven and a half standard deviations around every mode that counts: the mass, `k_mask_depth` deep, and a
/// node.
Frame frame_of_modes(const std::vector<Mode>& modes) {
  constexpr double k_spreads = 7.5, k_negligible = 14;  ///< the latter of a mode's log-mass
  Eigen::Vector3d narrowest = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
  Frame frame{narrowest, -narrowest, {}, {}};
  for (const Mode& mode : modes) {
    if (mode.log_mass < modes[0].log_mass - k_negligible) continue;
    const Eigen::Vector3d spread = mode.lower.rowwise().norm().cwiseMax(k_min_spread);
    const Eigen::Vector3d at = mode.point.cwiseMax(-k_lattice_range).cwiseMin(k_lattice_range);
    narrowest = narrowest.cwiseMin(mode.lower.inverse().colwise().norm().cwiseInverse().transpose());
    frame.first = frame.first.cwiseMin(at - k_spreads * spread).cwiseMax(-k_lattice_range);
    frame.last = frame.last.cwiseMax(at + k_spreads * spread).cwiseMin(k_lattice_range);
    frame.modes.push_back(at);
  }
  frame.spacing = k_first_spacing * narrowest.cwiseMax(k_min_spread);
  return frame;
}

/// A uniform grid of z; a row lies along the last axis.
struct Grid {
  Eigen::Vector3d first, spacing;
  std::array<Index, 3> nodes{1, 1, 1};  ///< of each axis
  Index count = 0;                      ///< the largest of them: rows are numbered as if all axes had so many

  Grid(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Eigen::Vector3d& step)
      : first(from), spacing(step) {
    for (Index k = 0; k < 3; ++k) {
      const double intervals = std::ceil(std::min((to[k] - from[k]) / step[k], 1e9) - 1e-9);
      nodes[k] = intervals + 1;
      count = std::max(count, nodes[k]);
    }
    count = (count + k_segment - 1) / k_segment * k_segment;
  }
  /// The nodes of each axis, count × 3.
  [[nodiscard]] Eigen::MatrixXd axes() const {
    Eigen::MatrixXd result(count, 3);
    for (Index i = 0; i < count; ++i) result.row(i) = (first + i * spacing).transpose();
    return result;
  }
  /// Nodes of the first two axes at which row `row` lies.
  [[nodiscard]] std::array<Index, 2> places(Index row) const { return {row / count, row % count}; }
  /// 0 or 1, the first node of the row that belongs to every other of all, as the black squares of a
  /// chequerboard; the next ones follow two by two.
  [[nodiscard]] Index every_other(Index row) const { return (row / count + row % count) % 2; }
};

/// The target on grids of one frame.
class GridDensity {
 public:
  GridDensity(LogDensity& target, ModeSearch& search) : checked_(target) {
    auto* on_grid = dynamic_cast<numerics::GridEvaluator*>(&target);
    if (on_grid != nullptr && on_grid->has_grid()) by_rows_ = on_grid;
    std::vector<Mode> modes;
    search.run(checked_, true, modes);
    if (by_rows_ != nullptr) look_for_more(search, modes);
    frame_ = frame_of_modes(modes);
  }

  [[nodiscard]] const Frame& frame() const { return frame_; }
  [[nodiscard]] std::int64_t evaluations() const { return evaluations_ + checked_.evaluations(); }
  /// Nodes that are evaluated together at little more than the cost of one.
  [[nodiscard]] Index segment() const { return by_rows_ != nullptr ? k_segment : 1; }

  void set_grid(const Eigen::MatrixXd& axes) {
    axes_ = axes;
    if (by_rows_ != nullptr) by_rows_->set_grid(axes);
  }
  /// Log-density at these nodes, where the target knows no rows block by block.
  void evaluate(const std::vector<GridRun>& runs, Eigen::VectorXd& values) {
    values.resize(size_of(runs));
    if (by_rows_ != nullptr) {
      by_rows_->evaluate_runs(runs, values);
      evaluations_ += values.size();
      return;
    }
    evaluate_in_blocks(checked_, numerics::nodes_of(axes_, runs), batch_, values);
  }

 private:
  /// Ascents from the local maxima of a coarse lattice of the prior's range: three dimensions hide more modes
  /// than the search's own starts find.
  void look_for_more(ModeSearch& search, std::vector<Mode>& modes) {
    constexpr Index k_nodes = 16, k_max_starts = 24;
    constexpr double k_reach = 4.5;
    set_grid(Eigen::VectorXd::LinSpaced(k_nodes, -k_reach, k_reach).replicate(1, 3));
    std::vector<GridRun> runs;
    for (Index row = 0; row < k_nodes * k_nodes; ++row) runs.push_back({row, 0, k_nodes, row * k_nodes});
    Eigen::VectorXd values;
    evaluate(runs, values);
    std::vector<Index> maxima;
    for (Index node = 0; node < values.size(); ++node)
      if (is_local_maximum(values, node, k_nodes)) maxima.push_back(node);
    const auto kept = std::min<std::ptrdiff_t>(std::ssize(maxima), k_max_starts);
    std::partial_sort(maxima.begin(), maxima.begin() + kept, maxima.end(), [&](Index a, Index b) {
      return values[a] > values[b] || (values[a] == values[b] && a < b);
    });
    maxima.resize(kept);
    search.ascend_from(checked_, numerics::nodes_of(axes_, runs)(maxima, Eigen::all), modes);
  }
  static bool is_local_maximum(const Eigen::VectorXd& values, Index node, Index n) {
    const std::array<Index, 3> at{node / (n * n), node / n % n, node % n};
    for (Index a = std::max<Index>(at[0] - 1, 0); a <= std::min(at[0] + 1, n - 1); ++a)
      for (Index b = std::max<Index>(at[1] - 1, 0); b <= std::min(at[1] + 1, n - 1); ++b)
        for (Index c = std::max<Index>(at[2] - 1, 0); c <= std::min(at[2] + 1, n - 1); ++c)
          if (values[(a * n + b) * n + c] > values[node]) return false;
    return true;
  }

  CheckedDensity checked_;
  Frame frame_;
  numerics::GridEvaluator* by_rows_ = nullptr;
  std::int64_t evaluations_ = 0;
  Eigen::MatrixXd axes_;
  LogDensityBatch batch_;
};

/// The nodes of a grid that hold the mass: from seeds on, neighbour by neighbour, as long as the log-density
/// is within `k_mask_depth` of the maximum. Nodes are looked at in segments of a row.
class Fill {
 public:
  Fill(GridDensity& target, const Grid& grid, Index max_nodes)
      : target_(target),
        grid_(grid),
        max_nodes_(max_nodes),
        length_(target.segment()),
        planes_(grid.nodes[0]),
        lines_(grid.nodes[1]),
        segments_((grid.nodes[2] + length_ - 1) / length_) {
    if (1.0 * planes_ * lines_ * segments_ > k_max_places) {
      too_many_ = true;
      return;
    }
    seen_.assign(planes_ * lines_ * segments_, 0);
    target_.set_grid(grid.axes());
  }

  /// The node nearest to z.
  void add_seed(const Eigen::Vector3d& z) {
    if (too_many_) return;
    std::array<Index, 3> at{};
    for (Index k = 0; k < 3; ++k) {
      const double i = std::round((z[k] - grid_.first[k]) / grid_.spacing[k]);
      at[k] = std::clamp<Index>(i, 0, grid_.nodes[k] - 1);
    }
    want(at[0], at[1], at[2] / length_);
  }
  void run() {
    while (!wanted_.empty() && !too_many_) look();
    if (!too_many_) gather();
  }

  /// In which mass comes up to a face of the window.
  struct Faces {
    std::array<bool, 3> low{}, high{};
  };
  [[nodiscard]] const Faces& touched() const { return touched_; }
  [[nodiscard]] bool too_many() const { return too_many_; }
  [[nodiscard]] std::vector<GridRun>& runs() { return runs_; }
  [[nodiscard]] Eigen::VectorXd& values() { return values_; }

 private:
  struct Found {
    Index id, at;  ///< number of the segment, place of its values
  };

  void want(Index plane, Index line, Index segment) {
    const Index id = (plane * lines_ + line) * segments_ + segment;
    char& seen = seen_[id];
    if (seen != 0) return;
    seen = 1;
    wanted_.push_back(id);
  }
  [[nodiscard]] GridRun run_of(Index id, Index at) const {
    const Index row = id / segments_, begin = id % segments_ * length_;
    return {row / lines_ * grid_.count + row % lines_, begin, begin + length_, at};
  }

  /// Evaluates what is wanted, and wants its neighbours.
  void look() {
    std::sort(wanted_.begin(), wanted_.end());
    wave_.swap(wanted_);
    wanted_.clear();
    runs_.clear();
    for (const Index id : wave_) append(run_of(id, size_of(runs_)));
    target_.evaluate(runs_, values_);
    top_ = std::max(top_, values_.maxCoeff());
    const auto old = std::ssize(all_values_);
    all_values_.insert(all_values_.end(), values_.data(), values_.data() + values_.size());
    for (Index i = 0; i < std::ssize(wave_); ++i) {
      const Index at = old + i * length_;
      found_.push_back({wave_[i], at});
      want_neighbours(wave_[i], all_values_.data() + at);
    }
    too_many_ = std::ssize(all_values_) > max_nodes_;
  }
  void want_neighbours(Index id, const double* value) {
    const double floor = mask_floor(top_);
    if (*std::max_element(value, value + length_) <= floor) return;
    const Index segment = id % segments_, line = id / segments_ % lines_, plane = id / segments_ / lines_;
    // Outside the mass a segment is one node too long at most.
    const Index from = value[0] > floor ? -1 : 0, to = value[length_ - 1] > floor ? 1 : 0;
    for (Index a = -1; a <= 1; ++a) {
      if (!inside(plane + a, planes_, 0)) continue;
      for (Index b = -1; b <= 1; ++b) {
        if (!inside(line + b, lines_, 1)) continue;
        for (Index c = from; c <= to; ++c)
          if (inside(segment + c, segments_, 2)) want(plane + a, line + b, segment + c);
      }
    }
  }
  bool inside(Index i, Index n, std::size_t axis) {
    if (i < 0) touched_.low[axis] = true;
    if (i >= n) touched_.high[axis] = true;
    return i >= 0 && i < n;
  }
  void append(const GridRun& run) {
    if (!runs_.empty() && runs_.back().row == run.row && runs_.back().end == run.begin) {
      runs_.back().end = run.end;
    } else {
      runs_.push_back(run);
    }
  }
  /// All segments in their order.
  void gather() {
    std::sort(found_.begin(), found_.end(), [](const Found& a, const Found& b) { return a.id < b.id; });
    runs_.clear();
    values_.resize(std::ssize(found_) * length_);
    for (Index at = 0; const Found& f : found_) {
      append(run_of(f.id, at));
      std::copy_n(all_values_.data() + f.at, length_, values_.data() + at);
      at += length_;
    }
  }

  GridDensity& target_;
  const Grid& grid_;
  Index max_nodes_, length_, planes_, lines_, segments_;
  std::vector<char> seen_;
  std::vector<Index> wanted_, wave_;
  std::vector<Found> found_;
  std::vector<double> all_values_;
  std::vector<GridRun> runs_;
  Eigen::VectorXd values_;
  double top_ = -std::numeric_limits<double>::infinity();
  Faces touched_;
  bool too_many_ = false;
};

/// Places within `k_mask_depth` of the highest of a coarse look at a window, z.
std::vector<Eigen::Vector3d> scan(GridDensity& target, const Grid& grid) {
  const Eigen::MatrixXd axes = grid.axes();
  target.set_grid(axes);
  std::vector<GridRun> runs;
  for (Index a = 0; a < grid.nodes[0]; ++a)
    for (Index b = 0; b < grid.nodes[1]; ++b)
      runs.push_back({a * grid.count + b, 0, grid.nodes[2], size_of(runs)});
  Eigen::VectorXd values;
  target.evaluate(runs, values);
  const double floor = mask_floor(values.maxCoeff());
  std::vector<Eigen::Vector3d> places;
  for (const GridRun& run : runs) {
    const auto [plane, line] = grid.places(run.row);
    for (Index i = 0; i < grid.nodes[2]; ++i)
      if (values[run.at + i] > floor) places.emplace_back(axes(plane, 0), axes(line, 1), axes(i, 2));
  }
  return places;
}

/// The window grows by half where mass comes up to a face of it; whether it did.
bool grow(const Fill::Faces& touched, Eigen::Vector3d& first, Eigen::Vector3d& last) {
  const Eigen::Vector3d from = first, to = last, step = (last - first) / 2;
  for (Index k = 0; k < 3; ++k) {
    if (touched.low[k]) first[k] = std::max(from[k] - step[k], -k_lattice_range);
    if (touched.high[k]) last[k] = std::min(to[k] + step[k], k_lattice_range);
  }
  return first != from || last != to;
}

/// How much even lines of axis k differ from all: in mass and, a fifth of it, in mean and standard deviation
/// (in standard deviations). Of a Gaussian less than one per cent with a spacing of its standard deviation;
/// its fourth power or so is what the whole grid errs by along this axis.
double line_change(const Marginals& all, Index k) {
  Marginals even(all.mass.rows(), 1);
  for (Index i = 0; i < all.mass.rows(); i += 2) even.sum += even.mass(i, 0) = all.mass(i, k);
  const auto [mean, deviation] = all.moments(k);
  const auto [even_mean, even_deviation] = even.moments(0);
  if (deviation < k_min_deviation) return 1;
  return std::max({std::abs(2 * even.sum / all.sum - 1), 0.2 * std::abs(even_mean - mean) / deviation,
                   0.2 * std::abs(even_deviation / deviation - 1)});
}

/// Of every node, or of every other.
Marginals marginals(const Grid& grid, const std::vector<GridRun>& runs, const Eigen::VectorXd& weights,
                    bool all) {
  Marginals result(grid.count, 3);
  for (const GridRun& run : runs)
    result.add(run, weights, all ? run.begin : run.begin + (run.begin + grid.every_other(run.row)) % 2,
               all ? 1 : 2, grid.places(run.row));
  return result;
}

/// The rule on the nodes given: evidence, errors, weights of all nodes; no points, no quantiles.
QuadraturePosterior integrate(const Grid& grid, const std::vector<GridRun>& runs,
                              const Eigen::VectorXd& values, Marginals& all) {
  QuadraturePosterior result;
  const double top = values.maxCoeff();
  result.weights = (values.array() - top).exp();
  all = marginals(grid, runs, result.weights, true);
  const Marginals half = marginals(grid, runs, result.weights, false);
  result.weights /= all.sum;
  result.log_evidence = top + std::log(all.sum) + grid.spacing.array().log().sum();
  result.evidence_change = std::abs(std::log(2 * half.sum / all.sum));
  for (Index k = 0; k < 3; ++k) {
    result.moment_change = std::max(result.moment_change, all.change_from(half, k));
    result.line_change = std::max(result.line_change, line_change(all, k));
    result.mass_at_border += (all.mass(0, k) + all.mass(grid.nodes[k] - 1, k)) / all.sum;
  }
  result.per_axis = *std::max_element(grid.nodes.begin(), grid.nodes.end());
  return result;
}

/// The points, but those that carry nothing (together less than 1e-6 of the mass): forecasts look at every
/// point there is.
void set_points(QuadraturePosterior& posterior, const Grid& grid, std::vector<GridRun> runs) {
  Eigen::VectorXd& weights = posterior.weights;
  const double floor = 1e-6 / weights.size();
  std::vector<Index> kept;
  kept.reserve(weights.size());
  double sum = 0;
  for (const GridRun& run : runs) {
    const auto [plane, line] = grid.places(run.row);
    const Index every_other = grid.every_other(run.row);
    for (Index i = run.begin, node = run.at; i < run.end; ++i, ++node) {
      if (weights[node] <= floor) continue;
      posterior.lattice.places.push_back({plane, line, i});
      if ((i + every_other) % 2 == 0) posterior.every_other.push_back(std::ssize(kept));
      kept.push_back(node);
      sum += weights[node];
    }
  }
  Eigen::VectorXd of_points = weights(kept) / sum;
  posterior.lattice.axes = grid.axes();
  const Eigen::Matrix3d steps{{1, 1, 0}, {1, 0, 1}, {0, 1, 1}};  // to the next ones of every other node
  posterior.cell = grid.spacing.asDiagonal() * steps;
  posterior.lattice.weights = std::move(weights);
  posterior.lattice.runs = std::move(runs);
  weights = std::move(of_points);
}

/// Quantiles of z of several lattices, the k-th of them with `shares[k]` of the mass: 3 × levels.
Eigen::MatrixXd quantiles(std::span<const QuadraturePosterior> lattices, std::span<const double> shares) {
  std::array<LineNodes, 3> lines;
  for (std::size_t i = 0; i < lattices.size(); ++i) {
    const QuadraturePosterior::Lattice& lattice = lattices[i].lattice;
    const Index count = lattice.axes.rows();
    Marginals all(count, 3);
    for (const GridRun& run : lattice.runs)
      all.add(run, lattice.weights, run.begin, 1, std::array{run.row / count, run.row % count});
    for (std::size_t k = 0; k < 3; ++k) {
      const double* line = lattice.axes.col(k).data();
      const std::size_t n = count;
      lines[k].add({line, n}, {all.mass.col(k).data(), n}, line[1] - line[0], shares[i]);
    }
  }
  Eigen::MatrixXd result(3, std::ssize(numerics::k_quantile_levels));
  for (std::size_t k = 0; k < 3; ++k) result.row(k) = lines[k].quantiles();
  return result;
}

}  // namespace

QuadraturePosterior filled_quadrature(LogDensity& target, const QuadratureOptions& options,
                                      ModeSearch& search) {
  if (target.dimension() != 3) throw UsageError("filled_quadrature takes three parameters");
  GridDensity density(target, search);
  const Frame& frame = density.frame();
  Eigen::Vector3d first = frame.first, last = frame.last, spacing = frame.spacing;
  std::vector<Eigen::Vector3d> seeds = frame.modes;
  const Eigen::Vector3d coarse = (k_scan_every * spacing).cwiseMax((last - first) / k_max_scan);
  std::ranges::move(scan(density, Grid(first, last, coarse)), std::back_inserter(seeds));
  QuadraturePosterior result;
  result.evidence_change = std::numeric_limits<double>::infinity();
  for (int growths = 0, refinements = 0;;) {
    const Grid grid(first, last, spacing);
    Fill fill(density, grid, options.max_nodes);
    for (const Eigen::Vector3d& z : seeds) fill.add_seed(z);
    fill.run();
    if (fill.too_many()) break;
    if (grow(fill.touched(), first, last) && growths++ < k_max_growths) continue;
    Marginals all(0, 3);
    result = integrate(grid, fill.runs(), fill.values(), all);
    const bool settled = result.evidence_change < options.evidence_tolerance &&
                         result.moment_change < options.moment_tolerance &&
                         result.line_change < k_line_change;
    if (!settled && refinements++ < k_max_refinements) {
      // Finer along the axes that the grid's error comes from.
      Eigen::Array3d change;
      for (Index k = 0; k < 3; ++k) change[k] = line_change(all, k);
      const double finer = std::min(k_line_change, 0.5 * change.maxCoeff());
      spacing = (change >= finer).select(spacing / 2, spacing).eval();
      continue;
    }
    set_points(result, grid, std::move(fill.runs()));
    result.quantiles = quantiles({&result, 1}, std::array{1.0});
    break;
  }
  result.evaluations = density.evaluations();
  return result;
}

QuadraturePosterior joined(std::span<const QuadraturePosterior> parts) {
  QuadraturePosterior result;
  const Index n = std::ssize(parts);
  Eigen::VectorXd log_evidences(n);
  for (Index i = 0; i < n; ++i) log_evidences[i] = parts[i].log_evidence;
  result.log_evidence = numerics::log_sum(log_evidences);
  const Eigen::VectorXd shares = (log_evidences.array() - result.log_evidence).exp();
  Index points = 0;
  for (const QuadraturePosterior& part : parts) points += part.weights.size();
  result.turned_points.resize(points, 3);
  result.weights.resize(points);
  for (Index i = 0, at = 0; i < n; ++i) {
    const QuadraturePosterior& part = parts[i];
    const Index count = part.weights.size();
    result.turned_points.middleRows(at, count) = part.points();
    result.weights.segment(at, count) = shares[i] * part.weights;
    at += count;
    result.evidence_change = std::max(result.evidence_change, part.evidence_change);
    result.moment_change = std::max(result.moment_change, part.moment_change);
    result.line_change = std::max(result.line_change, part.line_change);
    result.mass_at_border = std::max(result.mass_at_border, part.mass_at_border);
    result.per_axis = std::max(result.per_axis, part.per_axis);
    result.evaluations += part.evaluations;
  }
  result.quantiles = quantiles(parts, {shares.data(), parts.size()});
  return result;
}

}  // namespace knothe::posterior
