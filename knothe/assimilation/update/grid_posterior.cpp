#include "knothe/assimilation/update/grid_posterior.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

/// A tensor grid: per axis its first node and spacing.
struct Window {
  Eigen::VectorXd first, last;
  int points;

  [[nodiscard]] double spacing(Eigen::Index k) const { return (last[k] - first[k]) / (points - 1); }
  [[nodiscard]] double node(Eigen::Index k, Eigen::Index i) const {
    return first[k] + static_cast<double>(i) * spacing(k);
  }
};

/// Visits the grid in blocks of rows along the last axis: body(multi-index of the block's start, log-density
/// along the axis).
template <class Body>
void for_each_row(sampling::LogDensity& target, const Window& window, const Body& body) {
  const Eigen::Index d = window.first.size(), n = window.points;
  Eigen::MatrixXd z(n, d);
  for (Eigen::Index i = 0; i < n; ++i) z(i, d - 1) = window.node(d - 1, i);
  sampling::LogDensityBatch batch;
  batch.resize(n, d, 0);
  std::vector<Eigen::Index> index(d, 0);
  while (true) {
    for (Eigen::Index k = 0; k + 1 < d; ++k) z.col(k).setConstant(window.node(k, index[k]));
    target.evaluate(z, 0, batch);
    body(index, batch.value);
    Eigen::Index k = d - 2;
    while (k >= 0 && ++index[k] == n) index[k--] = 0;
    if (k < 0) return;
  }
}

/// The part of the window where the log-density is within `depth` of its maximum, one node wider on each
/// side.
Window zoom(sampling::LogDensity& target, const Window& window, double depth, double& maximum) {
  const Eigen::Index d = window.first.size();
  maximum = -std::numeric_limits<double>::infinity();
  for_each_row(target, window,
               [&](const auto&, const Eigen::VectorXd& row) { maximum = std::max(maximum, row.maxCoeff()); });
  std::vector<Eigen::Index> least(d, window.points), most(d, 0);
  for_each_row(target, window, [&](const std::vector<Eigen::Index>& index, const Eigen::VectorXd& row) {
    for (Eigen::Index i = 0; i < row.size(); ++i) {
      if (!(row[i] > maximum - depth)) continue;
      for (Eigen::Index k = 0; k < d; ++k) {
        const Eigen::Index at = k + 1 == d ? i : index[k];
        least[k] = std::min(least[k], at);
        most[k] = std::max(most[k], at);
      }
    }
  });
  Window result = window;
  for (Eigen::Index k = 0; k < d; ++k) {
    result.first[k] = window.node(k, std::max<Eigen::Index>(least[k] - 1, 0));
    result.last[k] = window.node(k, std::min<Eigen::Index>(most[k] + 1, window.points - 1));
  }
  return result;
}

}  // namespace

GridPosterior grid_posterior(sampling::LogDensity& target, const GridPosterior::Transform& transform,
                             const GridOptions& options) {
  const Eigen::Index d = target.dimension();
  if (d < 1 || d > 3) {
    throw ProjectError("method.kind = \"grid\" takes 1 to 3 parameters; use \"transport\" for more");
  }
  static constexpr int k_points[] = {2001, 301, 101};
  const int points = options.points > 0 ? options.points : k_points[d - 1];
  Window window{Eigen::VectorXd::Constant(d, -options.range), Eigen::VectorXd::Constant(d, options.range),
                points};
  double maximum = 0;
  for (int pass = 0; pass < 8; ++pass) {
    const Window smaller = zoom(target, window, options.depth, maximum);
    const double shrink =
        ((smaller.last - smaller.first).array() / (window.last - window.first).array()).minCoeff();
    window = smaller;
    if (shrink > 0.8) break;
  }

  GridPosterior result;
  const Eigen::Index n = points;
  result.nodes.resize(n, d);
  Eigen::MatrixXd value(n, d);
  for (Eigen::Index k = 0; k < d; ++k) {
    for (Eigen::Index i = 0; i < n; ++i) {
      result.nodes(i, k) = window.node(k, i);
      value(i, k) = transform(k, result.nodes(i, k));
    }
  }
  result.marginal.setZero(n, d);
  Eigen::MatrixXd second = Eigen::MatrixXd::Zero(d, d);
  Eigen::VectorXd first = Eigen::VectorXd::Zero(d), here(d);
  const Eigen::VectorXd origin = value.row(n / 2);  // moments about a point of the window lose no digits
  double sum = 0;
  for_each_row(target, window, [&](const std::vector<Eigen::Index>& index, const Eigen::VectorXd& row) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double weight = std::exp(row[i] - maximum);
      if (weight == 0) continue;
      for (Eigen::Index k = 0; k < d; ++k) {
        const Eigen::Index at = k + 1 == d ? i : index[k];
        result.marginal(at, k) += weight;
        here[k] = value(at, k) - origin[k];
      }
      sum += weight;
      first += weight * here;
      second.noalias() += weight * here * here.transpose();
    }
  });
  double log_cell = 0;
  for (Eigen::Index k = 0; k < d; ++k) {
    log_cell += std::log(window.spacing(k));
    result.marginal.col(k) /= sum * window.spacing(k);
  }
  result.log_evidence = maximum + std::log(sum) + log_cell;
  result.mean = origin + first / sum;
  result.covariance = second / sum - (first / sum) * (first / sum).transpose();
  for (Eigen::Index k = 0; k < d; ++k) {
    const double m = result.marginal.col(k).dot(result.nodes.col(k)) * window.spacing(k);
    const double v = (result.marginal.col(k).array() * (result.nodes.col(k).array() - m).square()).sum() *
                     window.spacing(k);
    if (std::sqrt(v) < 6 * window.spacing(k)) result.resolved = false;
  }
  return result;
}

GridPoints grid_points(sampling::LogDensity& target, const GridPosterior& posterior) {
  static constexpr int k_points[] = {4001, 64, 16};
  const Eigen::Index d = target.dimension();
  const Window window{posterior.nodes.row(0), posterior.nodes.row(posterior.nodes.rows() - 1),
                      k_points[d - 1]};
  const auto n = static_cast<Eigen::Index>(std::pow(window.points, d) + 0.5);
  GridPoints result;
  result.points.resize(n, d);
  Eigen::VectorXd log_density(n);
  Eigen::Index next = 0;
  for_each_row(target, window, [&](const std::vector<Eigen::Index>& index, const Eigen::VectorXd& row) {
    for (Eigen::Index i = 0; i < row.size(); ++i, ++next) {
      for (Eigen::Index k = 0; k < d; ++k) result.points(next, k) = window.node(k, k + 1 == d ? i : index[k]);
      log_density[next] = row[i];
    }
  });
  result.weights = (log_density.array() - log_density.maxCoeff()).exp();
  result.weights /= result.weights.sum();
  return result;
}

double GridPosterior::quantile(Eigen::Index k, double level) const {
  const double h = nodes(1, k) - nodes(0, k);
  double before = 0;
  for (Eigen::Index i = 1; i < nodes.rows(); ++i) {
    const double a = marginal(i - 1, k), b = marginal(i, k), cell = 0.5 * h * (a + b);
    if (before + cell >= level || i + 1 == nodes.rows()) {
      // Within the cell the density is linear: solve a t + (b − a) t²/2 = (level − before)/h for t in [0, 1].
      const double target = std::clamp((level - before) / h, 0.0, cell / h);
      const double root = std::sqrt(std::max(0.0, a * a + 2 * (b - a) * target));
      const double t = a + root > 0 ? 2 * target / (a + root) : 0.5;
      return nodes(i - 1, k) + std::clamp(t, 0.0, 1.0) * h;
    }
    before += cell;
  }
  return nodes(nodes.rows() - 1, k);
}

}  // namespace knothe::assimilation
