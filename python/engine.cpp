/// @file The engine of the program (docs/explanation/architecture.md).
#include "knothe/assimilation/engine/engine.hpp"

#include <pybind11/stl.h>

#include <nlohmann/json.hpp>

#include "knothe/files/json_line.hpp"
#include "knothe/library/engine_of_values.hpp"
#include "knothe/library/plain.hpp"
#include "knothe/model/reduced/loading.hpp"
#include "knothe/model/reduced/parameter_order.hpp"
#include "knothe/numerics/statistics/distinct_draws.hpp"
#include "knothe/posterior/quadrature/marginal_density.hpp"
#include "knothe/project/project_engine.hpp"
#include "knothe/project/refinement.hpp"
#include "knothe/record/forecast_text.hpp"
#include "knothe/record/posterior_file.hpp"
#include "knothe/record/step_record.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/interruption.hpp"
#include "python/values.hpp"

namespace knothe::python {
namespace {

using library::plain;
using likelihood::DatumKey;
using py::arg;

/// Of weighted values of a parameter that lies between these bounds, ±∞ where there is none.
py::tuple marginal_density(const Doubles& values, const Doubles& weights, double lower, double upper) {
  const bool below = std::isfinite(lower), above = std::isfinite(upper);
  const auto prior = below && above ? posterior::Prior::uniform(lower, upper)
                     : below        ? posterior::Prior::lognormal(0, 1)
                                    : posterior::Prior::normal(0, 1);
  const Eigen::VectorXd x = library::vector_of(span_of(values)), w = library::vector_of(span_of(weights));
  const auto density = long_call([&] { return posterior::marginal_density(x, w, prior); });
  return py::make_tuple(array_of(density.points), array_of(density.density));
}

/// What the engine says of a step, with the priors against which its densities are drawn.
struct Result {
  assimilation::StepResult step;
  std::shared_ptr<const std::vector<posterior::Prior>> priors;
  std::shared_ptr<const std::vector<model::Axis>> axes;
  model::Loading loading;  ///< at the posterior mean
  bool warned = false;     ///< the caller, that it is not trusted
};
using SharedResult = std::shared_ptr<Result>;

posterior::Method method_of(const std::string& kind) {
  if (const auto method = from_text<posterior::Method>(kind)) return *method;
  throw UsageError("method \"" + kind + "\": give transport, grid, mcmc, smc, ekf, ukf or enkf");
}

/// An engine with its recorded data, and the results of its steps as long as they hold.
class Twin {
 public:
  [[nodiscard]] static std::unique_ptr<Twin> of_project(const std::string& path, const std::string& kind) {
    project::Project project = project::read_project(path);
    if (!kind.empty()) project.method.kind = method_of(kind);
    project::UpdateSetup setup = project::set_up(project);
    auto twin = std::make_unique<Twin>(project::engine_setup(project, setup), setup.model, project.clock);
    twin->refinement_ = project::make_refinement(project, setup);
    twin->sensors_ = setup.measurements.sensors;
    twin->time_indices_ = setup.time_indices;
    twin->series_ = setup.measurements.series;
    twin->project_ = project.text;
    twin->seed_ = project.method.seed;
    twin->data_.emplace(std::move(setup));
    return twin;
  }
  Twin(assimilation::EngineSetup setup, model::SeparatedModel model, std::string clock)
      : sensors_(setup.sensors),
        engine_(std::make_unique<assimilation::Engine>(std::move(setup))),
        model_(std::move(model)),
        clock_(std::move(clock)),
        axes_(std::make_shared<const std::vector<model::Axis>>(model_.contents().axes)) {
    priors_ = std::make_shared<const std::vector<posterior::Prior>>(engine_->priors());
    for (std::size_t i = 0; i < engine_->model().time.size(); ++i) time_indices_.push_back(i);
  }

  /// The posterior of all data up to the datum's step.
  SharedResult assimilate(likelihood::Datum datum) {
    datum.time_index = time_index(datum.step);
    const std::pair place(datum.step, datum.key);
    if (keys_.contains(place))
      throw UsageError(fault(datum.step) +
                       " is assimilated already: withdraw it before adding another, or "
                       "give the datum another source, session or seq");
    engine_->add(datum);
    keys_.insert(place);
    forget_stale();
    std::optional<assimilation::StepResult> concluded;
    try {
      concluded = engine_->posterior_at(datum.step);
    } catch (...) {  // interrupted, or an error: as if the datum had not come
      withdraw(datum.step, datum.key);
      throw;
    }
    Result result = result_of(*std::move(concluded));
    const bool is_last = datum.step + 1 == time_indices_.size();
    if (refinement_ && refinement_->refine_if_needed(engine_, result.step, is_last)) results_.clear();
    return results_[datum.step] = std::make_shared<Result>(std::move(result));
  }
  void withdraw(std::size_t step, const DatumKey& key) {
    if (!engine_->withdraw(step, key))
      throw UsageError(fault(step) + " is not assimilated: there is nothing to withdraw");
    keys_.erase({step, key});
    results_.erase(step);
    forget_stale();
  }
  [[nodiscard]] SharedResult result(std::size_t step) {
    if (engine_->data().count(step) == 0) throw UsageError(fault(step) + " is not assimilated");
    SharedResult& kept = results_[step];
    if (!kept) kept = std::make_shared<Result>(result_of(engine_->posterior_at(step)));
    return kept;
  }
  /// As `knothe assimilate` writes posterior.nc, of all steps with data.
  void write_posterior(const std::string& path, Eigen::Index draws) {
    if (!engine_->last_step()) throw UsageError("no datum has been assimilated yet");
    const model::ObservedModel& model = engine_->model();
    std::vector<record::KeptStep> steps;
    assimilation::RunVerdict run;
    for (const std::size_t step : engine_->data().step_numbers()) {
      steps.push_back(record::retain_step(result(step)->step, engine_->last_datum(step), &model));
      run.add(steps.back().result.verdict);
    }
    record::write_posterior_file(path, {project_, seed_, *axes_, *priors_, model, sensors_, series_,
                                        *steps.back().datum.noise, steps, run.verdict(), draws});
  }
  /// Of all steps: what the last line of `knothe assimilate` says.
  [[nodiscard]] std::string run_verdict() {
    assimilation::RunVerdict run;
    for (const std::size_t step : engine_->data().step_numbers()) run.add(result(step)->step.update.verdict);
    return files::json_line(record::verdict_record(run.verdict()));
  }
  [[nodiscard]] std::optional<likelihood::Datum> next() {
    if (!data_) throw UsageError("this twin was made from values: it has no recorded data");
    const auto last = results_.empty() ? nullptr : results_.rbegin()->second;
    auto item = data_->next(last ? last->step.update.mean : Eigen::VectorXd());
    if (!item) return std::nullopt;
    return std::move(item->datum);
  }
  [[nodiscard]] std::size_t time_index(std::size_t step) const {
    if (step < time_indices_.size()) return time_indices_[step];
    const std::size_t last = time_indices_.size() - 1;
    throw UsageError(fault(step) +
                     (last == 0 ? ": the only step is 0" : ": there are steps 0 to " + std::to_string(last)));
  }
  [[nodiscard]] std::vector<double> times() const {
    std::vector<double> times;
    for (const std::size_t i : time_indices_) times.push_back(engine_->model().time[i]);
    return times;
  }
  [[nodiscard]] const assimilation::Engine& engine() const { return *engine_; }
  [[nodiscard]] const model::Sensors& sensors() const { return sensors_; }
  [[nodiscard]] SharedResult results_of_last() {
    const auto last = engine_->last_step();
    return last ? result(*last) : nullptr;
  }
  std::mutex mutex;

 private:
  [[nodiscard]] Result result_of(assimilation::StepResult step) const {
    const Eigen::VectorXd& mean = step.update.mean;
    auto loading = model::loading_of(model_, clock_, {mean.begin(), mean.end()});
    return {std::move(step), priors_, axes_, std::move(loading)};
  }
  [[nodiscard]] static std::string fault(std::size_t step) { return "step " + std::to_string(step); }
  void forget_stale() {
    for (const std::size_t step : engine_->stale()) results_.erase(step);
  }

  model::Sensors sensors_;
  std::map<std::string, likelihood::MeasuredSeries> series_;  ///< of recorded data
  std::string project_;
  std::uint64_t seed_ = 1;
  std::unique_ptr<assimilation::Engine> engine_;
  model::SeparatedModel model_;
  std::string clock_;  ///< the output that is imposed; empty: its displacement
  std::shared_ptr<const std::vector<model::Axis>> axes_;
  std::shared_ptr<const std::vector<posterior::Prior>> priors_;
  std::optional<project::RecordedData> data_;
  std::unique_ptr<project::Refinement> refinement_;
  std::vector<std::size_t> time_indices_;
  std::set<std::pair<std::size_t, DatumKey>> keys_;
  std::map<std::size_t, SharedResult> results_;
};

likelihood::Datum datum_of(std::size_t step, const Doubles& values, const Doubles& std,
                           const std::optional<SparseRows>& precision, const std::string& source,
                           const std::string& session, std::int64_t seq) {
  likelihood::Datum datum{{source, session, seq}, step, step, library::vector_of(span_of(values)), {}};
  const Noise noise = noise_of(std, precision);
  if (!noise.empty()) datum.noise = library::noise_of(noise, values.size());
  return datum;
}

/// Of noise of its own that is correlated; else none.
std::optional<py::tuple> precision_of(const likelihood::Datum& datum) {
  if (!datum.noise || datum.noise->is_independent()) return std::nullopt;
  const Eigen::SparseMatrix<double> columns =
      datum.noise->precision();  // of a symmetric matrix also the rows
  const auto entries = columns.nonZeros();
  const int *inner = columns.innerIndexPtr(), *outer = columns.outerIndexPtr();
  return py::make_tuple(array_of(std::vector<double>(columns.valuePtr(), columns.valuePtr() + entries)),
                        array_of(std::vector<std::int64_t>(inner, inner + entries)),
                        array_of(std::vector<std::int64_t>(outer, outer + columns.outerSize() + 1)));
}

void bind_data(py::module_& module) {
  using likelihood::Datum;
  py::class_<Datum>(module, "Datum")
      .def(py::init(&datum_of), arg("step"), arg("values"), arg("std"), arg("precision"), arg("source"),
           arg("session"), arg("seq"))
      .def_readonly("step", &Datum::step)
      .def_property_readonly("values", [](const Datum& datum) { return array_of(plain(datum.values)); })
      .def_property_readonly("source", [](const Datum& datum) { return datum.key.source; })
      .def_property_readonly("session", [](const Datum& datum) { return datum.key.session; })
      .def_property_readonly("seq", [](const Datum& datum) { return datum.key.seq; })
      .def_property_readonly("std",
                             [](const Datum& datum) -> py::object {
                               if (!datum.noise) return py::none();
                               return array_of(plain(datum.noise->standard_deviations()));
                             })
      .def("precision", &precision_of);
}

void bind_results(py::module_& module) {
  const auto points_of_result = [](const Result& result) {
    const posterior::Posterior& p = result.step.update;
    return rows_of(plain(p.points), p.points.cols());
  };
  py::class_<Result, std::shared_ptr<Result>>(module, "Result")
      .def_readwrite("warned", &Result::warned)
      .def("json",
           [](const Result& result) {
             return files::json_line(record::step_record(result.step, *result.axes));
           })
      .def("forecasts_json",
           [](const Result& result) {
             auto all = record::forecast_record(result.step.forecasts, true);
             for (const assimilation::NamedForecast& forecast : result.step.forecasts)
               all[forecast.name]["at"] = record::horizon_text(forecast.horizon, result.loading);
             return files::json_line(all);
           })
      .def("time_units", [](const Result& result) { return result.loading.time_units; })
      .def("points", points_of_result)
      .def("weights", [](const Result& result) { return array_of(plain(result.step.update.weights)); })
      .def("labels", [](const Result& result) { return labels_of(*result.axes); })
      .def("densities", [](const Result& result) { return densities_of(*result.priors); })
      .def("prior", [](const Result& result) { return prior_at(*result.priors, result.step.update.points); });
  module.def(
      "distinct_draws",
      [](const Doubles& points, const Doubles& weights, Eigen::Index count, const Doubles& lower,
         const Doubles& upper) {
        const auto n = weights.size();
        const Eigen::Map<const model::RowMatrix> rows(points.data(), n, points.size() / n);
        const Eigen::VectorXd w = library::vector_of(span_of(weights)),
                              low = library::vector_of(span_of(lower)),
                              high = library::vector_of(span_of(upper));
        const Eigen::MatrixXd draws =
            long_call([&] { return numerics::distinct_draws(rows, w, count, low, high); });
        return rows_of(plain(draws), draws.cols());
      },
      arg("points"), arg("weights"), arg("count"), arg("lower"), arg("upper"));
  module.def("marginal_density", &marginal_density, arg("values"), arg("weights"), arg("lower"),
             arg("upper"));
}

/// The tables [forecast.NAME] of `text`, a project file's, for the engine.
void add_forecasts(const std::string& text, const model::SeparatedModel& model, const Sensors& sensors,
                   assimilation::EngineSetup& setup) {
  const project::Project project = project::parse_project(text, "forecasts");
  if (project.forecasts.empty()) return;
  setup.forecaster.emplace(
      model, model::Dofs{sensors.points, {sensors.components.begin(), sensors.components.end()}},
      project.forecasts);
}

std::unique_ptr<Twin> twin_of_values(const std::string& model, const Doubles& points,
                                     const std::vector<int>& components,
                                     const std::vector<std::string>& series, const Doubles& std,
                                     const std::optional<SparseRows>& precision,
                                     const std::vector<PriorValues>& priors, double tolerance, int max_order,
                                     std::uint64_t seed, const std::string& forecasts) {
  const Sensors sensors{vector_of(points), components, series};
  const Noise noise = noise_of(std, precision);
  const std::vector<Prior> named = priors_of(priors);
  return long_call([&] {
    assimilation::EngineSetup setup =
        library::engine_setup(model, sensors, noise, named, {tolerance, max_order, seed});
    std::vector<std::string> names;
    for (const Prior& prior : named) names.push_back(prior.parameter);
    const model::SeparatedModel ordered(model::with_parameter_order(model::read_model(model), names), model);
    add_forecasts(forecasts, ordered, sensors, setup);
    return std::make_unique<Twin>(std::move(setup), ordered, "");
  });
}

void bind_twin(py::module_& module) {
  py::class_<Twin>(module, "Twin")
      .def_static(
          "of_project",
          [](const std::string& path, const std::string& kind) {
            return long_call([&] { return Twin::of_project(path, kind); });
          },
          arg("path"), arg("kind"))
      .def_static("of_values", &twin_of_values, arg("model"), arg("points"), arg("components"), arg("series"),
                  arg("std"), arg("precision"), arg("priors"), arg("tolerance"), arg("max_order"),
                  arg("seed"), arg("forecasts"))
      .def(
          "assimilate",
          [](Twin& twin, const likelihood::Datum& datum) {
            return long_call(twin.mutex, [&] { return twin.assimilate(datum); });
          },
          arg("datum"))
      .def(
          "withdraw",
          [](Twin& twin, std::size_t step, const std::string& source, const std::string& session,
             std::int64_t seq) {
            long_call(twin.mutex, [&] { twin.withdraw(step, {source, session, seq}); });
          },
          arg("step"), arg("source"), arg("session"), arg("seq"))
      .def(
          "result",
          [](Twin& twin, std::size_t step) {
            return long_call(twin.mutex, [&] { return twin.result(step); });
          },
          arg("step"))
      .def("last", [](Twin& twin) { return long_call(twin.mutex, [&] { return twin.results_of_last(); }); })
      .def("run_verdict",
           [](Twin& twin) { return long_call(twin.mutex, [&] { return twin.run_verdict(); }); })
      .def("next", [](Twin& twin) { return long_call(twin.mutex, [&] { return twin.next(); }); })
      .def("steps",
           [](Twin& twin) {
             return long_call(twin.mutex, [&] { return twin.engine().data().step_numbers(); });
           })
      .def("times", [](const Twin& twin) { return array_of(twin.times()); })
      .def("parameters", [](const Twin& twin) { return twin.engine().model().parameters; })
      .def(
          "values",
          [](Twin& twin, std::size_t step) {
            return array_of(long_call(twin.mutex, [&] {
              const auto last = twin.engine().data().last(step);
              return last ? plain(last->values) : std::vector<double>();
            }));
          },
          arg("step"))
      .def("sensors",
           [](const Twin& twin) {
             const model::Sensors& s = twin.sensors();
             std::vector<std::string> names;
             for (std::size_t i = 0; i < s.displacement_count(); ++i) names.push_back(s.label(i));
             return py::make_tuple(rows_of(s.points, 3), array_of(s.components), s.scalars, names);
           })
      .def(
          "write_posterior",
          [](Twin& twin, const std::string& path, Eigen::Index draws) {
            long_call(twin.mutex, [&] { twin.write_posterior(path, draws); });
          },
          arg("path"), arg("draws"))
      .def(
          "predict",
          [](Twin& twin, const Doubles& points, std::size_t step, bool jacobian) {
            const auto span = span_of(points);
            return arrays_of(long_call(twin.mutex, [&] {
              return predict(twin.engine().model(), span, twin.time_index(step), jacobian);
            }));
          },
          arg("points"), arg("step"), arg("jacobian"));
}

}  // namespace

void bind_engine(py::module_& module) {
  bind_data(module);
  bind_results(module);
  bind_twin(module);
}

}  // namespace knothe::python
