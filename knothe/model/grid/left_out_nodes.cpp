#include "knothe/model/grid/left_out_nodes.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <random>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// Errors are local, and the share is that of a wave: rather above the truth than below.
constexpr double k_margin = 1.5;

std::vector<double> without(std::span<const double> nodes, std::size_t left_out) {
  std::vector<double> others(nodes.begin(), nodes.end());
  others.erase(others.begin() + left_out);
  return others;
}

MatrixXd misses_of_splines(std::span<const double> nodes) {
  const auto n = std::ssize(nodes);
  MatrixXd misses = MatrixXd::Zero(n - 2, n);
  for (Index j = 1; j + 1 < n; ++j) {
    const std::size_t at = j;
    const VectorXd others = numerics::CubicSplineBasis(without(nodes, at)).cardinal_weights(nodes[at]);
    misses.row(j - 1).head(j) = -others.head(j).transpose();
    misses.row(j - 1).tail(n - 1 - j) = -others.tail(n - 1 - j).transpose();
    misses(j - 1, j) = 1;
  }
  return misses;
}

MatrixXd misses_of_lines(std::span<const double> nodes) {
  const auto n = std::ssize(nodes);
  if (n == 3) return Eigen::RowVector3d(0.5, 0, -0.5);
  MatrixXd misses = MatrixXd::Zero(n - 2, n);
  for (Index j = 1; j + 1 < n; ++j) {
    const std::size_t at = j;
    const double right = (nodes[at] - nodes[at - 1]) / (nodes[at + 1] - nodes[at - 1]);
    misses.row(j - 1).segment(j - 1, 3) = Eigen::RowVector3d(right - 1, 1, -right);
  }
  return misses;
}

/// Root mean square over all rows of matrix · wave, where the wave is at the columns' places.
double size_of(const MatrixXd& matrix, const Eigen::VectorXcd& wave) {
  return std::sqrt((matrix.cast<std::complex<double>>() * wave).squaredNorm() / matrix.rows());
}

Eigen::VectorXcd wave_at(std::span<const double> places, double number) {
  Eigen::VectorXcd wave(std::ssize(places));
  for (Index i = 0; i < wave.size(); ++i) wave[i] = std::polar(1.0, number * places[i]);
  return wave;
}

}  // namespace

AxisMisses::AxisMisses(std::span<const double> nodes) {
  if (nodes.size() < 3) return;
  left_out_ = misses_of_splines(nodes);
  of_lines_ = misses_of_lines(nodes);
  // The spline through all nodes at the middles of 20 parts of each interval, weighted by their length.
  constexpr int k_parts = 20;
  const numerics::CubicSplineBasis basis(nodes);
  const auto n = std::ssize(nodes);
  std::vector<double> places;
  MatrixXd splines((n - 1) * k_parts, n);
  VectorXd root_weights(splines.rows());
  const double mean = (nodes.back() - nodes.front()) / (n - 1);
  for (Index i = 0; i + 1 < std::ssize(nodes); ++i)
    for (int part = 0; part < k_parts; ++part) {
      const auto row = std::ssize(places);
      places.push_back(nodes[i] + (nodes[i + 1] - nodes[i]) * (part + 0.5) / k_parts);
      splines.row(row) = basis.cardinal_weights(places.back()).transpose();
      root_weights[row] = std::sqrt((nodes[i + 1] - nodes[i]) / mean);
    }
  // Waves e^{ikx} from those that are long beside the axis to two nodes a wave.
  constexpr int k_waves = 200;
  std::vector<std::pair<double, double>> found;
  for (int i = 0; i < k_waves; ++i) {
    const double number = std::numbers::pi / mean * std::pow(0.005, 1 - i / (k_waves - 1.0));
    const Eigen::VectorXcd wave = wave_at(nodes, number);
    const Eigen::VectorXcd error =
        root_weights.asDiagonal() * (wave_at(places, number) - splines.cast<std::complex<double>>() * wave);
    const double missed = size_of(left_out_, wave);
    found.emplace_back(missed / size_of(of_lines_, wave), error.norm() / std::sqrt(error.size()) / missed);
  }
  std::sort(found.begin(), found.end());
  for (const auto& [ratio, share] : found) {
    ratio_.push_back(ratio);
    share_.push_back(share);
  }
}

double AxisMisses::between_nodes(double ratio) const {
  const auto above = std::lower_bound(ratio_.begin(), ratio_.end(), ratio) - ratio_.begin();
  if (above == 0) return share_.front();
  if (above == std::ssize(ratio_)) return share_.back();
  const std::size_t right = above;
  const double part = (ratio - ratio_[right - 1]) / (ratio_[right] - ratio_[right - 1]);
  return share_[right - 1] + part * (share_[right] - share_[right - 1]);
}

LeftOutNodes::LeftOutNodes(const ModelContents& model) : model_(model) {
  const Index r = model.parameter_modes, d = std::ssize(model.axes);
  std::size_t points = 1;
  for (const Axis& axis : model.axes) {
    axes_.emplace_back(axis.nodes);
    points *= axis.nodes.size();
  }
  MatrixXd w(points, r);  // each function contiguous over the grid
  for (std::size_t g = 0; g < points; ++g) w.row(g) = functions_at_node(model, g);
  shares_.setZero(r, d);
  strides_.assign(model.axes.size(), 1);
  for (std::size_t i = model.axes.size(); i-- > 0;) {
    const auto n = std::ssize(model.axes[i].nodes);
    if (i + 1 < model.axes.size()) strides_[i] = strides_[i + 1] * model.axes[i + 1].nodes.size();
    const Index after = strides_[i];
    if (n < 3) continue;
    const MatrixXd &spline = axes_[i].left_out(), &line = axes_[i].of_lines();
    for (Index k = 0; k < r; ++k) {
      double splines = 0, lines = 0;
      for (Index block = 0; block < w.rows(); block += n * after) {
        const Eigen::Map<const RowMatrix> part(w.col(k).data() + block, n, after);
        splines += (spline * part).squaredNorm() / spline.rows();
        lines += (line * part).squaredNorm() / line.rows();
      }
      if (lines > 0) shares_(k, i) = k_margin * axes_[i].between_nodes(std::sqrt(splines / lines));
    }
  }
}

bool LeftOutNodes::known() const {
  return std::any_of(axes_.begin(), axes_.end(),
                     [](const AxisMisses& axis) { return axis.left_out().rows() > 0; });
}

VectorXd LeftOutNodes::functions_error(std::size_t index, std::uint64_t seed) const {
  std::mt19937_64 random(seed);
  VectorXd error = VectorXd::Zero(shares_.rows());
  for (Index i = 0; i < std::ssize(axes_); ++i) {
    const MatrixXd& misses = axes_[i].left_out();
    if (misses.rows() == 0) continue;
    const Index row = random() % static_cast<std::uint64_t>(misses.rows());
    const std::size_t n = model_.axes[i].nodes.size();
    const std::size_t first = index - index / strides_[i] % n * strides_[i];  // the line's node 0
    VectorXd missed = VectorXd::Zero(error.size());
    for (std::size_t k = 0; k < n; ++k)
      missed += misses(row, k) * functions_at_node(model_, first + k * strides_[i]);
    error += shares_.col(i).cwiseProduct(missed);
  }
  return error;
}

OffGridSolution LeftOutNodes::solution(const GridSolutions& solutions, std::uint64_t seed) const {
  std::mt19937_64 random(seed);
  const std::size_t index = random() % solutions.snapshots.grid_size();
  MatrixXd field = solutions.field(index);
  field.noalias() += space_of(model_) * coefficients_of(model_, functions_error(index, random()));
  return {solutions.snapshots.parameters_at(index), {field.data(), field.data() + field.size()}};
}

}  // namespace knothe::model
