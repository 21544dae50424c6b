#include "knothe/model/reduced/known_parameter.hpp"

#include <cassert>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/reduced/outputs.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {
namespace {

/// Σ_j c_j x[…, j, …]: `values` is [before, n, after] in C order.
std::vector<double> contracted(std::span<const double> values, const Eigen::VectorXd& c, std::size_t after) {
  const std::size_t n = c.size();
  std::vector<double> result(values.size() / n, 0.0);
  for (std::size_t b = 0; b < values.size() / (n * after); ++b) {
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t a = 0; a < after; ++a) result[b * after + a] += c[j] * values[(b * n + j) * after + a];
    }
  }
  return result;
}

/// All points of the tensor grid, the last axis fastest: grid × d.
Eigen::MatrixXd grid_points(std::span<const Axis> axes) {
  Index count = 1;
  for (const Axis& axis : axes) count *= std::ssize(axis.nodes);
  Eigen::MatrixXd points(count, std::ssize(axes));
  for (Index g = 0; g < count; ++g) {
    Index rest = g;
    for (std::size_t a = axes.size(); a-- > 0;) {
      const auto n = std::ssize(axes[a].nodes);
      points(g, a) = axes[a].nodes[rest % n];
      rest /= n;
    }
  }
  return points;
}

}  // namespace

ModelContents with_last_fixed(const ModelContents& contents, double value) {
  assert(contents.axes.size() >= 2);
  const std::vector<double>& nodes = contents.axes.back().nodes;
  assert(value >= nodes.front() && value <= nodes.back());
  const Eigen::VectorXd c = numerics::CubicSplineBasis(nodes).cardinal_weights(value);
  ModelContents fixed = contents;
  fixed.axes.pop_back();
  if (contents.form == Form::tree) {
    fixed.joint = contracted(contents.joint, c, 1);
  } else {
    const std::vector<double> size = contracted(contents.parameters.back(), c, 1);
    fixed.parameters.pop_back();
    const std::size_t times = contents.time.size();
    for (Index i = 0; i < std::ssize(fixed.temporal); ++i) fixed.temporal[i] *= size[i / times];
  }
  for (SnapshotOutput& output : fixed.outputs)
    output.values = contracted(output.values, c, contents.time.size());
  return fixed;
}

ObservedModel with_last_given(const ObservedModel& observed, std::span<const Axis> axes,
                              std::span<const double> values, int derivative) {
  assert(axes.size() >= 2 && values.size() == observed.time.size());
  const Eigen::MatrixXd points = grid_points(axes);
  const Index r = observed.functions->count();
  const auto n = std::ssize(axes.back().nodes);
  const Index others = points.rows() / n;
  FunctionBatch w;
  w.resize(points.rows(), points.cols(), r, 0);
  observed.functions->evaluate(points, 0, w);
  Eigen::MatrixXd table(r * n, others);  // row k n + j: β_kj on the grid of the other parameters
  for (Index g = 0; g < others; ++g) {
    for (Index j = 0; j < n; ++j) {
      for (Index k = 0; k < r; ++k) table(k * n + j, g) = w.value(g * n + j, k);
    }
  }
  const double enough = 1e-16 * table.squaredNorm();
  const DominantSpace space = dominant_space(table, enough, 1, 1);
  const Eigen::MatrixXd basis = space.basis.leftCols(std::max<Index>(1, space.rank_for(enough)));
  const RowMatrix functions = basis.transpose() * table;
  const std::vector<std::vector<double>> nodes = nodes_of(axes.first(axes.size() - 1));
  ObservedModel result = observed;
  result.functions = std::make_shared<JointFunctions>(nodes, std::span(functions.data(), functions.size()),
                                                      functions.rows());
  result.parameters.pop_back();
  if (derivative > 0) result.lift.setZero();
  const numerics::CubicSplineBasis spline(axes.back().nodes);
  for (Index i = 0; i < std::ssize(values); ++i) {
    const Eigen::VectorXd c = spline.cardinal_weights(values[i], derivative);
    Eigen::MatrixXd of_functions(r, basis.cols());  // N(T): w = N Φ
    for (Index k = 0; k < r; ++k) of_functions.row(k) = c.transpose() * basis.middleRows(k * n, n);
    result.core[i] = observed.core[i] * of_functions;
  }
  return result;
}

}  // namespace knothe::model
