#include "knothe/model/reduced/separated_model.hpp"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <filesystem>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/outputs.hpp"

namespace knothe::model {

struct SeparatedModel::Implementation {
  ModelContents contents;
  std::string where;
  std::shared_ptr<const ParameterFunctions> functions;
  std::map<std::string, JointFunctions> outputs;  ///< name → its values at the n_t times as functions of p
};

namespace {

std::shared_ptr<const ParameterFunctions> make_functions(const ModelContents& contents) {
  const auto nodes = nodes_of(contents.axes);
  const Index r = contents.parameter_modes;
  if (contents.form == Form::canonical)
    return std::make_shared<CanonicalFunctions>(nodes, contents.parameters, r);
  return std::make_shared<JointFunctions>(nodes, contents.joint, r);
}

/// A named dof as an output, from the model at the nodes of the grid.
SnapshotOutput output_of(const ModelContents& contents, std::size_t dof, const RowMatrix& functions) {
  const Index row = dof, times = std::ssize(contents.time);
  RowMatrix values(functions.cols(), times);
  for (Index t = 0; t < times; ++t)
    values.col(t) = ((space_of(contents).row(row) * core_of(contents, t)) * functions).transpose().array() +
                    lift_of(contents)(row, t);
  const Quantity& quantity = contents.quantities[dof];
  return {quantity.name, {quantity.units, quantity.name}, {values.data(), values.data() + values.size()}};
}

void add_quantities(ModelContents& contents) {
  const RowMatrix functions = contents.quantities.empty() ? RowMatrix() : functions_on_grid(contents);
  for (Index dof = 0; dof < std::ssize(contents.quantities); ++dof) {
    const bool is_there = std::any_of(
        contents.outputs.begin(), contents.outputs.end(),
        [&](const SnapshotOutput& output) { return output.name == contents.quantities[dof].name; });
    if (!is_there) contents.outputs.push_back(output_of(contents, dof, functions));
  }
}

/// `p` as one row; outside the box by more than rounding: UsageError.
Eigen::MatrixXd point_in_box(std::span<const double> p, const ModelContents& contents) {
  if (p.size() != contents.axes.size()) {
    throw UsageError(
        fmt::format("{} parameter values given, the model has {}", p.size(), contents.axes.size()));
  }
  Eigen::MatrixXd point(1, std::ssize(p));
  for (Index i = 0; i < std::ssize(p); ++i) {
    const auto& nodes = contents.axes[i].nodes;
    const double slack = 1e-9 * (nodes.back() - nodes.front());
    if (!(p[i] >= nodes.front() - slack && p[i] <= nodes.back() + slack)) {
      throw UsageError(fmt::format("parameter {} = {} is outside the model's box [{}, {}]",
                                   contents.axes[i].name, p[i], nodes.front(), nodes.back()));
    }
    point(0, i) = p[i];
  }
  return point;
}

/// y = offset + map(w) for w and each of its derivatives.
template <class Map>
FieldDerivatives assemble(const FunctionBatch& w, std::size_t d, int derivatives,
                          const Eigen::VectorXd& offset, const Map& map) {
  FieldDerivatives result;
  result.count = offset.size();
  result.dimension = d;
  const Eigen::VectorXd value = offset + map(w.value);
  result.value.assign(value.begin(), value.end());
  if (derivatives >= 1) result.gradient.resize(result.count * d);
  if (derivatives >= 2) result.hessian.resize(result.count * d * d);
  for (std::size_t a = 0; derivatives >= 1 && a < d; ++a) {
    const Eigen::VectorXd slope = map(w.first[a]);
    for (std::size_t i = 0; i < result.count; ++i) result.gradient[i * d + a] = slope[i];
    for (std::size_t b = 0; derivatives >= 2 && b <= a; ++b) {
      const Eigen::VectorXd curvature = map(w.second[a * (a + 1) / 2 + b]);
      for (std::size_t i = 0; i < result.count; ++i) {
        const double entry = curvature[i];
        result.hessian[(i * d + a) * d + b] = result.hessian[(i * d + b) * d + a] = entry;
      }
    }
  }
  return result;
}

FunctionBatch evaluate_functions(const ParameterFunctions& functions, const Eigen::MatrixXd& point,
                                 int derivatives) {
  FunctionBatch w;
  w.resize(1, functions.dimension(), functions.count(), derivatives);
  functions.evaluate(point, derivatives, w);
  return w;
}

}  // namespace

RowMatrix functions_on_grid(const ModelContents& contents) {
  const Index r = contents.parameter_modes;
  Index grid = 1;
  for (const std::size_t n : contents.grid_shape()) grid *= n;
  if (contents.form == Form::tree) return Eigen::Map<const RowMatrix>(contents.joint.data(), r, grid);
  // A product of splines is the tensor-product spline through the products at the nodes.
  RowMatrix values = RowMatrix::Ones(r, 1);
  for (Index a = 0; a < std::ssize(contents.axes); ++a) {
    const auto n = std::ssize(contents.axes[a].nodes);
    const Eigen::Map<const RowMatrix> axis(contents.parameters[a].data(), r, n);
    RowMatrix next(r, values.cols() * n);
    for (Index k = 0; k < r; ++k) {
      for (Index g = 0; g < values.cols(); ++g) next.row(k).segment(g * n, n) = values(k, g) * axis.row(k);
    }
    values = std::move(next);
  }
  return values;
}

Eigen::Map<const Eigen::MatrixXd> space_of(const ModelContents& contents) {
  return Eigen::Map<const Eigen::MatrixXd>(contents.space.data(), contents.dof_count(), contents.space_modes);
}

Eigen::Map<const Eigen::MatrixXd> lift_of(const ModelContents& contents) {
  return Eigen::Map<const Eigen::MatrixXd>(contents.lift.data(), contents.dof_count(),
                                           std::ssize(contents.time));
}

Eigen::MatrixXd core_of(const ModelContents& contents, std::size_t step) {
  const Index l = contents.space_modes;
  const Index r = contents.parameter_modes;
  const Index t = step;
  if (contents.form == Form::tree) {
    return Eigen::Map<const RowMatrix>(contents.temporal.data() + t * l * r, l, r);
  }
  const auto times = std::ssize(contents.time);
  return Eigen::Map<const RowMatrix>(contents.temporal.data(), l, times).col(t).asDiagonal();
}

SeparatedModel::SeparatedModel(ModelContents contents, const std::string& where) {
  validate(contents, where);
  add_quantities(contents);
  auto implementation = std::make_shared<Implementation>();
  implementation->where = where;
  implementation->functions = make_functions(contents);
  for (const SnapshotOutput& output : contents.outputs) {
    implementation->outputs.emplace(output.name, functions_of(contents, output));
  }
  implementation->contents = std::move(contents);
  implementation_ = std::move(implementation);
}

SeparatedModel SeparatedModel::load(const std::string& path) {
  if (!std::filesystem::exists(path))
    throw DataError(fmt::format("{}: there is no such model: `knothe offline PROJECT.toml -o {}` makes it",
                                path, std::filesystem::path(path).filename().string()));
  return SeparatedModel(read_model(path), path);
}

void SeparatedModel::save(const std::string& path) const {
  write_model(implementation_->contents, path);
}

const ModelContents& SeparatedModel::contents() const {
  return implementation_->contents;
}
const std::string& SeparatedModel::where() const {
  return implementation_->where;
}
std::size_t SeparatedModel::dimension() const {
  return contents().axes.size();
}
std::size_t SeparatedModel::step_count() const {
  return contents().time.size();
}
std::size_t SeparatedModel::dof_count() const {
  return contents().dof_count();
}

std::vector<std::string> SeparatedModel::parameter_names() const {
  std::vector<std::string> names;
  for (const Axis& axis : contents().axes) names.push_back(axis.name);
  return names;
}

std::vector<std::string> SeparatedModel::output_names() const {
  std::vector<std::string> names;
  for (const auto& entry : implementation_->outputs) names.push_back(entry.first);
  return names;
}

std::optional<std::size_t> SeparatedModel::quantity(const std::string& name) const {
  const std::vector<Quantity>& quantities = contents().quantities;
  for (Index dof = 0; dof < std::ssize(quantities); ++dof)
    if (quantities[dof].name == name) return dof;
  return std::nullopt;
}

const std::shared_ptr<const ParameterFunctions>& SeparatedModel::functions() const {
  return implementation_->functions;
}

FieldDerivatives SeparatedModel::evaluate(std::span<const double> p, std::size_t step,
                                          std::span<const std::size_t> dofs, int derivatives) const {
  const ModelContents& model = contents();
  if (step >= step_count()) {
    throw UsageError(
        fmt::format("there is no time step {}: the model has steps 0 to {}", step, step_count() - 1));
  }
  for (const std::size_t dof : dofs) {
    if (dof < dof_count()) continue;
    throw UsageError(fmt::format("there is no dof {}: the model has dofs 0 to {}", dof, dof_count() - 1));
  }
  const FunctionBatch w = evaluate_functions(*functions(), point_in_box(p, model), derivatives);
  const Eigen::MatrixXd core = core_of(model, step);
  const auto space = space_of(model);
  const auto lift = lift_of(model).col(step);
  if (dofs.empty()) {
    return assemble(w, dimension(), derivatives, lift, [&](const RowMatrix& row) -> Eigen::VectorXd {
      const Eigen::VectorXd coefficients = core * row.transpose();
      return space * coefficients;
    });
  }
  const std::vector<Index> rows(dofs.begin(), dofs.end());
  return assemble(w, dimension(), derivatives, lift(rows), [&](const RowMatrix& row) -> Eigen::VectorXd {
    const Eigen::VectorXd coefficients = core * row.transpose();
    return space(rows, Eigen::all) * coefficients;
  });
}

FieldDerivatives SeparatedModel::evaluate_output(const std::string& name, std::span<const double> p,
                                                 int derivatives) const {
  const JointFunctions& functions = implementation_->outputs.at(output_of(*this, name).name);
  const FunctionBatch w = evaluate_functions(functions, point_in_box(p, contents()), derivatives);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(step_count());
  return assemble(w, dimension(), derivatives, zero,
                  [](const RowMatrix& row) -> Eigen::VectorXd { return row.transpose(); });
}

}  // namespace knothe::model
