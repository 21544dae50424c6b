/// @file Reduced models, models made of snapshots, and one-shot inference of any model.
#include <pybind11/stl.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "knothe/assimilation/inference/comparison.hpp"
#include "knothe/assimilation/inference/model_evaluator.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/library/engine_of_values.hpp"
#include "knothe/library/plain.hpp"
#include "knothe/model/reduced/form_names.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/model/simulator/result_file.hpp"
#include "knothe/posterior/quadrature/marginal_density.hpp"
#include "knothe/record/inference_results.hpp"
#include "knothe/record/inference_run.hpp"
#include "knothe/record/model_record.hpp"
#include "knothe/record/physical_parameters.hpp"
#include "python/bindings.hpp"
#include "python/interruption.hpp"
#include "python/values.hpp"

namespace knothe::python {

using library::plain;
using py::arg;

Noise noise_of(const Doubles& std, const std::optional<SparseRows>& precision) {
  Noise noise;
  noise.std = vector_of(std);
  if (!precision) return noise;
  const auto& [values, columns, row_begin] = *precision;
  noise.precision = {vector_of(values), vector_of(columns), vector_of(row_begin)};
  return noise;
}

std::vector<Prior> priors_of(const std::vector<PriorValues>& priors) {
  std::vector<Prior> result;
  for (const auto& [name, family, first, second, results, name_there] : priors) {
    if (family == "normal")
      result.push_back(Prior::normal(name, first, second));
    else if (family == "uniform")
      result.push_back(Prior::uniform(name, first, second));
    else if (family == "lognormal")
      result.push_back(Prior::lognormal(name, first, second));
    else if (family == "posterior")
      result.push_back(Prior::posterior(name, results, name_there));
    else
      throw UsageError("prior of " + name + ": \"" + family +
                       "\" is not normal, uniform, lognormal or posterior");
  }
  return result;
}

py::dict labels_of(std::span<const model::Axis> axes) {
  using namespace py::literals;
  py::dict labels;
  for (const model::Axis& axis : axes) {
    const files::Labels file = record::labels_of(axis);
    py::dict of_axis("units"_a = file.units, "long_name"_a = file.long_name, "reference"_a = axis.reference);
    if (const std::string units = record::reference_units(axis); !units.empty())
      of_axis["reference_units"] = units;
    labels[axis.name.c_str()] = of_axis;
  }
  return labels;
}

py::list densities_of(const std::vector<posterior::Prior>& priors) {
  py::list densities;
  for (const posterior::Prior& prior : priors) {
    auto density = posterior::marginal_density(prior);
    densities.append(py::make_tuple(prior.lower(), prior.upper(), array_of(std::move(density.points)),
                                    array_of(std::move(density.density))));
  }
  return densities;
}

py::tuple arrays_of(Prediction p) {
  const py::ssize_t n = p.points, m = p.count;
  const bool derivatives = !p.jacobian.empty();
  py::object jacobian = py::none();
  if (derivatives) jacobian = array_of(std::move(p.jacobian), {n, m, static_cast<py::ssize_t>(p.dimension)});
  return py::make_tuple(array_of(std::move(p.values), {n, m}), std::move(jacobian));
}

std::size_t count_points(std::span<const double> points, std::size_t dimension) {
  if (dimension > 0 && points.size() % dimension == 0) return points.size() / dimension;
  throw UsageError(counted(points.size(), "number") + " are not points of " +
                   counted(dimension, "parameter"));
}

namespace {

constexpr const char* k_nothing_kept = "nothing is kept";

void require_step(std::size_t step, std::size_t count) {
  if (step >= count)
    throw UsageError("step " + std::to_string(step) + ": the model has " + counted(count, "step") +
                     ", counted from 0");
}

void require_inside(const model::ObservedModel& model, const Eigen::MatrixXd& points) {
  const Eigen::VectorXd lower = model.functions->lower(), upper = model.functions->upper();
  for (Eigen::Index i = 0; i < points.rows(); ++i)
    for (Eigen::Index k = 0; k < points.cols(); ++k)
      if (!(points(i, k) >= lower[k] && points(i, k) <= upper[k]))
        throw UsageError("point " + std::to_string(i) + ": " + model.parameters[k] + " = " +
                         std::to_string(points(i, k)) + " is outside the model's box, " +
                         std::to_string(lower[k]) + " to " + std::to_string(upper[k]));
}

}  // namespace

Prediction predict(const model::ObservedModel& model, std::span<const double> points, std::size_t step,
                   bool jacobian) {
  const std::size_t d = model.parameters.size(), n = count_points(points, d);
  require_step(step, model.time.size());
  const Eigen::MatrixXd p = library::rows_of(points, d, "points");
  require_inside(model, p);
  Prediction out{n, static_cast<std::size_t>(model.observations()), d, {}, {}};
  // Point by point, as everything else that predicts: the same bits.
  for (Eigen::Index i = 0; i < p.rows(); ++i) {
    check_cancellation(k_nothing_kept);
    const Eigen::VectorXd y = model.predict(p.row(i).transpose(), step);
    out.values.insert(out.values.end(), y.begin(), y.end());
  }
  if (!jacobian) return out;
  model::FunctionBatch w;
  w.resize(p.rows(), p.cols(), model.functions->count(), 1);
  model.functions->evaluate(p, 1, w);
  out.jacobian.resize(n * out.count * d);
  for (std::size_t k = 0; k < d; ++k) {
    const Eigen::MatrixXd slope = model.space * (model.core[step] * w.first[k].transpose());
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < out.count; ++j)
        out.jacobian[(i * out.count + j) * d + k] = slope(j, static_cast<Eigen::Index>(i));
  }
  return out;
}

namespace {

using Model = model::SeparatedModel;

Prediction evaluate(const Model& model, std::span<const double> points, std::size_t step,
                    const std::vector<std::size_t>& dofs, bool jacobian) {
  require_step(step, model.step_count());
  for (const std::size_t dof : dofs)
    if (dof >= model.dof_count())
      throw UsageError("there is no dof " + std::to_string(dof) + ": the model has " +
                       counted(model.dof_count(), "dof") + ", counted from 0");
  const std::size_t d = model.dimension(), n = count_points(points, d);
  Prediction out{n, dofs.empty() ? model.dof_count() : dofs.size(), d, {}, {}};
  for (std::size_t i = 0; i < n; ++i) {
    check_cancellation(k_nothing_kept);
    const auto at = model.evaluate(points.subspan(i * d, d), step, dofs, jacobian ? 1 : 0);
    out.values.insert(out.values.end(), at.value.begin(), at.value.end());
    out.jacobian.insert(out.jacobian.end(), at.gradient.begin(), at.gradient.end());
  }
  return out;
}

Prediction evaluate_output(const Model& model, const std::string& name, std::span<const double> points,
                           bool jacobian) {
  const std::size_t d = model.dimension(), n = count_points(points, d);
  Prediction out{n, model.step_count(), d, {}, {}};
  for (std::size_t i = 0; i < n; ++i) {
    check_cancellation(k_nothing_kept);
    const auto at = model.evaluate_output(name, points.subspan(i * d, d), jacobian ? 1 : 0);
    out.values.insert(out.values.end(), at.value.begin(), at.value.end());
    out.jacobian.insert(out.jacobian.end(), at.gradient.begin(), at.gradient.end());
  }
  return out;
}

void bind_reduced_models(py::module_& module) {
  using model::ObservedModel;
  py::class_<ObservedModel>(module, "ObservedModel")
      .def(
          "predict",
          [](const ObservedModel& model, const Doubles& points, std::size_t step, bool jacobian) {
            const auto span = span_of(points);
            return arrays_of(long_call([&] { return predict(model, span, step, jacobian); }));
          },
          arg("points"), arg("step"), arg("jacobian"))
      .def("steps", [](const ObservedModel& model) { return model.time.size(); });
  py::class_<Model>(module, "Model")
      .def_static(
          "load", [](const std::string& path) { return long_call([&] { return Model::load(path); }); },
          arg("path"))
      .def(
          "evaluate",
          [](const Model& model, const Doubles& points, std::size_t step,
             const std::vector<std::size_t>& dofs, bool jacobian) {
            const auto span = span_of(points);
            return arrays_of(long_call([&] { return evaluate(model, span, step, dofs, jacobian); }));
          },
          arg("points"), arg("step"), arg("dofs"), arg("jacobian"))
      .def(
          "evaluate_output",
          [](const Model& model, const std::string& name, const Doubles& points, bool jacobian) {
            const auto span = span_of(points);
            return arrays_of(long_call([&] { return evaluate_output(model, name, span, jacobian); }));
          },
          arg("name"), arg("points"), arg("jacobian"))
      .def(
          "observe",
          [](const Model& model, const Doubles& points, const std::vector<int>& components,
             const std::vector<std::string>& series) {
            const Sensors sensors{vector_of(points), components, series};
            return long_call([&] { return library::observed(model, sensors); });
          },
          arg("points"), arg("components"), arg("series"))
      .def("parameters", &Model::parameter_names)
      .def("times", [](const Model& model) { return array_of(model.contents().time); })
      .def("dofs",
           [](const Model& model) {
             const model::Dofs& dofs = model.contents().dofs;
             return py::make_tuple(rows_of(dofs.points, 3), array_of(dofs.components));
           })
      .def("mesh",
           [](const Model& model) -> py::object {
             const auto& mesh = model.contents().mesh;
             if (!mesh) return py::none();
             const py::ssize_t nodes = mesh->nodes_per_cell, cells = mesh->cell_count();
             return py::make_tuple(rows_of(mesh->points, 3), array_of(mesh->cells, {cells, nodes}),
                                   mesh->type);
           })
      .def("info_json", [](const Model& model) { return files::json_line(record::model_record(model)); });
}

model::Snapshots snapshots_of(const py::dict& parts) {
  model::Snapshots s;
  using Axis = std::tuple<std::string, std::vector<double>, std::string, std::string, double>;
  for (const auto& [name, nodes, units, long_name, reference] : parts["axes"].cast<std::vector<Axis>>())
    s.axes.push_back({name, nodes, units, long_name, reference});
  s.time = parts["time"].cast<std::vector<double>>();
  s.time_units = parts["time_units"].cast<std::string>();
  s.values = vector_of(parts["values"].cast<Doubles>());
  s.field = {parts["units"].cast<std::string>(), parts["long_name"].cast<std::string>()};
  s.dofs.points = vector_of(parts["points"].cast<Doubles>());
  s.dofs.components = parts["components"].cast<std::vector<std::int64_t>>();
  for (const auto& [name, units] :
       parts["quantities"].cast<std::vector<std::pair<std::string, std::string>>>())
    s.quantities.push_back({name, units});
  for (const auto& [name, units, values] :
       parts["outputs"].cast<std::vector<std::tuple<std::string, std::string, Doubles>>>())
    s.outputs.push_back({name, {units, name}, vector_of(values)});
  model::settle_units(s, "offline");
  return s;
}

std::string import_model(const std::string& snapshots, const std::string& output, const std::string& form,
                         std::size_t modes, double tolerance) {
  model::CompressionOptions options;
  const auto known = from_text<model::Form>(form);
  if (!known) throw UsageError("form \"" + form + "\": give \"tree\" or \"canonical\"");
  options.form = *known;
  options.modes = modes;
  if (tolerance > 0) options.tolerance = tolerance;
  const auto [model, truncation] = model::import_model_and_error(snapshots, options);
  model::write_model(model, truncation, output);
  return files::json_line(record::import_record(output, model));
}

void bind_import(py::module_& module) {
  module.def(
      "write_snapshots",
      [](const py::dict& parts, const std::string& path) {
        const model::Snapshots snapshots = snapshots_of(parts);
        long_call([&] {
          model::validate(snapshots, "snapshots");
          model::write_snapshots(snapshots, path);
        });
      },
      arg("parts"), arg("path"));
  module.def(
      "import_model",
      [](const std::string& snapshots, const std::string& output, const std::string& form, std::size_t modes,
         double tolerance) {
        return long_call([&] { return import_model(snapshots, output, form, modes, tolerance); });
      },
      arg("snapshots"), arg("output"), arg("form"), arg("modes"), arg("tolerance"));
}

/// A function of Python as a forward model: points n × d in, values n × m out, and perhaps Jacobians
/// n × m × d.
class CallableModel final : public model::ForwardModel {
 public:
  /// `outputs`: 0 for the logarithm of a density, which may be −∞.
  CallableModel(py::function function, std::optional<py::function> jacobian, Eigen::Index dimension,
                Eigen::Index outputs)
      : function_(std::move(function)),
        jacobian_(std::move(jacobian)),
        dimension_(dimension),
        outputs_(std::max<Eigen::Index>(1, outputs)),
        is_density_(outputs == 0) {}

  [[nodiscard]] Eigen::Index dimension() const override { return dimension_; }
  [[nodiscard]] Eigen::Index output_count() const override { return outputs_; }
  [[nodiscard]] std::string where() const override { return "the model"; }
  [[nodiscard]] bool has_gradient() const override { return jacobian_.has_value() && outputs_ == 1; }
  [[nodiscard]] bool has_jacobian() const override { return jacobian_.has_value(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::Ref<Eigen::MatrixXd> values) override {
    call(function_, "value", points, outputs_, values);
    calls_.evaluations += points.cols();
    constexpr double k_infinity = std::numeric_limits<double>::infinity();
    for (double& value : values.reshaped())
      if (is_density_ && value == -k_infinity) value = std::numeric_limits<double>::lowest();
  }
  void gradient(const Eigen::Ref<const Eigen::MatrixXd>& points,
                const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                Eigen::Ref<Eigen::MatrixXd> gradients) override {
    call(*jacobian_, "derivative", points, dimension_, gradients);
    gradients.array().rowwise() *= sensitivities.row(0).array();
    calls_.gradients += points.cols();
  }
  void jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::Ref<Eigen::MatrixXd> jacobians) override {
    Eigen::MatrixXd rows(outputs_ * dimension_, points.cols());
    call(*jacobian_, "derivative", points, outputs_ * dimension_, rows);
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      jacobians.col(i) = rows.col(i).reshaped<Eigen::RowMajor>(outputs_, dimension_).reshaped();
    calls_.jacobians += dimension_ * points.cols();
  }

 private:
  /// `size` numbers for each point into the columns of `out`.
  void call(const py::function& function, const char* what, const Eigen::Ref<const Eigen::MatrixXd>& points,
            Eigen::Index size, Eigen::Ref<Eigen::MatrixXd> out) const {
    check_cancellation(k_nothing_kept);
    const py::gil_scoped_acquire hold;
    const Eigen::MatrixXd columns = points;  // a column each: n × d in C order, for the function to keep
    const auto n = points.cols();
    const py::array_t<double> rows({n, dimension_}, columns.data());
    const auto answer = function(rows).cast<Doubles>();
    if (answer.size() != n * size)
      throw UsageError("the model gave " + counted(answer.size(), what) + " for " + counted(n, "point") +
                       "; needed: " + std::to_string(n * size) + " (" + std::to_string(size) + " each)");
    out = Eigen::Map<const Eigen::MatrixXd>(answer.data(), size, n);
  }

  py::function function_;
  std::optional<py::function> jacobian_;
  Eigen::Index dimension_, outputs_;
  bool is_density_;
};

py::dict dictionary_of(const assimilation::InferenceResult& r, std::span<const model::Axis> axes,
                       const std::vector<posterior::Prior>& priors, const std::string& samples_file) {
  using namespace py::literals;
  const std::size_t d = r.points.cols();
  return py::dict("json"_a = files::json_line(record::inference_record(r, axes, samples_file)),
                  "draws"_a = rows_of(plain(r.draws), d), "chains"_a = r.chains,
                  "points"_a = rows_of(plain(r.points), d), "weights"_a = array_of(plain(r.weights)),
                  "densities"_a = densities_of(priors), "labels"_a = labels_of(axes));
}

struct InferenceValues {
  std::vector<posterior::Prior> densities;  ///< the priors
  std::vector<double> observed, std, covariance;
  assimilation::InferenceOptions options;
};
using ProgressFunction = std::optional<py::function>;

/// progress(done, total): model evaluations made, and an estimate of all; None while there is none.
void call_progress(const ProgressFunction& progress, Eigen::Index done, std::optional<Eigen::Index> total) {
  if (!progress) return;
  const py::gil_scoped_acquire hold;
  if (total)
    (*progress)(done, std::max(done, *total));
  else
    (*progress)(done, py::none());
}

std::optional<assimilation::Observations> observations_of(const InferenceValues& values) {
  const auto n = std::ssize(values.observed);
  if (n == 0) return std::nullopt;
  const Eigen::VectorXd y = library::vector_of(values.observed);
  if (!values.covariance.empty())
    return assimilation::Observations{y, likelihood::GaussianNoise::of_covariance(library::rows_of(
                                             values.covariance, values.observed.size(), "covariance"))};
  return assimilation::Observations{y,
                                    likelihood::GaussianNoise::independent(library::vector_of(values.std))};
}

assimilation::InferenceResult infer(CallableModel& model, InferenceValues& values,
                                    const ProgressFunction& progress) {
  constexpr double k_step = 1e-4;  // of differences, as a project's default
  assimilation::ModelEvaluator evaluator(model, values.densities, k_step);
  assimilation::PosteriorDensity posterior(
      evaluator, values.densities, observations_of(values),
      assimilation::useful_derivatives(values.options.method, model.has_jacobian()));
  std::optional<Eigen::Index> total;
  values.options.progress = [&](double share) {
    if (share > 0) total = std::llround((model.calls().evaluations) / share);
    return !cancellation_requested();
  };
  evaluator.progress = [&](const model::ModelCalls& calls) {
    call_progress(progress, calls.evaluations, total);
  };
  assimilation::InferenceResult result = assimilation::infer(posterior, evaluator, values.options);
  call_progress(progress, model.calls().evaluations, model.calls().evaluations);
  return result;
}

py::dict infer_callable(py::function function, std::optional<py::function> jacobian,
                        const std::vector<PriorValues>& priors, const Doubles& observed, const Doubles& std,
                        const Doubles& covariance, const std::string& method, double tolerance, int max_order,
                        Eigen::Index samples, std::int64_t evaluations, double seconds, std::uint64_t seed,
                        const ProgressFunction& progress) {
  InferenceValues values{{}, vector_of(observed), vector_of(std), vector_of(covariance), {}};
  std::vector<std::string> names;
  const std::vector<Prior> named = priors_of(priors);
  for (const Prior& prior : named) names.push_back(prior.parameter);
  values.densities = library::priors_of(named);
  values.options.method = assimilation::method_from(method);
  values.options.map.tolerance = tolerance;
  values.options.map.max_order = max_order;
  values.options.map.seed = values.options.seed = seed;
  values.options.samples = samples;
  values.options.evaluations = evaluations;
  values.options.seconds = seconds;
  values.options.names = names;
  values.options.makes_draws = false;  // when they are asked for
  CallableModel model(std::move(function), std::move(jacobian), std::ssize(names), values.observed.size());
  const assimilation::InferenceResult result = long_call([&] { return infer(model, values, progress); });
  std::vector<model::Axis> axes;
  for (const std::string& name : names) axes.push_back({name, {}, "", "", 1});
  py::dict found = dictionary_of(result, axes, values.densities, "");
  if (!values.observed.empty()) found["prior"] = prior_at(values.densities, result.points);
  return found;
}

py::dict infer_project(const std::string& path, const std::string& method, const std::string& results) {
  const record::InferenceRun run = long_call([&] {
    project::Project project = project::read_project(path);
    const std::string folder = results.empty() ? project.results : results;
    return record::run_inference(
        project, method.empty() ? project.method.kind : assimilation::method_from(method), folder);
  });
  py::dict found =
      dictionary_of(run.result, run.setup.axes, run.setup.priors, record::samples_path(run.folder));
  if (run.setup.observations) found["prior"] = prior_at(run.setup.priors, run.result.points);
  return found;
}

/// What a comparison looks at, of the line of an inference.
assimilation::InferenceResult compared_of(const py::dict& line) {
  assimilation::InferenceResult r;
  r.mean = library::vector_of(line["mean"].cast<std::vector<double>>());
  const auto rows = [](const py::handle& lists) {
    std::vector<double> values;
    for (const py::handle& row : lists)
      for (const double value : row.cast<std::vector<double>>()) values.push_back(value);
    return values;
  };
  r.covariance = library::rows_of(rows(line["covariance"]), r.mean.size(), "covariance");
  const auto quantiles = line["quantiles"].cast<py::dict>();
  r.quantiles = library::rows_of(rows(quantiles["values"]), py::len(quantiles["levels"]), "quantiles");
  r.log_evidence = line["log_evidence"].cast<double>();
  r.log_evidence_error = line["log_evidence_error"].cast<double>();
  r.mean_error = line["mean_error"].cast<double>();
  r.deviation_error = line["deviation_error"].cast<double>();
  return r;
}

/// The line of `knothe infer --compare`, and its sentence.
std::pair<std::string, std::string> compare_inferences(const py::dict& first, const py::dict& second) {
  const assimilation::Comparison c = assimilation::compare(compared_of(first), compared_of(second));
  return {files::json_line(record::comparison_record(c, first["method"].cast<std::string>(),
                                                     second["method"].cast<std::string>())),
          c.in_words()};
}

void bind_inference(py::module_& module) {
  module.def("compare_inferences", &compare_inferences, arg("first"), arg("second"));
  module.def("infer_callable", &infer_callable, arg("function"), arg("jacobian"), arg("priors"),
             arg("observed"), arg("std"), arg("covariance"), arg("method"), arg("tolerance"),
             arg("max_order"), arg("samples"), arg("evaluations"), arg("seconds"), arg("seed"),
             arg("progress"));
  module.def("infer_project", &infer_project, arg("path"), arg("method"), arg("results"));
}

}  // namespace

void bind_models(py::module_& module) {
  bind_reduced_models(module);
  bind_import(module);
  bind_inference(module);
}

}  // namespace knothe::python
