#include "knothe/reduction/model/known_parameter.hpp"

#include <cassert>

#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/reduction/compress/low_rank.hpp"
#include "knothe/reduction/model/spline_functions.hpp"

namespace knothe::reduction {
namespace {

/// Σ_j c_j x[…, j, …]: `values` is [before, n, after] in C order.
std::vector<double> contracted(std::span<const double> values, const Eigen::VectorXd& c, std::size_t after) {
  const auto n = static_cast<std::size_t>(c.size());
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
  Eigen::Index count = 1;
  for (const Axis& axis : axes) count *= static_cast<Eigen::Index>(axis.nodes.size());
  Eigen::MatrixXd points(count, static_cast<Eigen::Index>(axes.size()));
  for (Eigen::Index g = 0; g < count; ++g) {
    Eigen::Index rest = g;
    for (std::size_t a = axes.size(); a-- > 0;) {
      const auto n = static_cast<Eigen::Index>(axes[a].nodes.size());
      points(g, static_cast<Eigen::Index>(a)) = axes[a].nodes[rest % n];
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
    for (std::size_t i = 0; i < fixed.temporal.size(); ++i) fixed.temporal[i] *= size[i / times];
  }
  for (SnapshotOutput& output : fixed.outputs)
    output.values = contracted(output.values, c, contents.time.size());
  return fixed;
}

ObservedModel with_last_given(const ObservedModel& observed, std::span<const Axis> axes,
                              std::span<const double> values, int derivative) {
  assert(axes.size() >= 2 && values.size() == observed.time.size());
  const Eigen::MatrixXd points = grid_points(axes);
  const Eigen::Index r = observed.functions->count();
  const auto n = static_cast<Eigen::Index>(axes.back().nodes.size());
  const Eigen::Index others = points.rows() / n;
  FunctionBatch w;
  w.resize(points.rows(), points.cols(), r, 0);
  observed.functions->evaluate(points, 0, w);
  Eigen::MatrixXd table(r * n, others);  // row k n + j: β_kj on the grid of the other parameters
  for (Eigen::Index g = 0; g < others; ++g) {
    for (Eigen::Index j = 0; j < n; ++j) {
      for (Eigen::Index k = 0; k < r; ++k) table(k * n + j, g) = w.value(g * n + j, k);
    }
  }
  const double enough = 1e-16 * table.squaredNorm();
  const DominantSpace space = dominant_space(table, enough, 1, 1);
  const Eigen::MatrixXd basis = space.basis.leftCols(std::max<Eigen::Index>(1, space.rank_for(enough)));
  const RowMatrix functions = basis.transpose() * table;
  std::vector<std::vector<double>> nodes;
  for (const Axis& axis : axes.first(axes.size() - 1)) nodes.push_back(axis.nodes);
  ObservedModel result = observed;
  result.functions = std::make_shared<JointFunctions>(
      nodes, std::span(functions.data(), static_cast<std::size_t>(functions.size())), functions.rows());
  result.parameters.pop_back();
  if (derivative > 0) result.lift.setZero();
  const numerics::CubicSplineBasis spline(axes.back().nodes);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Eigen::VectorXd c = spline.cardinal_weights(values[i], derivative);
    Eigen::MatrixXd of_functions(r, basis.cols());  // N(T): w = N Φ
    for (Eigen::Index k = 0; k < r; ++k) of_functions.row(k) = c.transpose() * basis.middleRows(k * n, n);
    result.core[i] = observed.core[i] * of_functions;
  }
  return result;
}

}  // namespace knothe::reduction
