#include "knothe/reproduction/experiment.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <numeric>

#include "knothe/assimilation/data/synthetic_measurements.hpp"
#include "knothe/assimilation/select/selection_study.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/engine/engine.hpp"

namespace knothe::reproduction {

using Eigen::Index;

namespace {

/// CPU time of this process, ms: what the paper reports, and what other work on the machine does not change.
double cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

}  // namespace

std::vector<std::size_t> random_dofs(const reduction::Dofs& dofs, std::uint64_t seed) {
  assimilation::DofSelection selection;
  selection.nodes = published::k_nodes;
  selection.x_range = {-0.12, 0.12};
  return assimilation::choose_dofs(dofs, selection, seed);
}

Sensors random_nodes(const reduction::SeparatedModel& model, std::uint64_t seed) {
  const reduction::Dofs& dofs = model.contents().dofs;
  Sensors sensors;
  for (const std::size_t dof : random_dofs(dofs, seed)) sensors.add(dofs.point(dof), dofs.components[dof]);
  return sensors;
}

Sensors part_of(const Sensors& sensors, std::span<const Index> numbers) {
  Sensors part;
  for (const Index number : numbers) {
    const auto i = static_cast<std::size_t>(number);
    part.add(sensors.point(i), sensors.components[i]);
  }
  return part;
}

std::shared_ptr<const reduction::ObservedModel> observed(const reduction::SeparatedModel& model,
                                                         const Sensors& sensors) {
  return std::make_shared<const reduction::ObservedModel>(reduction::observe(model, sensors));
}

assimilation::Measurements measure(const Eigen::MatrixXd& exact, const Sensors& sensors,
                                   const std::vector<double>& time, std::uint64_t seed, double noise_std) {
  std::vector<std::size_t> all(sensors.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return assimilation::add_noise(sensors, all, time, exact, noise_std, seed);
}

Eigen::MatrixXd predicted(const reduction::ObservedModel& model, const Eigen::VectorXd& p) {
  Eigen::MatrixXd exact(model.observations(), static_cast<Index>(model.time.size()));
  for (std::size_t t = 0; t < model.time.size(); ++t) exact.col(static_cast<Index>(t)) = model.predict(p, t);
  return exact;
}

std::vector<assimilation::Prior> paper_priors() {
  std::vector<assimilation::Prior> priors;
  for (const double mean : published::k_prior_mean)
    priors.push_back(assimilation::Prior::normal(mean, std::sqrt(published::k_prior_variance)));
  return priors;
}

assimilation::UpdateOptions default_options(std::uint64_t seed) {
  assimilation::UpdateOptions options;
  options.map.tolerance = published::k_tolerance;
  options.map.seed = seed;
  return options;
}

assimilation::UpdateOptions paper_options(std::uint64_t seed) {
  assimilation::UpdateOptions options = default_options(seed);
  options.form = assimilation::UpdateOptions::Form::composed;
  options.map.minimiser = transport::MinimiserKind::bfgs;
  return options;
}

double Run::std_at(std::size_t i, Index k) const {
  return std::sqrt(steps[i].covariance(k, k));
}

double Run::off_by(Index k, double truth) const {
  return std::abs(mean(k) - truth) / std(k);
}

Run::Distance Run::worst_off(const Eigen::VectorXd& truth) const {
  Distance worst;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    for (Index k = 0; k < truth.size(); ++k) {
      const double off = std::abs(steps[i].mean[k] - truth[k]) / std_at(i, k);
      if (off > worst.std) worst = {off, steps[i].step};
    }
  }
  return worst;
}

double Run::mode_of_marginal(std::size_t k) const {
  const assimilation::MarginalDensity& m = marginals.back()[k];
  return m.points[static_cast<std::size_t>(std::max_element(m.density.begin(), m.density.end()) -
                                           m.density.begin())];
}

std::size_t Run::first_below(Index k, double fraction) const {
  const double limit = fraction * assimilation::standard_deviation(priors[static_cast<std::size_t>(k)]);
  std::size_t i = 0;
  while (i < steps.size() && std_at(i, k) >= limit) ++i;
  return i;
}

std::vector<std::size_t> Run::high_order_steps() const {
  std::vector<std::size_t> high;
  for (const assimilation::UpdateResult& r : steps)
    if (r.map_order > 1) high.push_back(r.step);
  return high;
}

Run assimilate(const std::shared_ptr<const reduction::ObservedModel>& model,
               const assimilation::Measurements& data, const RunOptions& options) {
  engine::EngineSetup setup;
  setup.model = model;
  setup.noise = data.noise;
  setup.priors = paper_priors();
  setup.update = options.update;
  engine::Engine engine(std::move(setup));
  Run run;
  run.parameters = model->parameters;
  run.priors = engine.priors();
  std::vector<std::size_t> steps = options.steps;
  if (steps.empty()) {
    steps.resize(model->time.size());
    std::iota(steps.begin(), steps.end(), std::size_t{0});
  }
  Progress progress(options.label, steps.size(), options.label.empty());
  for (const std::size_t t : steps) {
    check_cancellation("the models that were built are kept: the same command goes on from there");
    const double start = cpu_ms();
    const engine::StepResult result =
        engine.assimilate({{}, t, t, data.values.col(static_cast<Index>(t)), {}});
    run.steps.push_back(result.update);
    run.update_ms.push_back(cpu_ms() - start);
    const assimilation::Posterior& posterior = result.update;
    if (options.marginals) {
      run.marginals.emplace_back();
      for (std::size_t k = 0; k < run.priors.size(); ++k)
        run.marginals.back().push_back(assimilation::marginal_density(
            posterior.points.col(static_cast<Index>(k)), posterior.weights, run.priors[k]));
    }
    if (options.forecaster != nullptr) {
      const double forecast_start = cpu_ms();
      run.forecasts.push_back(options.forecaster->update(posterior.points, posterior.weights));
      run.forecast_ms.push_back(cpu_ms() - forecast_start);
      run.published.push_back(options.forecaster->published(posterior.points, posterior.weights));
      if (t == steps.front() || t == steps.back())
        run.published_by_map.push_back(options.forecaster->published(
            posterior.points, posterior.weights, forecast::Forecaster::FieldDensity::inverse_map));
    }
    progress.advance_to(run.steps.size());
  }
  return run;
}

report::Results as_results(const Run& run, const Eigen::VectorXd& truth, std::size_t stride) {
  report::Results results;
  for (std::size_t k = 0; k < run.parameters.size(); ++k) {
    report::ParameterSummary parameter;
    parameter.name = run.parameters[k];
    parameter.lower = run.priors[k].lower();
    parameter.upper = run.priors[k].upper();
    parameter.reference = 1.0;
    parameter.truth = truth[static_cast<Index>(k)];
    results.parameters.push_back(parameter);
    const assimilation::MarginalDensity prior = assimilation::marginal_density(run.priors[k]);
    results.prior_marginals[run.parameters[k]] = {prior.points, prior.density};
  }
  for (std::size_t i = 0; i < run.steps.size(); ++i) {
    if (i % stride != 0 && i + 1 != run.steps.size()) continue;
    const assimilation::UpdateResult& r = run.steps[i];
    report::Step step;
    step.step = r.step;
    step.time = r.time;
    step.mean = r.mean;
    step.covariance = r.covariance;
    step.map_order = r.map_order;
    step.variance_diagnostic = r.variance_diagnostic;
    step.trusted = r.trusted;
    step.log_evidence_increment = r.log_evidence_increment;
    step.update_us = r.elapsed_us.total();
    for (std::size_t k = 0; i < run.marginals.size() && k < run.parameters.size(); ++k)
      step.marginals[run.parameters[k]] = {run.marginals[i][k].points, run.marginals[i][k].density};
    if (i < run.forecasts.size()) {
      for (const forecast::NamedForecast& f : run.forecasts[i]) {
        report::StepForecast& entry = step.forecast[f.name];
        entry.mean = f.forecast.mean;
        entry.std = f.forecast.std;
        entry.maximum_a_posteriori = f.forecast.maximum_a_posteriori;
        entry.units = f.units;
        entry.levels.assign(numerics::k_quantile_levels.begin(), numerics::k_quantile_levels.end());
        entry.values.assign(f.forecast.values.begin(), f.forecast.values.end());
        entry.density = {f.forecast.points, f.forecast.density};
      }
    }
    results.steps.push_back(std::move(step));
  }
  return results;
}

}  // namespace knothe::reproduction
