#include "knothe/model/reduced/truncation_error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/compress/quantity_scales.hpp"
#include "knothe/model/grid/grid_solutions.hpp"
#include "knothe/model/grid/left_out_nodes.hpp"
#include "knothe/model/grid/solutions_file.hpp"
#include "knothe/model/observe/observation_operator.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"

namespace knothe::model {

using Eigen::MatrixXd;

namespace {

/// All known errors, one after the other; each n_dof × n_t, with its weight.
class WeightedErrors {
 public:
  /// `basis`: Q of GridSolutions, whose coordinates the snapshots are then; empty for fields. The model was
  /// made from these coordinates: its space is that of Q.
  WeightedErrors(const ModelContents& contents, const Snapshots& snapshots, const MatrixXd& basis,
                 std::span<const OffGridSolution> off_grid)
      : model_(contents), snapshots_(snapshots), basis_(basis), off_grid_(off_grid) {
    if (contents.grid_shape() != snapshots.grid_shape())
      throw UsageError("the model and the snapshots have different grids");
    if (basis.size() == 0) return;
    if (basis.rows() != lift_of(contents).rows()) refuse_sizes();
    lift_ = basis.transpose() * lift_of(contents);
    space_ = basis.transpose() * space_of(contents);
  }

  [[nodiscard]] std::size_t grid_count() const { return snapshots_.grid_size(); }
  [[nodiscard]] std::size_t count() const { return grid_count() + off_grid_.size(); }
  [[nodiscard]] double weight(std::size_t i) const {
    return 1.0 / (i < grid_count() ? grid_count() : off_grid_.size());
  }
  [[nodiscard]] std::vector<double> parameters(std::size_t i) const {
    return i < grid_count() ? snapshots_.parameters_at(i) : off_grid_[i - grid_count()].parameters;
  }
  /// Whether error `i` comes in coordinates, R × n_t.
  [[nodiscard]] bool in_basis(std::size_t i) const { return i < grid_count() && basis_.size() > 0; }
  [[nodiscard]] MatrixXd error(std::size_t i) const {
    const ModelContents& contents = model_.contents();
    if (in_basis(i)) {
      MatrixXd error = solution(i, lift_.rows()) - lift_;
      error.noalias() -= space_ * coefficients_of(contents, functions_at_node(contents, i));
      return error;
    }
    const Index dofs = lift_of(contents).rows();
    if (i < grid_count()) return solution(i, dofs) - field_of(contents, functions_at_node(contents, i));
    return solution(i, dofs) - field_at(model_, off_grid_[i - grid_count()].parameters);
  }
  /// Σ_i error i · factor(i), n_dof × width; in order, so that the number of threads does not matter.
  template <class Factor>
  [[nodiscard]] MatrixXd combined(Index width, std::size_t threads, const Factor& factor) const {
    MatrixXd fields = MatrixXd::Zero(lift_of(model_.contents()).rows(), width);
    MatrixXd coordinates = MatrixXd::Zero(basis_.cols(), width);
    constexpr std::size_t k_together = 16;  // bounds the memory
    for (std::size_t first = 0; first < count(); first += k_together) {
      std::vector<MatrixXd> parts(std::min(k_together, count() - first));
      parallel_for(parts.size(), threads,
                   [&](std::size_t i) { parts[i] = error(first + i) * factor(first + i); });
      for (Index i = 0; i < std::ssize(parts); ++i) (in_basis(first + i) ? coordinates : fields) += parts[i];
    }
    if (basis_.size() > 0) fields.noalias() += basis_ * coordinates;
    return fields;
  }
  /// The columns of V, n_dof × k, as error `i` sees them.
  [[nodiscard]] MatrixXd in_coordinates(const MatrixXd& v) const {
    return basis_.size() == 0 ? MatrixXd() : MatrixXd(basis_.transpose() * v);
  }

 private:
  [[noreturn]] static void refuse_sizes() {
    throw UsageError("the solutions and the model differ in number of dofs or time steps");
  }
  [[nodiscard]] Eigen::Map<const MatrixXd> solution(std::size_t i, Index rows) const {
    const std::span<const double> values =
        i < grid_count() ? snapshots_.solution(i) : std::span(off_grid_[i - grid_count()].values);
    const Index times = lift_of(model_.contents()).cols();
    if (std::ssize(values) != rows * times) refuse_sizes();
    return {values.data(), rows, times};
  }

  SeparatedModel model_;
  const Snapshots& snapshots_;
  const MatrixXd& basis_;
  MatrixXd lift_, space_;  ///< the model's, in coordinates
  std::span<const OffGridSolution> off_grid_;
};

}  // namespace

namespace {

/// τ from the coefficients of all known errors.
double persistence_of(std::span<const MatrixXd> coefficients, std::span<const double> weights) {
  double tau = 1;
  for (Index lag = 1; lag < coefficients.front().cols(); ++lag) {
    const Index n = coefficients.front().cols() - lag;
    double product = 0, early = 0, late = 0;
    for (Index i = 0; i < std::ssize(coefficients); ++i) {
      const auto a = coefficients[i].leftCols(n), b = coefficients[i].rightCols(n);
      product += weights[i] * a.cwiseProduct(b).sum();
      early += weights[i] * a.squaredNorm();
      late += weights[i] * b.squaredNorm();
    }
    const double scale = std::sqrt(early * late);
    if (!(scale > 0) || product < 0.05 * scale) break;
    tau += 2 * product / scale;
  }
  return tau;
}

TruncationError covariance_of(const WeightedErrors& errors, const ModelContents& contents, std::size_t modes,
                              std::size_t threads) {
  const Index dofs = contents.dof_count(), times = std::ssize(contents.time);
  // Randomised range finder, without ever keeping all errors: a sketch of twice the modes wanted.
  const Index most =
      std::min<Index>({static_cast<Index>(modes), dofs, times * static_cast<Index>(errors.count())});
  const Index width = std::min(2 * most, dofs);
  const MatrixXd sketch = errors.combined(width, threads, [&](std::size_t i) -> MatrixXd {
    return std::sqrt(errors.weight(i)) * normal_matrix(times, width, 1 + i);
  });
  TruncationError result;
  // Errors that are sums of fewer modes have a space of fewer.
  const MatrixXd space = dominant_space(sketch, 0.0, 1, threads).basis;
  const Index k = std::min(most, space.cols());
  const MatrixXd basis = space.leftCols(k);
  result.count = k;
  result.space.assign(basis.data(), basis.data() + basis.size());

  const MatrixXd in_coordinates = errors.in_coordinates(basis);
  std::vector<MatrixXd> coefficients(errors.count());  // k × n_t
  std::vector<Eigen::VectorXd> left(errors.count());   // n_t: squared norm outside the basis
  std::vector<double> weights(errors.count());
  parallel_for(errors.count(), threads, [&](std::size_t i) {
    const MatrixXd error = errors.error(i);
    coefficients[i].noalias() = (errors.in_basis(i) ? in_coordinates : basis).transpose() * error;
    weights[i] = errors.weight(i);
    left[i] =
        (error.colwise().squaredNorm() - coefficients[i].colwise().squaredNorm()).transpose().cwiseMax(0.0);
  });
  set_moments(coefficients, weights, result);
  for (std::size_t i = 0; i < errors.count(); ++i)
    for (Index t = 0; t < times; ++t) result.variance[t] += weights[i] * left[i][t] / dofs;
  for (std::size_t i = errors.grid_count(); i < errors.count(); ++i) {
    result.off_grid.insert(result.off_grid.end(), coefficients[i].data(),
                           coefficients[i].data() + coefficients[i].size());
    const std::vector<double> p = errors.parameters(i);
    result.off_grid_points.insert(result.off_grid_points.end(), p.begin(), p.end());
  }
  result.off_grid_reach.assign(result.off_grid_points.size(), 0.0);
  for (const Axis& axis : contents.axes) result.parameters.push_back(axis.name);
  return result;
}

/// Errors of those outputs that all the solutions have.
std::map<std::string, std::vector<double>> output_errors(const ModelContents& contents,
                                                         std::span<const OffGridSolution> solutions) {
  std::map<std::string, std::vector<double>> errors;
  if (contents.outputs.empty() || solutions.empty()) return errors;
  const SeparatedModel model(contents);
  for (const SnapshotOutput& output : contents.outputs) {
    std::vector<double> of_output;
    for (const OffGridSolution& solution : solutions)
      for (const SnapshotOutput& exact : solution.outputs) {
        if (exact.name != output.name) continue;
        const std::vector<double> predicted = model.evaluate_output(output.name, solution.parameters).value;
        for (Index t = 0; t < std::ssize(predicted); ++t) of_output.push_back(exact.values[t] - predicted[t]);
      }
    if (of_output.size() == solutions.size() * contents.time.size())
      errors[output.name] = std::move(of_output);
  }
  return errors;
}

}  // namespace

void set_moments(std::span<const MatrixXd> coefficients, std::span<const double> weights,
                 TruncationError& error) {
  const Index k = coefficients.front().rows(), times = coefficients.front().cols();
  error.covariance.clear();
  for (Index t = 0; t < times; ++t) {
    MatrixXd second = MatrixXd::Zero(k, k);
    for (Index i = 0; i < std::ssize(coefficients); ++i)
      second.noalias() += weights[i] * coefficients[i].col(t) * coefficients[i].col(t).transpose();
    error.covariance.insert(error.covariance.end(), second.data(), second.data() + second.size());
  }
  error.variance.assign(times, 0.0);
  error.persistence = persistence_of(coefficients, weights);
}

TruncationError truncation_error(const ModelContents& contents, const Snapshots& snapshots,
                                 std::span<const OffGridSolution> off_grid, std::size_t modes,
                                 std::size_t threads) {
  const MatrixXd none;
  TruncationError result;
  if (contents.quantities.empty()) {
    result = covariance_of({contents, snapshots, none, off_grid}, contents, modes, threads);
    result.off_grid_outputs = output_errors(contents, off_grid);
    return result;
  }
  // Of several units: none of them is small.
  const QuantityScales scales{SeparatedModel(contents)};
  const ModelContents model = scales.scaled(contents);
  const Snapshots scaled = scales.scaled(snapshots);
  const std::vector<OffGridSolution> solutions = scales.scaled(off_grid);
  result = covariance_of({model, scaled, none, solutions}, model, modes, threads);
  result.off_grid_outputs = output_errors(contents, off_grid);
  scales.restore(result.space);
  return result;
}

TruncationError truncation_error(const ModelContents& contents, const GridSolutions& solutions,
                                 std::span<const OffGridSolution> off_grid, std::size_t modes,
                                 std::size_t threads) {
  if (solutions.basis.size() == 0)
    return truncation_error(contents, solutions.snapshots, off_grid, modes, threads);
  TruncationError result =
      covariance_of({contents, solutions.snapshots, solutions.basis, off_grid}, contents, modes, threads);
  result.off_grid_outputs = output_errors(contents, off_grid);
  return result;
}

namespace {

/// V at the sensors, a row for each; zero for those of which no error is known.
MatrixXd observed_space(const TruncationError& error, const ModelContents& model, const std::string& where,
                        const Sensors& sensors, std::span<const ScalarObservation> scalars) {
  const Index q = error.count;
  const Eigen::Map<const MatrixXd> space(error.space.data(), model.dof_count(), q);
  const ObservationOperator operation(model.dofs, model.mesh, where, sensors);
  MatrixXd observed = MatrixXd::Zero(std::ssize(sensors), q);
  observed.topRows(operation.rows()) = operation.apply(space);
  for (Index k = 0; k < std::ssize(sensors.scalars); ++k) {
    auto row = observed.row(operation.rows() + k);
    const auto is_named = [&](const auto& other) { return other.name == sensors.scalars[k]; };
    if (const auto quantity = std::find_if(model.quantities.begin(), model.quantities.end(), is_named);
        quantity != model.quantities.end())
      row = space.row(quantity - model.quantities.begin());
    else if (const auto scalar = std::find_if(scalars.begin(), scalars.end(), is_named);
             scalar != scalars.end())
      row = Eigen::Map<const Eigen::RowVectorXd>(scalar->coefficients.data(),
                                                 std::ssize(scalar->coefficients)) *
            ObservationOperator(model.dofs, model.mesh, where, {scalar->points, scalar->components})
                .apply(space);
  }
  return observed;
}

/// An output of the model among the observations, whose errors are known.
struct SeenOutput {
  Index row;
  const std::vector<double>* errors;  ///< [m, n_t]
};

std::vector<SeenOutput> seen_outputs(const TruncationError& error, const Sensors& sensors,
                                     std::span<const ScalarObservation> scalars) {
  std::vector<SeenOutput> seen;
  for (Index k = 0; k < std::ssize(sensors.scalars); ++k) {
    std::string name = sensors.scalars[k];
    for (const ScalarObservation& scalar : scalars)
      if (scalar.name == name && !scalar.output.empty()) name = scalar.output;
    if (const auto found = error.off_grid_outputs.find(name); found != error.off_grid_outputs.end())
      seen.push_back({static_cast<Index>(sensors.displacement_count() + k), &found->second});
  }
  return seen;
}

/// A time of the data between two of the model's.
struct BetweenSteps {
  Index left, right;
  double share;  ///< of the right one

  BetweenSteps(const std::vector<double>& steps, double time) {
    const Index last = std::ssize(steps) - 1;
    right = std::clamp<Index>(std::lower_bound(steps.begin(), steps.end(), time) - steps.begin(), 0, last);
    left = std::max<Index>(0, right - 1);
    const double width = steps[right] - steps[left];
    share = width > 0 ? std::clamp((time - steps[left]) / width, 0.0, 1.0) : 1.0;
  }
  [[nodiscard]] double position() const { return left + share; }
};

/// A root of the positive semidefinite S: S = root rootᵀ.
MatrixXd root_of(const MatrixXd& s) {
  const numerics::SymmetricEigen eigen(s);
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
}

/// Per observation, of a unit variance of each dof: 1 of a displacement or quantity, Σ c² of a combination of
/// displacements, none of an output.
Eigen::VectorXd observed_unit_variance(const ModelContents& model, const Sensors& sensors,
                                       std::span<const ScalarObservation> scalars) {
  Eigen::VectorXd unit = Eigen::VectorXd::Zero(std::ssize(sensors.components) + std::ssize(sensors.scalars));
  unit.head(std::ssize(sensors.components)).setOnes();
  for (Index k = 0; k < std::ssize(sensors.scalars); ++k) {
    double& here = unit[std::ssize(sensors.components) + k];
    for (const Quantity& quantity : model.quantities) here += quantity.name == sensors.scalars[k];
    for (const ScalarObservation& scalar : scalars)
      if (scalar.name == sensors.scalars[k])
        for (const double c : scalar.coefficients) here += c * c;
  }
  return unit;
}

}  // namespace

ObservedTruncation observe_truncation(const TruncationError& error, const ModelContents& model,
                                      const std::string& where, const Sensors& sensors,
                                      std::span<const ScalarObservation> scalars,
                                      std::span<const double> times) {
  if (error.count == 0)
    throw DataError(
        fmt::format("{}: the model's file has no /truncation: make the model again with this version of "
                    "`knothe offline` or `knothe model import`, or leave method.truncation_error off",
                    where));
  const Index q = error.count, m = error.off_grid_count();
  const Index n_t = std::ssize(error.variance);
  const MatrixXd observed = observed_space(error, model, where, sensors, scalars);
  const Eigen::VectorXd unit = observed_unit_variance(model, sensors, scalars);
  const std::vector<SeenOutput> outputs =
      m > 0 ? seen_outputs(error, sensors, scalars) : std::vector<SeenOutput>();
  const auto moments = [&](Index t) {
    return Eigen::Map<const MatrixXd>(&error.covariance[t * q * q], q, q);
  };
  std::vector<BetweenSteps> places;
  for (const double time : times) places.emplace_back(model.time, time);
  const double distance = places.size() < 2
                              ? error.persistence
                              : (places.back().position() - places.front().position()) / (places.size() - 1);
  const double factor = std::max(1.0, error.persistence / distance);
  ObservedTruncation result;
  result.left_out.resize(observed.rows(), std::ssize(places));
  for (Index i = 0; i < std::ssize(places); ++i) {
    const Index left = places[i].left, right = places[i].right;
    const double share = places[i].share;
    const auto between = [&](double before, double after) { return (1 - share) * before + share * after; };
    MatrixXd of_step = MatrixXd::Zero(observed.rows(), q + std::ssize(outputs));
    of_step.leftCols(q) = observed * root_of((1 - share) * moments(left) + share * moments(right));
    for (Index k = 0; k < std::ssize(outputs); ++k) {
      double sum = 0;
      for (Index j = 0; j < m; ++j) {
        const std::vector<double>& e = *outputs[k].errors;
        sum += between(std::pow(e[j * n_t + left], 2), std::pow(e[j * n_t + right], 2));
      }
      of_step(outputs[k].row, q + k) = std::sqrt(sum / m);
    }
    result.factors.push_back(std::sqrt(factor) * of_step);
    result.left_out.col(i) = factor * between(error.variance[left], error.variance[right]) * unit;
  }
  return result;
}

ObservedErrors observe_off_grid(const TruncationError& error, const ModelContents& model,
                                const std::string& where, const Sensors& sensors,
                                std::span<const ScalarObservation> scalars, std::span<const double> times,
                                Index observations) {
  ObservedErrors known;
  if (error.off_grid_count() == 0) return known;
  const Index q = error.count, m = error.off_grid_count();
  const auto n_t = std::ssize(error.variance);
  const std::vector<SeenOutput> outputs = seen_outputs(error, sensors, scalars);
  const Index all = q + std::ssize(outputs);
  known.space.setZero(observations, all);
  known.space.topLeftCorner(std::ssize(sensors), q) = observed_space(error, model, where, sensors, scalars);
  // An output is a direction of its own.
  for (Index k = q; k < all; ++k) known.space(outputs[k - q].row, k) = 1;
  if (known.space.isZero(0)) return {};
  const Eigen::Map<const MatrixXd> fields(error.off_grid.data(), q, n_t * m);
  const auto at = [&](Index t) -> MatrixXd {
    MatrixXd coefficients(all, m);
    coefficients.topRows(q) = fields(Eigen::all, Eigen::seqN(t, m, n_t));
    for (Index k = q; k < all; ++k) {
      const std::vector<double>& errors = *outputs[k - q].errors;
      for (Index j = 0; j < m; ++j) coefficients(k, j) = errors[j * n_t + t];
    }
    return coefficients;
  };
  for (const double time : times) {
    const auto [left, right, share] = BetweenSteps(model.time, time);
    known.coefficients.push_back((1 - share) * at(left) + share * at(right));
  }
  if (error.off_grid_points.empty()) return known;
  // The model's parameters may stand in another order than the file's, and some be known.
  const auto d = std::ssize(model.axes), all_d = std::ssize(error.parameters);
  known.points.resize(m, d);
  known.reach.resize(m, d);
  known.alike.resize(error.alike.empty() ? 0 : d);
  known.alike_within = error.alike_within;
  for (Index a = 0; a < d; ++a) {
    const auto found = std::find(error.parameters.begin(), error.parameters.end(), model.axes[a].name);
    if (known.alike.size() > 0) known.alike[a] = error.alike[found - error.parameters.begin()];
    for (Index j = 0; j < m; ++j) {
      const std::size_t entry = j * all_d + (found - error.parameters.begin());
      known.points(j, a) = error.off_grid_points[entry];
      known.reach(j, a) = error.off_grid_reach[entry];
    }
  }
  return known;
}

ImportedModel import_model_and_error(const std::string& path, const CompressionOptions& options) {
  const GridSolutions solutions = read_solutions(path, {.threads = options.threads});
  ImportedModel result{compress(solutions, options), {}};
  result.model.project = "# imported from " + path + "\n";
  const LeftOutNodes left_out(result.model);
  std::vector<OffGridSolution> off_grid;
  if (left_out.known()) {
    constexpr std::size_t k_stored = 8, k_judged = 256;
    const auto solution = [&](std::size_t i) { return left_out.solution(solutions, 1 + i); };
    const ModelError error =
        off_grid_error_in_scales(solutions.snapshots, result.model, k_judged, solution, options.threads);
    // No better off the grid than on it, where all points are looked at.
    result.model.off_grid = {std::max({error.relative, error.plain_relative, result.model.relative_error}),
                             std::max(error.max, result.model.max_error_m), "left-out nodes"};
    for (std::size_t i = 0; i < k_stored; ++i) off_grid.push_back(solution(i));
  }
  result.truncation = truncation_error(result.model, solutions, off_grid, 20, options.threads);
  return result;
}

}  // namespace knothe::model
