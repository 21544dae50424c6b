#include "knothe/numerics/statistics/distinct_draws.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::numerics {
namespace {

/// Inside the bounds; what lies beyond one of them is reflected there.
double reflected(double value, double lower, double upper) {
  if (value < lower) value = 2 * lower - value;
  if (value > upper) value = 2 * upper - value;
  return std::clamp(value, lower, upper);
}

/// The points (n × d) in coordinates in which `covariance` is the unit matrix; directions without spread are
/// left out. By way of the correlations: one coordinate may be in pascals and another a pure number.
Eigen::MatrixXd whitened(const Eigen::MatrixXd& points, const Eigen::MatrixXd& covariance) {
  const auto inverse_root = [](double variance, double least) {
    return variance > least ? 1 / std::sqrt(variance) : 0.0;
  };
  const Eigen::VectorXd scale =
      covariance.diagonal().unaryExpr([&](double variance) { return inverse_root(variance, 0); });
  const SymmetricEigen axes(scale.asDiagonal() * covariance * scale.asDiagonal());
  const Eigen::VectorXd of_axes =
      axes.eigenvalues().unaryExpr([&](double variance) { return inverse_root(variance, 1e-12); });
  return points * scale.asDiagonal() * axes.eigenvectors() * of_axes.asDiagonal();
}

/// Points (n × d) halved along their widest coordinate again and again, so that the nearest are found by
/// looking at few of them.
class NearestPoints {
 public:
  explicit NearestPoints(const Eigen::MatrixXd& points)
      : points_(points.transpose()), order_(points.rows()), axes_(points.rows()), borders_(points.rows()) {
    std::iota(order_.begin(), order_.end(), Index{0});
    halve(0, std::ssize(order_));
  }

  /// The `count` nearest, nearest first.
  [[nodiscard]] std::vector<Index> to(const Eigen::VectorXd& point, Index count) {
    point_ = point;
    count_ = count;
    found_.clear();
    search(0, std::ssize(order_));
    std::sort_heap(found_.begin(), found_.end());
    std::vector<Index> nearest;
    for (const auto& [distance, i] : found_) nearest.push_back(i);
    return nearest;
  }

 private:
  static constexpr Index k_leaf = 16;

  void halve(Index begin, Index end) {
    if (end - begin <= k_leaf) return;
    Eigen::VectorXd lower = points_.col(order_[begin]), upper = lower;
    for (Index i = begin; i < end; ++i) {
      lower = lower.cwiseMin(points_.col(order_[i]));
      upper = upper.cwiseMax(points_.col(order_[i]));
    }
    const Index middle = (begin + end) / 2;
    Index& axis = axes_[middle];
    (upper - lower).maxCoeff(&axis);
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [&](Index a, Index b) { return points_(axis, a) < points_(axis, b); });
    borders_[middle] = points_(axis, order_[middle]);
    halve(begin, middle);
    halve(middle, end);
  }

  void search(Index begin, Index end) {
    if (end - begin <= k_leaf) {
      for (Index i = begin; i < end; ++i) add(order_[i]);
      return;
    }
    const Index middle = (begin + end) / 2;
    const double beyond = point_[axes_[middle]] - borders_[middle];
    beyond < 0 ? search(begin, middle) : search(middle, end);
    if (std::ssize(found_) < count_ || beyond * beyond <= found_.front().first)
      beyond < 0 ? search(middle, end) : search(begin, middle);
  }

  void add(Index i) {
    const std::pair candidate{(points_.col(i) - point_).squaredNorm(), i};
    if (std::ssize(found_) == count_) {
      if (!(candidate < found_.front())) return;
      std::pop_heap(found_.begin(), found_.end());
      found_.pop_back();
    }
    found_.push_back(candidate);
    std::push_heap(found_.begin(), found_.end());
  }

  Eigen::MatrixXd points_;  ///< d × n
  std::vector<Index> order_;
  std::vector<Index> axes_;      ///< of the halves that begin and end at a place of the order
  std::vector<double> borders_;  ///< on this axis
  Eigen::VectorXd point_;
  Index count_ = 0;
  std::vector<std::pair<double, Index>> found_;  ///< squared distances: a heap, the farthest first
};

/// From each of the draws `repeated` a normal step of the covariance that the nearest of the draws `distinct`
/// have about their mean. Shortened, all alike, so that the steps add at most 1 % to the variance of any
/// axis.
Eigen::MatrixXd local_steps(const Eigen::MatrixXd& draws, const std::vector<Index>& distinct,
                            const std::vector<Index>& repeated, const Eigen::MatrixXd& covariance) {
  constexpr double k_added_variance = 0.01;
  const Index d = draws.cols();
  const auto m = std::ssize(distinct);
  const Index neighbours = std::min(m, 2 * d + 2);
  const Eigen::MatrixXd positions = draws(distinct, Eigen::all), near = whitened(positions, covariance),
                        from = whitened(draws(repeated, Eigen::all), covariance);
  const Eigen::MatrixXd normal = monte_carlo_normal_points(from.rows(), neighbours, 1);
  NearestPoints distinct_points(near);
  Eigen::MatrixXd steps(from.rows(), d);
  Eigen::VectorXd variance = Eigen::VectorXd::Zero(d);  // of a step, by whitened coordinate
  for (Index i = 0; i < from.rows(); ++i) {
    const std::vector<Index> nearest = distinct_points.to(from.row(i).transpose(), neighbours);
    const Eigen::VectorXd factors = (normal.row(i).array() - normal.row(i).mean()).matrix().transpose() /
                                    std::sqrt(std::max<Index>(1, neighbours - 1));
    steps.row(i) = factors.transpose() * positions(nearest, Eigen::all);
    variance += (factors.transpose() * near(nearest, Eigen::all)).cwiseAbs2().transpose();
  }
  const double most = variance.maxCoeff() / steps.rows();
  return steps * std::min(1.0, std::sqrt(k_added_variance / std::max(most, 1e-300)));
}

/// Values of one coordinate of a lattice: each is moved within its cell, which ends half-way to the nearer of
/// the neighbours that it has among all `nodes`.
void move_in_cells(Eigen::Ref<Eigen::VectorXd> values, std::vector<double> nodes,
                   const Eigen::Ref<const Eigen::VectorXd>& uniform) {
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  for (Index j = 0; j < values.size(); ++j) {
    const auto node = std::lower_bound(nodes.begin(), nodes.end(), values[j]);
    double width = std::numeric_limits<double>::infinity();
    if (node != nodes.begin()) width = *node - *(node - 1);
    if (node + 1 != nodes.end()) width = std::min(width, *(node + 1) - *node);
    if (std::isfinite(width)) values[j] += (uniform[j] - 0.5) * width;
  }
}

std::size_t distinct_values(const Eigen::Ref<const Eigen::VectorXd>& values) {
  return std::set<double>(values.begin(), values.end()).size();
}

}  // namespace

Eigen::MatrixXd distinct_draws(const Eigen::Ref<const Eigen::MatrixXd>& points,
                               const Eigen::Ref<const Eigen::VectorXd>& weights, Index count,
                               const Eigen::Ref<const Eigen::VectorXd>& lower,
                               const Eigen::Ref<const Eigen::VectorXd>& upper) {
  const Eigen::MatrixXd drawn = resample(points, weights, count, 1);
  Eigen::MatrixXd draws = drawn;
  // By value: a chain that stayed has the same point several times.
  std::set<std::vector<double>> seen;
  std::vector<Index> distinct, repeated;
  for (Index j = 0; j < count; ++j)
    (seen.emplace(draws.row(j).begin(), draws.row(j).end()).second ? distinct : repeated).push_back(j);
  if (!repeated.empty())
    draws(repeated, Eigen::all) +=
        local_steps(draws, distinct, repeated, moments_of(points, weights).covariance);
  const Eigen::MatrixXd uniform = monte_carlo_points(count, draws.cols(), 1);
  for (Index k = 0; k < draws.cols(); ++k) {
    if (2 * distinct_values(drawn.col(k)) < seen.size()) {
      draws.col(k) = drawn.col(k);
      move_in_cells(draws.col(k), {points.col(k).begin(), points.col(k).end()}, uniform.col(k));
    }
    for (double& value : draws.col(k)) value = reflected(value, lower[k], upper[k]);
  }
  return draws;
}

}  // namespace knothe::numerics
