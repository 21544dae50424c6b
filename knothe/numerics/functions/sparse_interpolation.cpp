#include "knothe/numerics/functions/sparse_interpolation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::numerics {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// Where Π |x − x_j| is largest between two neighbours of the sorted nodes: its logarithm is concave there.
double stationary_point(const std::vector<double>& nodes, double left, double right) {
  double a = left, b = right;
  while (true) {
    const double middle = 0.5 * (a + b);
    if (middle <= a || middle >= b) return middle;
    double slope = 0;
    for (const double x : nodes) slope += 1 / (middle - x);
    (slope > 0 ? a : b) = middle;
  }
}

double next_leja_node(const std::vector<double>& nodes) {
  std::vector<double> sorted = nodes;
  std::sort(sorted.begin(), sorted.end(), std::greater<>());
  double best = 0, largest = -1;
  for (Index i = 1; i < std::ssize(sorted); ++i) {
    const double x = stationary_point(nodes, sorted[i], sorted[i - 1]);
    double product = 1;
    for (const double node : nodes) product *= 2 * std::abs(x - node);  // 2: the capacity is ½
    if (product > largest * (1 + 1e-9)) {
      largest = product;
      best = x;
    }
  }
  return best;
}

void extend_leja(std::vector<double>& nodes, int count) {
  static const std::vector<double> k_first = {0, 1, -1};
  while (std::ssize(nodes) < count)
    nodes.push_back(nodes.size() < k_first.size() ? k_first[nodes.size()] : next_leja_node(nodes));
}

std::string written(const MultiIndex& index) {
  return fmt::format("({})", fmt::join(index, ", "));
}

}  // namespace

std::vector<double> leja_nodes(int count) {
  std::vector<double> nodes;
  extend_leja(nodes, count);
  return nodes;
}

SparseInterpolation::SparseInterpolation(VectorXd lower, VectorXd upper)
    : lower_(std::move(lower)), upper_(std::move(upper)), degree_(lower_.size(), 0) {
  if (lower_.size() == 0 || lower_.size() != upper_.size() || !lower_.allFinite() || !upper_.allFinite() ||
      !(lower_.array() < upper_.array()).all())
    throw UsageError("sparse interpolation: the box must be finite, each upper end above its lower one");
}

void SparseInterpolation::add(const MultiIndex& index) {
  if (index.size() != degree_.size() || *std::min_element(index.begin(), index.end()) < 0)
    throw UsageError(
        fmt::format("sparse interpolation: {} is no index of {} variables", written(index), degree_.size()));
  if (contains(index))
    throw UsageError(fmt::format("sparse interpolation: index {} is there already", written(index)));
  for (Index i = 0; i < std::ssize(index); ++i) {
    if (index[i] == 0) continue;
    MultiIndex smaller = index;
    --smaller[i];
    if (!contains(smaller))
      throw UsageError(
          fmt::format("sparse interpolation: index {} needs {} before it", written(index), written(smaller)));
  }
  for (Index i = 0; i < std::ssize(index); ++i) degree_[i] = std::max(degree_[i], index[i]);
  extend_leja(nodes_, *std::max_element(index.begin(), index.end()) + 1);
  const Index place = count();
  place_[index] = place;
  indices_.push_back(index);
  if (place == triangle_.rows()) triangle_.conservativeResize(2 * place + 16, 2 * place + 16);
  triangle_.row(place).head(count()) = basis(node(index)).transpose();
}

VectorXd SparseInterpolation::node(const MultiIndex& index) const {
  VectorXd p(dimension());
  for (Index i = 0; i < dimension(); ++i) {
    const double x = nodes_[index[i]];
    p[i] = std::clamp(0.5 * ((1 - x) * lower_[i] + (1 + x) * upper_[i]), lower_[i], upper_[i]);
  }
  return p;
}

MatrixXd SparseInterpolation::factors_with_slope(Index i, double x) const {
  const int n = degree(i) + 1;
  const double scale = 2 / (upper_[i] - lower_[i]);
  const double t = scale * (x - lower_[i]) - 1;
  MatrixXd result(n, 2);
  for (int k = 0; k < n; ++k) {
    double value = 1, slope = 0;
    const double own = nodes_[k];
    for (int j = 0; j < k; ++j) {
      const double other = nodes_[j], width = own - other;
      slope = (slope * (t - other) + value) / width;
      value *= (t - other) / width;
    }
    result(k, 0) = value;
    result(k, 1) = scale * slope;
  }
  return result;
}

VectorXd SparseInterpolation::factors(Index i, double x, int degree) const {
  return factors_with_slope(i, x).col(0).head(degree + 1);
}

VectorXd SparseInterpolation::basis(const VectorXd& p) const {
  VectorXd result = VectorXd::Ones(count());
  for (Index i = 0; i < dimension(); ++i) {
    const VectorXd factor = factors_with_slope(i, p[i]).col(0);
    for (Index n = 0; n < count(); ++n) result[n] *= factor[indices_[n][i]];
  }
  return result;
}

MatrixXd SparseInterpolation::basis_gradient(const VectorXd& p) const {
  MatrixXd result = MatrixXd::Ones(count(), dimension());
  for (Index i = 0; i < dimension(); ++i) {
    const MatrixXd factor = factors_with_slope(i, p[i]);
    for (Index n = 0; n < count(); ++n) {
      const int k = indices_[n][i];
      for (Index j = 0; j < dimension(); ++j) result(n, j) *= factor(k, i == j ? 1 : 0);
    }
  }
  return result;
}

MatrixXd SparseInterpolation::surpluses(const MatrixXd& values) const {
  if (values.rows() > count())
    throw UsageError(fmt::format("sparse interpolation: {} values for {} nodes", values.rows(), count()));
  const Index n = values.rows();
  return triangle_.topLeftCorner(n, n).triangularView<Eigen::UnitLower>().solve(values);
}

}  // namespace knothe::numerics
