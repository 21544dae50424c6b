#include "knothe/model/grid/local_refinement.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::model {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// Σ_a ((p − q)_a / ℓ_a)² for the rows p of `a` and q of `b`.
MatrixXd squared_distances(const MatrixXd& a, const MatrixXd& b, const VectorXd& lengths) {
  // From the first of them on: in |p|² + |q|² − 2 p·q far from zero the difference would be lost.
  const Eigen::RowVectorXd origin = b.row(0);
  const MatrixXd p = (a.rowwise() - origin) * lengths.cwiseInverse().asDiagonal(),
                 q = (b.rowwise() - origin) * lengths.cwiseInverse().asDiagonal();
  MatrixXd squares = -2 * p * q.transpose();
  squares.colwise() += p.rowwise().squaredNorm();
  squares.rowwise() += q.rowwise().squaredNorm().transpose();
  return squares.cwiseMax(0.0);
}

MatrixXd kernel_matrix(const MatrixXd& a, const MatrixXd& b, const InterpolationKernel& kernel) {
  const Eigen::ArrayXXd r = (5 * squared_distances(a, b, kernel.lengths).array()).sqrt();
  return (1 + r + r.square() / 3) * (-r).exp();
}

/// Of `gram` + nugget · I; a larger nugget where rounding makes that indefinite.
Eigen::LLT<MatrixXd> factorised(const MatrixXd& gram, double nugget) {
  Eigen::LLT<MatrixXd> factor;
  do {
    MatrixXd sum = gram;
    sum.diagonal().array() += nugget;
    factor.compute(sum);
    nugget *= 10;
  } while (factor.info() != Eigen::Success && nugget < 1);
  return factor;
}

}  // namespace

ScatteredInterpolation::ScatteredInterpolation(const MatrixXd& points, const MatrixXd& zeros,
                                               InterpolationKernel kernel)
    : points_(points), all_(points.rows() + zeros.rows(), points.cols()), kernel_(std::move(kernel)) {
  const Index k = points.rows(), n = all_.rows();
  all_ << points, zeros;
  inverse_ = factorised(kernel_matrix(all_, all_, kernel_), kernel_.nugget).solve(MatrixXd::Identity(n, n));
  leave_one_out_ = inverse_.diagonal().head(k).cwiseInverse().asDiagonal() * inverse_.topLeftCorner(k, k);
}

VectorXd ScatteredInterpolation::left_out_std() const {
  return inverse_.diagonal().head(points_.rows()).cwiseInverse().cwiseSqrt();
}

VectorXd ScatteredInterpolation::missed_std(const Eigen::Ref<const MatrixXd>& at) const {
  const MatrixXd k = kernel_matrix(at, all_, kernel_);
  return (1 - (k * inverse_).cwiseProduct(k).rowwise().sum().array()).max(kernel_.nugget).sqrt();
}

VectorXd ScatteredInterpolation::window(const Eigen::Ref<const MatrixXd>& at) const {
  const MatrixXd squares = squared_distances(at, points_, kernel_.reach);
  return 1 - (1 - (-0.5 * squares.array()).exp()).rowwise().prod();
}

MatrixXd ScatteredInterpolation::functions(const Eigen::Ref<const MatrixXd>& at) const {
  return window(at).asDiagonal() * kernel_matrix(at, all_, kernel_) * inverse_.leftCols(points_.rows());
}

namespace {

VectorXd as_vector(std::span<const double> values) {
  return Eigen::Map<const VectorXd>(values.data(), std::ssize(values));
}

/// Interval of the nodes that holds x, as the index of its left end.
std::size_t interval_of(std::span<const double> nodes, double x) {
  const auto after = std::upper_bound(nodes.begin() + 1, nodes.end() - 1, x);
  return after - nodes.begin() - 1;
}

/// The solutions as the base sees them.
struct KnownErrors {
  MatrixXd points;                ///< k × d
  VectorXd scales;                ///< n_dof, of the rows
  MatrixXd space;                 ///< n_dof × q, orthonormal in these scales
  std::vector<MatrixXd> fields;   ///< per solution: q × n_t, in `space`
  std::vector<MatrixXd> outputs;  ///< per output of the model: n_t × k
};

void require_same_shape(const ModelContents& base, const Snapshots& solution) {
  const auto require = [&](bool condition, const std::string& what) {
    if (!condition)
      throw DataError("a full-order solution does not fit the reduced model: " + what +
                      "; is it the same project's?");
  };
  require(solution.grid_size() == 1 && solution.axes.size() == base.axes.size(),
          fmt::format("it is of {} parameters, the model of {}", solution.axes.size(), base.axes.size()));
  for (Index a = 0; a < std::ssize(base.axes); ++a)
    require(
        solution.axes[a].name == base.axes[a].name,
        fmt::format("its parameter {} is {}, the model's {}", a, solution.axes[a].name, base.axes[a].name));
  require(solution.time.size() == base.time.size(),
          fmt::format("it has {} times, the model {}", solution.time.size(), base.time.size()));
  require(solution.dof_count() == base.dof_count(),
          fmt::format("it has {} dofs, the model {}", solution.dof_count(), base.dof_count()));
}

MatrixXd output_errors(const SeparatedModel& model, const std::string& name,
                       std::span<const Snapshots> solutions) {
  MatrixXd errors(model.step_count(), std::ssize(solutions));
  for (Index i = 0; i < std::ssize(solutions); ++i) {
    const auto& outputs = solutions[i].outputs;
    const auto found =
        std::find_if(outputs.begin(), outputs.end(), [&](const auto& o) { return o.name == name; });
    if (found == outputs.end())
      throw DataError(
          fmt::format("a full-order solution does not fit the reduced model: it has no output \"{}\"", name));
    errors.col(i) = as_vector(found->values) -
                    as_vector(model.evaluate_output(name, solutions[i].parameters_at(0)).value);
  }
  return errors;
}

/// Of each row, so that dofs of several units count alike; displacements count as they are.
VectorXd scales_of(const MatrixXd& errors, bool one_unit) {
  VectorXd scales = VectorXd::Ones(errors.rows());
  if (one_unit) return scales;
  for (Index i = 0; i < errors.rows(); ++i)
    if (const double norm = errors.row(i).norm(); norm > 0) scales[i] = norm;
  return scales;
}

/// `base` as it is stored: the model adds its quantities to the outputs, and they are in the field already.
KnownErrors errors_of(const SeparatedModel& model, const ModelContents& base,
                      std::span<const Snapshots> solutions) {
  const auto k = std::ssize(solutions), times = std::ssize(base.time);
  const Index dofs = base.dof_count();
  KnownErrors known;
  known.points.resize(k, std::ssize(base.axes));
  MatrixXd all(dofs, k * times);
  for (Index i = 0; i < k; ++i) {
    const Snapshots& solution = solutions[i];
    require_same_shape(base, solution);
    const std::vector<double> p = solution.parameters_at(0);
    known.points.row(i) = as_vector(p).transpose();
    all.middleCols(i * times, times) =
        Eigen::Map<const MatrixXd>(solution.values.data(), dofs, times) - field_at(model, p);
  }
  const VectorXd& scales = known.scales = scales_of(all, base.quantities.empty());
  all = scales.cwiseInverse().asDiagonal() * all;
  constexpr double k_left_out = 1e-10;  // of the errors' squared norm
  const double allowed = k_left_out * all.squaredNorm();
  const DominantSpace space = dominant_space(all, allowed, 1, 0);
  known.space = space.basis.leftCols(std::max<Index>(1, space.rank_for(allowed)));
  const MatrixXd coefficients = known.space.transpose() * all;
  for (Index i = 0; i < k; ++i) known.fields.push_back(coefficients.middleCols(i * times, times));
  known.space = scales.asDiagonal() * known.space;
  for (const SnapshotOutput& output : base.outputs)
    known.outputs.push_back(output_errors(model, output.name, solutions));
  return known;
}

VectorXd cell_widths(std::span<const Axis> axes, const VectorXd& at) {
  VectorXd width(at.size());
  for (Index a = 0; a < at.size(); ++a) {
    const std::vector<double>& nodes = axes[a].nodes;
    const std::size_t left = interval_of(nodes, at[a]);
    width[a] = nodes[left + 1] - nodes[left];
  }
  return width;
}

/// The corners of all cells of the grid that hold a point, where the base meets the full-order model: of many
/// those nearest to `centre`, in widths of the cell there.
MatrixXd corners_around(std::span<const Axis> axes, const MatrixXd& points, const VectorXd& centre) {
  constexpr Index k_max_corners = 512;
  std::set<std::vector<double>> corners;
  const std::size_t d = axes.size();
  for (Index i = 0; i < points.rows(); ++i)
    for (std::size_t corner = 0; corner < (std::size_t{1} << d); ++corner) {
      std::vector<double> at;
      for (std::size_t a = 0; a < d; ++a)
        at.push_back(axes[a].nodes[interval_of(axes[a].nodes, points(i, a)) + (corner >> a & 1)]);
      corners.insert(at);
    }
  MatrixXd result(std::ssize(corners), d);
  Index row = 0;
  for (const std::vector<double>& at : corners) result.row(row++) = as_vector(at).transpose();
  if (result.rows() <= k_max_corners) return result;
  const VectorXd far = squared_distances(result, centre.transpose(), cell_widths(axes, centre));
  std::vector<Index> order(result.rows());
  std::iota(order.begin(), order.end(), Index{0});
  std::stable_sort(order.begin(), order.end(), [&](Index i, Index j) { return far[i] < far[j]; });
  order.resize(k_max_corners);
  return result(order, Eigen::all);
}

/// 1 at the centre of the neighbourhood, a half three standard deviations away; of each point.
VectorXd nearness(const MatrixXd& points, const Neighbourhood& at) {
  const MatrixXd away = (points.rowwise() - at.mean.transpose()) * (3 * at.std()).cwiseInverse().asDiagonal();
  return (1 + away.rowwise().squaredNorm().array()).inverse();
}

/// By the lengths, in widths of the base's cell at the neighbourhood, with which the solutions predict each
/// other best; those near it count most.
ScatteredInterpolation best_interpolation(std::span<const Axis> axes, const KnownErrors& known,
                                          const Neighbourhood& at) {
  const Index k = known.points.rows(), d = known.points.cols();
  MatrixXd products(k, k);
  for (Index i = 0; i < k; ++i)
    for (Index j = 0; j <= i; ++j)
      products(i, j) = products(j, i) = known.fields[i].cwiseProduct(known.fields[j]).sum();
  const VectorXd weight = nearness(known.points, at), width = cell_widths(axes, at.mean);
  const MatrixXd zeros = corners_around(axes, known.points, at.mean);
  InterpolationKernel kernel = kernel_of_cell(axes, at);
  const auto missed = [&] {
    const MatrixXd l = ScatteredInterpolation(known.points, zeros, kernel).leave_one_out();
    return weight.dot((l * products).cwiseProduct(l).rowwise().sum());
  };
  double smallest = missed();
  const auto choose = [&](double& value, double unit, std::span<const double> candidates) {
    double best = value;
    for (const double candidate : candidates) {
      value = candidate * unit;
      if (const double now = missed(); now < smallest) smallest = now, best = value;
    }
    value = best;
  };
  constexpr std::array<double, 8> k_lengths = {0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.0};
  constexpr std::array<double, 5> k_nuggets = {1e-10, 1e-8, 1e-6, 1e-4, 1e-2};
  const int sweeps = k < 3 ? 0 : 2;  // of fewer there is nothing to choose by
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for (Index a = 0; a < d; ++a) choose(kernel.lengths[a], width[a], k_lengths);
    choose(kernel.nugget, 1, k_nuggets);
  }
  return {known.points, zeros, kernel};
}

/// Nodes, with cells between `lower` and `upper` divided into equal parts of at most `spacing`.
std::vector<double> divided(const std::vector<double>& nodes, double lower, double upper, double spacing) {
  std::vector<double> result = {nodes.front()};
  for (Index i = 1; i < std::ssize(nodes); ++i) {
    const double left = nodes[i - 1], width = nodes[i] - left;
    const double parts = left < upper && nodes[i] > lower ? std::ceil(width / spacing) : 1;
    for (double part = 1; part < parts; ++part) result.push_back(left + width * part / parts);
    result.push_back(nodes[i]);
  }
  return result;
}

/// More nodes where the posterior is, and on the way to the old ones; not next to one that is there.
std::vector<Axis> with_few_nodes_around(std::vector<Axis> axes, const Neighbourhood& at) {
  const std::vector<double> steps = axes.size() <= 5 ? std::vector<double>{-2, 0, 2} : std::vector<double>{0};
  for (Index k = 0; k < std::ssize(axes); ++k) {
    std::vector<double>& nodes = axes[k].nodes;
    const Index a = k;
    const double std = at.std()[a];
    for (const double step : steps) {
      const double x = at.mean[a] + step * std;
      const auto near = [&](double node) { return std::abs(node - x) < 0.3 * std; };
      if (x <= nodes.front() || x >= nodes.back() || std::any_of(nodes.begin(), nodes.end(), near)) continue;
      nodes.insert(std::upper_bound(nodes.begin(), nodes.end(), x), x);
    }
  }
  return axes;
}

/// Nodes so close that the splines through them are φ, wherever it is not zero: it varies over the kernel's
/// lengths, and over its reach where the window closes. With more than three parameters there would be too
/// many: a few around the posterior then.
std::vector<Axis> with_nodes_for(const std::vector<Axis>& axes, const MatrixXd& points,
                                 const InterpolationKernel& kernel, const Neighbourhood& at) {
  constexpr double k_spacing = 0.4, k_reach = 4;  // of a length or reach; of a reach
  constexpr std::size_t k_max_points = 32768;     // of the grid; a base may have more
  if (axes.size() > 3) return with_few_nodes_around(axes, at);
  const auto count = [](const std::vector<Axis>& grid) {
    std::size_t product = 1;
    for (const Axis& axis : grid) product *= axis.nodes.size();
    return product;
  };
  const std::size_t allowed = std::max(k_max_points, count(axes));
  const VectorXd spacing = k_spacing * kernel.lengths.cwiseMin(kernel.reach);
  for (double coarser = 1;; coarser *= 1.2) {
    std::vector<Axis> finer = axes;
    for (Index k = 0; k < std::ssize(axes); ++k) {
      const Index a = k;
      const double beyond = k_reach * kernel.reach[a];
      finer[k].nodes = divided(axes[k].nodes, points.col(a).minCoeff() - beyond,
                               points.col(a).maxCoeff() + beyond, coarser * spacing[a]);
    }
    if (count(finer) <= allowed) return finer;
  }
}

/// All points of the tensor grid, last axis fastest.
MatrixXd points_of(std::span<const Axis> axes) {
  Snapshots grid;
  grid.axes.assign(axes.begin(), axes.end());
  MatrixXd points(grid.grid_size(), std::ssize(axes));
  for (Index g = 0; g < points.rows(); ++g) points.row(g) = as_vector(grid.parameters_at(g)).transpose();
  return points;
}

void append(std::vector<double>& values, const MatrixXd& more) {
  values.insert(values.end(), more.data(), more.data() + more.size());
}

/// w of the base and φ at the nodes of the refined grid, C_t beside the errors' coefficients.
void refine_field(const SeparatedModel& model, const KnownErrors& known, const MatrixXd& points,
                  const MatrixXd& phi, ModelContents& result) {
  const ModelContents& base = model.contents();
  const Index r = model.functions()->count(), k = phi.cols(), q = known.space.cols();
  FunctionBatch w;
  w.resize(points.rows(), points.cols(), r, 0);
  model.functions()->evaluate(points, 0, w);
  result.form = Form::tree;
  result.parameters.clear();
  RowMatrix joint(r + k, points.rows());
  joint.topRows(r) = w.value.transpose();
  joint.bottomRows(k) = phi.transpose();
  result.joint.assign(joint.data(), joint.data() + joint.size());
  append(result.space, known.space);
  result.space_modes = base.space_modes + q;
  result.parameter_modes = r + k;
  result.temporal.clear();
  for (Index t = 0; t < std::ssize(base.time); ++t) {
    RowMatrix core = RowMatrix::Zero(base.space_modes + q, r + k);
    core.topLeftCorner(base.space_modes, r) = core_of(base, t);
    for (Index i = 0; i < k; ++i) core.col(r + i).tail(q) = known.fields[i].col(t);
    result.temporal.insert(result.temporal.end(), core.data(), core.data() + core.size());
  }
}

void refine_outputs(const SeparatedModel& model, const KnownErrors& known, const MatrixXd& points,
                    const MatrixXd& phi, ModelContents& result) {
  for (Index o = 0; o < std::ssize(result.outputs); ++o) {
    std::vector<double>& values = result.outputs[o].values;
    values.clear();
    for (Index g = 0; g < points.rows(); ++g) {
      const VectorXd p = points.row(g).transpose();
      const VectorXd value =
          as_vector(model.evaluate_output(result.outputs[o].name, std::span(p.data(), p.size())).value) +
          known.outputs[o] * phi.row(g).transpose();
      append(values, value);
    }
  }
}

constexpr int k_points = 256;

/// Points of the normal distribution of the neighbourhood, quasi-random.
MatrixXd points_in(const Neighbourhood& at) {
  MatrixXd z = numerics::sobol_points(k_points, at.mean.size(), 1);
  z = z.unaryExpr([](double u) { return numerics::normal_quantile(u); }).eval();
  const MatrixXd factor = at.covariance.llt().matrixL();
  return (z * factor.transpose()).rowwise() + at.mean.transpose();
}

/// What is known of the refined model's error: what the solutions miss of each other, by as much as all of
/// them together miss less, and at the base's own off-grid solutions what the correction leaves.
TruncationError error_of(const TruncationError& base, const ModelContents& contents, const KnownErrors& known,
                         const ScatteredInterpolation& interpolation, const Neighbourhood& at) {
  const std::span<const Axis> axes = contents.axes;
  const Index k = known.points.rows(), d = known.points.cols(), dofs = known.space.rows();
  const Index times = known.fields.front().cols();
  const Index old = base.off_grid_count(), b = base.count;
  std::vector<MatrixXd> errors;  // in [V, Q]
  // Of the outputs, by solution: n_t × outputs; of those of which the base knows none, not a number.
  const auto outputs = std::ssize(contents.outputs);
  std::vector<MatrixXd> output_errors;
  const auto output_correction = [&](const Eigen::RowVectorXd& weights) {
    MatrixXd sum(times, outputs);
    for (Index o = 0; o < outputs; ++o) sum.col(o) = known.outputs[o] * weights.transpose();
    return sum;
  };
  const auto correction = [&](const Eigen::RowVectorXd& weights) {
    MatrixXd sum = MatrixXd::Zero(known.space.cols(), times);
    for (Index i = 0; i < k; ++i) sum += weights[i] * known.fields[i];
    return sum;
  };
  TruncationError result;
  result.alike_within = base.alike_within;
  for (const Axis& axis : axes) {
    result.parameters.push_back(axis.name);
    const auto in_file = std::ranges::find(base.parameters, axis.name);  // the file may have another order
    if (!base.alike.empty()) result.alike.push_back(base.alike[in_file - base.parameters.begin()]);
  }
  const MatrixXd points = points_in(at);
  const auto root_mean_square = [](const VectorXd& v) { return v.norm() / std::sqrt(v.size()); };
  const double missed = root_mean_square(interpolation.missed_std(points));
  const double outside = root_mean_square(1 - interpolation.window(points).array());  // where nothing is said
  MatrixXd both(dofs, b + known.space.cols());
  both << Eigen::Map<const MatrixXd>(base.space.data(), dofs, b), known.space;
  for (Index i = 0; i < k; ++i) {
    MatrixXd error = MatrixXd::Zero(both.cols(), times);
    error.bottomRows(known.space.cols()) =
        (missed / interpolation.left_out_std()[i]) * correction(interpolation.leave_one_out().row(i)) +
        outside * known.fields[i];
    errors.push_back(std::move(error));
    output_errors.push_back((missed / interpolation.left_out_std()[i]) *
                                output_correction(interpolation.leave_one_out().row(i)) +
                            outside * output_correction(Eigen::RowVectorXd::Unit(k, i)));
    const VectorXd p = known.points.row(i).transpose();
    append(result.off_grid_points, p);
    append(result.off_grid_reach, at.std());
  }
  const bool placed = !base.off_grid_points.empty();  // not in files of before
  for (Index j = 0; j < old; ++j) {
    MatrixXd error = MatrixXd::Zero(both.cols(), times);
    error.topRows(b) = Eigen::Map<const MatrixXd>(base.off_grid.data() + j * times * b, b, times);
    VectorXd p(d);
    for (Index a = 0; a < d; ++a) {
      const Axis& axis = axes[a];  // the file may have them in another order
      const auto in_file = std::find(base.parameters.begin(), base.parameters.end(), axis.name);
      const auto column = in_file - base.parameters.begin();
      p[a] = placed ? base.off_grid_points[j * d + column] : axis.nodes.front();
    }
    MatrixXd of_outputs = MatrixXd::Constant(times, outputs, std::numeric_limits<double>::quiet_NaN());
    for (Index o = 0; o < outputs; ++o)
      if (const auto found = base.off_grid_outputs.find(contents.outputs[o].name);
          found != base.off_grid_outputs.end())
        of_outputs.col(o) = Eigen::Map<const VectorXd>(&found->second[j * times], times);
    if (placed) {
      const Eigen::RowVectorXd functions = interpolation.functions(p.transpose()).row(0);
      error.bottomRows(known.space.cols()) = -correction(functions);
      of_outputs -= output_correction(functions);
    }
    errors.push_back(std::move(error));
    output_errors.push_back(std::move(of_outputs));
    append(result.off_grid_points, p);
    append(result.off_grid_reach, VectorXd::Zero(d));
  }
  // A basis for all of them, orthonormal in the rows' scales, the first k of which make the covariance.
  both = known.scales.cwiseInverse().asDiagonal() * both;
  const MatrixXd basis = orthonormal_basis(both);
  const MatrixXd change = basis.transpose() * both;
  result.count = basis.cols();
  append(result.space, known.scales.asDiagonal() * basis);
  for (MatrixXd& error : errors) {
    error = change * error;
    append(result.off_grid, error);
  }
  for (Index o = 0; o < outputs; ++o) {
    std::vector<double> values;
    for (const MatrixXd& error : output_errors) append(values, error.col(o));
    if (std::none_of(values.begin(), values.end(), [](double e) { return std::isnan(e); }))
      result.off_grid_outputs[contents.outputs[o].name] = std::move(values);
  }
  errors.resize(k);
  VectorXd weights = nearness(known.points, at);
  weights /= weights.sum();
  set_moments(errors, {weights.data(), errors.size()}, result);
  return result;
}

}  // namespace

InterpolationKernel kernel_of_cell(std::span<const Axis> axes, const Neighbourhood& at) {
  const VectorXd width = cell_widths(axes, at.mean);
  return {0.7 * width, (2 * at.std()).cwiseMax(0.15 * width)};
}

MatrixXd most_informative(std::span<const Axis> axes, const MatrixXd& known, const MatrixXd& candidates,
                          const InterpolationKernel& kernel, Index count) {
  constexpr double k_nugget = 1e-8, k_nothing = 1e-6;  // of the variance without any solution
  MatrixXd places(known.rows() + candidates.rows(), candidates.cols());
  places << known, candidates;
  const bool few = axes.size() <= 3;
  const MatrixXd zeros = corners_around(axes, few || known.rows() == 0 ? places : known,
                                        candidates.colwise().mean().transpose());
  MatrixXd all(known.rows() + zeros.rows(), candidates.cols());
  all << known, zeros;
  const MatrixXd cross = kernel_matrix(all, candidates, kernel);
  // Covariance of what is not known; a solution at j subtracts R e_j (R e_j)ᵀ / (R_jj + nugget).
  MatrixXd rest = kernel_matrix(candidates, candidates, kernel) -
                  cross.transpose() * factorised(kernel_matrix(all, all, kernel), k_nugget).solve(cross);
  std::vector<Index> chosen;
  while (std::ssize(chosen) < count) {
    const Eigen::ArrayXd variance = rest.diagonal().array().max(0.0) + k_nugget;
    Index best = 0;
    (rest.colwise().squaredNorm().transpose().array() / variance).maxCoeff(&best);
    if (!(rest(best, best) > k_nothing)) break;
    chosen.push_back(best);
    const VectorXd column = rest.col(best);
    rest -= column * column.transpose() / variance[best];
  }
  return candidates(chosen, Eigen::all);
}

RefinedModel refined(const ModelContents& base, const TruncationError& error,
                     std::span<const Snapshots> solutions, const Neighbourhood& at) {
  if (solutions.empty()) throw UsageError("a model is refined by full-order solutions: none is given");
  const SeparatedModel model(base);
  const KnownErrors known = errors_of(model, base, solutions);
  const ScatteredInterpolation interpolation = best_interpolation(base.axes, known, at);
  RefinedModel result{base, error_of(error, base, known, interpolation, at), interpolation.kernel()};
  result.model.axes = with_nodes_for(base.axes, known.points, interpolation.kernel(), at);
  const MatrixXd points = points_of(result.model.axes);
  const MatrixXd phi = interpolation.functions(points);
  refine_field(model, known, points, phi, result.model);
  refine_outputs(model, known, points, phi, result.model);
  return result;
}

}  // namespace knothe::model
