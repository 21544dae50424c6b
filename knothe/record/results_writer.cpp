#include "knothe/record/results_writer.hpp"

#include <fmt/format.h>
#include <sys/utsname.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <thread>

#include "knothe/assimilation/forecast/forecast_inputs.hpp"
#include "knothe/assimilation/forecast/horizon.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/files/vtu.hpp"
#include "knothe/likelihood/noise/predictive.hpp"
#include "knothe/model/reduced/field_file.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/time_interpolation.hpp"
#include "knothe/numerics/statistics/distinct_draws.hpp"
#include "knothe/posterior/quadrature/marginal_density.hpp"
#include "knothe/record/json_values.hpp"
#include "knothe/record/physical_parameters.hpp"
#include "knothe/record/posterior_file.hpp"
#include "knothe/record/step_record.hpp"

namespace knothe::record {

using Json = nlohmann::ordered_json;

Json machine_record() {
  utsname name{};
  uname(&name);
  std::string processor = name.machine;
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.starts_with("model name")) {
      processor = line.substr(line.find(':') + 2);
      break;
    }
  }
  return {{"processor", processor},
          {"cores", std::thread::hardware_concurrency()},
          {"system", fmt::format("{} {}", name.sysname, name.release)},
          {"compiler", __VERSION__}};
}

ResultsWriter::ResultsWriter(const project::Project& project, const model::SeparatedModel& model,
                             const likelihood::Measurements& measurements,
                             std::vector<posterior::Prior> priors,
                             std::shared_ptr<const model::ObservedModel> observed)
    : project_(project),
      model_(model),
      measurements_(measurements),
      priors_(std::move(priors)),
      observed_(std::move(observed)) {
  // Rows behind the displacements are in `series` too.
  measurements_.values = measurements.values.topRows(measurements.sensors.displacement_count());
}

void ResultsWriter::add_step(const assimilation::StepResult& result,
                             const std::vector<assimilation::NamedForecast>& published,
                             const likelihood::Datum& datum) {
  measurements_.values.col(steps_.size()) = datum.values.head(measurements_.values.rows());
  const auto start = monotonic_now();
  Json record = step_record(result, model_.contents().axes);
  scores_.insert(scores_.end(), result.scores.begin(), result.scores.end());
  add_densities(record, model_.parameter_names(), priors_, result, published);
  record["elapsed_us"]["densities"] = microseconds_since(start);
  lines_.push_back(files::json_line(record));
  steps_.push_back(retain_step(result, datum, observed_.get()));
  if (observed_) steps_.back().error = error_beside(result, datum);
  run_.add(result.update.verdict);
}

void ResultsWriter::use(const project::Refinement& refinement) {
  model_ = refinement.setup()->model;
  observed_ = refinement.setup()->problem.model;
  run_.forget_model();
  refinement_ = {{"model", refinement.file()},
                 {"version", refinement.version()},
                 {"full_order_runs", refinement.runs()},
                 {"moved_std", refinement.whole_move().mean},
                 {"last_move_std", refinement.last_move().mean},
                 {"last_move_of_std", refinement.last_move().std}};
}

void ResultsWriter::write(const std::string& folder, double elapsed_s) const {
  const std::filesystem::path base(folder);
  write_steps(base / "steps.jsonl");
  write_summary(base / "summary.json", elapsed_s);
  if (steps_.empty()) return;
  write_posterior(base / "posterior.nc");
  if (model_.contents().mesh) write_fields(base / "fields");
}

void ResultsWriter::write_steps(const std::string& path) const {
  std::string text;
  for (const std::string& line : lines_) text += line + "\n";
  files::write_text_atomically(path, text);
}

Json ResultsWriter::parameter_summaries() const {
  Json parameters = Json::array();
  const auto& axes = model_.contents().axes;
  for (std::size_t k = 0; k < axes.size(); ++k) {
    Json entry = {{"name", axes[k].name},
                  {"prior", priors_[k].describe()},
                  {"lower", axes[k].nodes.front()},
                  {"upper", axes[k].nodes.back()},
                  {"reference", axes[k].reference},
                  {"units", reference_units(axes[k])},
                  {"support", support_of(priors_[k])}};
    if (const auto it = measurements_.truth.find(axes[k].name); it != measurements_.truth.end()) {
      entry["truth"] = it->second;
    }
    parameters.push_back(std::move(entry));
  }
  return parameters;
}

Json ResultsWriter::load_displacement() const {
  const auto& outputs = model_.output_names();
  const auto has = [&](const char* name) {
    return std::find(outputs.begin(), outputs.end(), name) != outputs.end();
  };
  if (steps_.empty() || !has("reaction_force") || !has("imposed_displacement")) return nullptr;
  const Eigen::VectorXd& mean = steps_.back().result.mean;
  const std::vector<double> p(mean.begin(), mean.end());
  return {{"time", model_.contents().time},
          {"displacement", model_.evaluate_output("imposed_displacement", p).value},
          {"force", model_.evaluate_output("reaction_force", p).value}};
}

/// Draws of the last posterior, by parameter, for the report's pairs.
Json ResultsWriter::last_draws() const {
  constexpr Eigen::Index k_shown = 500;
  const assimilation::UpdateResult& last = steps_.back().result;
  const auto d = std::ssize(priors_);
  Eigen::VectorXd lower(d), upper(d);
  for (Eigen::Index k = 0; k < d; ++k) {
    const posterior::Prior& prior = priors_[k];
    lower[k] = prior.lower(), upper[k] = prior.upper();
  }
  const Eigen::MatrixXd draws = numerics::distinct_draws(last.points, last.weights, k_shown, lower, upper);
  Json record = Json::object();
  for (std::size_t k = 0; k < priors_.size(); ++k)
    record[model_.contents().axes[k].name] = to_json(draws.col(k));
  return record;
}

/// Of each scalar series: its datum, and what is expected of it.
void ResultsWriter::add_series(Json& record, const KeptStep& step, const Eigen::VectorXd& expected) const {
  const model::Sensors& sensors = measurements_.sensors;
  const Eigen::Index n = sensors.displacement_count();
  for (std::size_t k = 0; k < sensors.scalars.size(); ++k) {
    const Eigen::Index row = n + k;
    if (row >= step.datum.values.size() || row >= expected.size()) return;
    if (std::isnan(step.datum.values[row])) continue;
    const likelihood::MeasuredSeries& measured = measurements_.series.at(sensors.scalars[k]);
    Json& entry = record[sensors.scalars[k]];
    if (entry.is_null()) entry = {{"units", measured.units}, {"std", measured.std.value_or(0)}};
    entry["step"].push_back(step.result.step);
    entry["measured"].push_back(step.datum.values[row]);
    entry["predicted"].push_back(expected[row]);
  }
}

/// E[M(p)] under the posterior of a step.
Eigen::VectorXd ResultsWriter::expected_at(const KeptStep& step) const {
  const auto& functions = *observed_->functions;
  model::FunctionBatch batch;
  batch.resize(step.result.points.rows(), functions.dimension(), functions.count(), 0);
  functions.evaluate(step.result.points, 0, batch);
  return observed_->lift.col(step.datum.time_index) +
         observed_->space * (observed_->core[step.datum.time_index] *
                             (batch.value.transpose() * step.result.weights).eval());
}

/// What errors beside the noise and the model explain of a datum: those of its step, and those that all data
/// have together; empty without any.
Eigen::VectorXd ResultsWriter::error_beside(const assimilation::StepResult& result,
                                            const likelihood::Datum& datum) const {
  Eigen::VectorXd error;
  if (!result.lasting_errors.empty())
    error = assimilation::expected_error(measurements_.noise.lasting(), result.update.step,
                                         result.lasting_errors);
  if (const Eigen::MatrixXd* factor = measurements_.noise.step_error(result.update.step)) {
    if (error.size() == 0) error.setZero(datum.values.size());
    error += likelihood::expected_step_error(datum.values - expected_at(steps_.back()) - error, *datum.noise,
                                             *factor);
  }
  return error;
}

/// What the model leaves unexplained (Rubio et al. 2019, Eq. 16): datum − E[M(p)] under the posterior that
/// has it, less the errors of the step that are not the model's (a motion); per step over all sensors, and
/// per sensor over the last steps.
Json ResultsWriter::residuals() const {
  constexpr std::size_t k_averaged = 10;
  if (!observed_ || steps_.empty()) return nullptr;
  const Eigen::Index n = measurements_.values.rows();
  Json step = Json::array(), rms = Json::array(), noise_rms = Json::array();
  std::vector<double> measured, predicted;
  Json series = Json::object();
  const Eigen::VectorXd all_noise = measurements_.noise.measurement().standard_deviations();
  Eigen::ArrayXd sum = Eigen::ArrayXd::Zero(n), count = Eigen::ArrayXd::Zero(n);
  for (std::size_t i = 0; i < steps_.size(); ++i) {
    Eigen::VectorXd expected = expected_at(steps_[i]);
    if (steps_[i].error.size() > 0) expected += steps_[i].error;
    add_series(series, steps_[i], expected);
    const Eigen::ArrayXd residual = measurements_.values.col(i) - expected.head(n);
    const auto present = !residual.isNaN();
    const Eigen::ArrayXd there = present.select(residual, 0.0);
    const double number = std::max<double>(1, present.count());
    const likelihood::GaussianNoise& own = *steps_[i].datum.noise;  // where correlated, too slow step by step
    const Eigen::VectorXd noise_std = own.is_independent() ? own.standard_deviations() : all_noise;
    const Eigen::ArrayXd noise = noise_std.head(n);
    step.push_back(steps_[i].result.step);
    rms.push_back(std::sqrt(there.square().sum() / number));
    noise_rms.push_back(std::sqrt(present.select(noise, 0.0).square().sum() / number));
    if (i + 1 == steps_.size()) {
      const auto column = measurements_.values.col(i);
      for (Eigen::Index j = 0; j < n; ++j)
        if (present[j]) measured.push_back(column[j]), predicted.push_back(column[j] - residual[j]);
    }
    if (i + k_averaged < steps_.size()) continue;
    sum += there;
    count += present.cast<double>();
  }
  Json record = Json::object();
  if (!series.empty()) record["series"] = std::move(series);
  if (n == 0) return record;
  const Eigen::VectorXd mean = sum / count.max(1);
  std::string components;
  std::vector<double> x, y;
  for (Eigen::Index j = 0; j < n; ++j) {
    components.push_back("xyz"[measurements_.sensors.components[j]]);
    x.push_back(measurements_.sensors.point(j)[0]);
    y.push_back(measurements_.sensors.point(j)[1]);
  }
  record.update({{"step", step},
                 {"step_rms", rms},
                 {"noise_rms", noise_rms},
                 {"measured", measured},
                 {"predicted", predicted},
                 {"averaged", std::min(k_averaged, steps_.size())},
                 {"component", components},
                 {"x", x},
                 {"y", y},
                 {"mean", to_json(mean)}});
  return record;
}

void ResultsWriter::write_summary(const std::string& path, double elapsed_s) const {
  std::vector<std::size_t> untrusted;
  for (const KeptStep& kept : steps_)
    if (!kept.result.trusted) untrusted.push_back(kept.result.step);
  Json summary = {
      {"created_by", k_created_by},
      {"project", project_.text},
      {"project_file", project_.path},
      {"model", project_.model},
      {"model_path", std::filesystem::proximate(project_.model, std::filesystem::path(path).parent_path())},
      {"data", project_.data},
      {"seed", project_.method.seed},
      {"method", to_text(project_.method.kind)},
      {"form", to_text(project_.method.update.form)},
      {"parameters", parameter_summaries()},
      {"steps", steps_.size()},
      {"verdict", verdict_record(verdict())},
      {"untrusted", untrusted},
      {"elapsed_s", elapsed_s},
      {"machine", machine_record()}};
  for (std::size_t k = 0; k < priors_.size(); ++k) {
    const auto prior = posterior::marginal_density(priors_[k]);
    summary["prior_marginals"][model_.contents().axes[k].name] = {{"points", prior.points},
                                                                  {"density", prior.density}};
  }
  if (!steps_.empty()) summary["draws"] = last_draws();
  for (const assimilation::ForecastSpecification& f : project_.forecasts) {
    Json& entry = summary["forecasts"][f.name];
    entry = {{"quantity", to_text(f.quantity)}, {"horizon", f.horizon}};
    if (f.threshold) entry["threshold"] = *f.threshold;
    entry["unit"] = assimilation::forecast_units(model_.contents(), f);
    if (!f.output.empty()) entry["output"] = f.output;
  }
  if (const std::string& units = model_.contents().time_units; !units.empty()) summary["time_units"] = units;
  if (!refinement_.is_null()) summary["refinement"] = refinement_;
  for (const assimilation::InputShift& shift : input_shifts_)
    summary["input_errors"].push_back({{"input", shift.name},
                                       {"relative", shift.relative},
                                       {"limited", shift.is_limited},
                                       {"shift", to_json(shift.shift)},
                                       {"shift_std", to_json(shift.in_std)}});
  if (!scores_.empty()) summary["scores"] = score_records(scores_);
  if (Json left = residuals(); !left.is_null()) summary["residuals"] = std::move(left);
  if (Json curve = load_displacement(); !curve.is_null()) summary["load_displacement"] = std::move(curve);
  files::write_text_atomically(path, files::json_line(summary) + "\n");
}

void ResultsWriter::write_posterior(const std::string& path) const {
  const auto observed =
      observed_ ? observed_
                : std::make_shared<const model::ObservedModel>(model::observe(model_, measurements_.sensors));
  write_posterior_file(path, {project_.text, project_.method.seed, model_.contents().axes, priors_, *observed,
                              measurements_.sensors, measurements_.series, measurements_.noise.measurement(),
                              steps_, verdict()});
}

void ResultsWriter::write_fields(const std::string& folder) const {
  const model::ModelContents& contents = model_.contents();
  const model::FieldOnMesh mesh(contents, model_.where());
  const auto space = model::space_of(contents);
  const auto lift = model::lift_of(contents);
  model::FunctionBatch batch;
  std::vector<files::PvdEntry> series;
  for (const KeptStep& kept : steps_) {
    const Eigen::MatrixXd& points = kept.result.points;
    batch.resize(points.rows(), points.cols(), model_.functions()->count(), 0);
    model_.functions()->evaluate(points, 0, batch);
    const assimilation::FunctionMoments moments =
        assimilation::moments_of_functions(batch.value, kept.result.weights);
    const model::TimeWeights weights = model::interpolate_in_time(contents.time, kept.result.time);
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(lift.rows());
    Eigen::MatrixXd core = Eigen::MatrixXd::Zero(space.cols(), moments.mean.size());
    for (std::size_t k = 0; k < weights.index.size(); ++k) {
      if (weights.value[k] == 0) continue;
      core += weights.value[k] * model::core_of(contents, weights.index[k]);
      mean += weights.value[k] * lift.col(weights.index[k]);
    }
    mean += space * (core * moments.mean);
    // Cov[u] = U (C Cov[w] Cᵀ) Uᵀ: only its diagonal is wanted.
    const Eigen::MatrixXd small = core * moments.covariance * core.transpose();
    const Eigen::VectorXd std = (space * small).cwiseProduct(space).rowwise().sum().cwiseMax(0).cwiseSqrt();
    const std::string name = fmt::format("step_{:04}.vtu", kept.result.step);
    mesh.write({mesh.vectors("displacement_mean", std::span(mean.data(), mean.size())),
                mesh.vectors("displacement_std", std::span(std.data(), std.size()))},
               (std::filesystem::path(folder) / name).string(), kept.result.time);
    series.push_back({kept.result.time, name});
  }
  files::write_pvd(series, (std::filesystem::path(folder) / "posterior.pvd").string());
}

}  // namespace knothe::record
