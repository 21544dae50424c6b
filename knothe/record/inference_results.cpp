#include "knothe/record/inference_results.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/files/netcdf.hpp"
#include "knothe/posterior/map/map_file.hpp"
#include "knothe/posterior/quadrature/marginal_density.hpp"
#include "knothe/record/fields.hpp"
#include "knothe/record/json_values.hpp"
#include "knothe/record/physical_parameters.hpp"
#include "knothe/record/prior_values.hpp"

namespace knothe::record {
namespace {

using Json = nlohmann::ordered_json;
using assimilation::InferenceResult;

constexpr const char* k_map_file = "map.h5";
constexpr Eigen::Index k_parts_of_draws = 4;  ///< as chains, where draws are independent: r̂ compares chains
constexpr Eigen::Index k_shown_draws = 700;   ///< in the report's figures
constexpr Eigen::Index k_max_observations = 10000;  ///< more are not drawn

Json columns_of(const Eigen::MatrixXd& m) {
  return rows_of(m.transpose());
}

Json density_of(const posterior::MarginalDensity& density) {
  return {{"points", density.points}, {"density", density.density}};
}

/// Every parameter's marginal, seen by weighted points.
Json marginals_of(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights,
                  const std::vector<posterior::Prior>& priors) {
  Json all = Json::array();
  for (Eigen::Index k = 0; k < points.cols(); ++k)
    all.push_back(density_of(posterior::marginal_density(points.col(k), weights, priors[k])));
  return all;
}

Eigen::MatrixXd some_of(const Eigen::MatrixXd& draws) {
  const Eigen::Index n = std::min(k_shown_draws, draws.rows());
  return draws(Eigen::seqN(0, n, std::max<Eigen::Index>(1, draws.rows() / n)), Eigen::all);
}

/// The observations beside their prediction at the most probable parameters: the residuals in standard
/// deviations of the measurement; values where all of them are of one kind, as those of [observations].
Json observations_of(const assimilation::Observations& observations, const Eigen::VectorXd& predicted,
                     bool of_one_kind) {
  const Eigen::VectorXd std = observations.noise.measurement_std();
  Json record = {{"residual", to_json((observations.values - predicted).cwiseQuotient(std))}};
  if (of_one_kind)
    record.update({{"measured", to_json(observations.values)},
                   {"predicted", to_json(predicted)},
                   {"std", to_json(std)}});
  return record;
}

/// What the page of `knothe report` draws.
Json figures_of(const project::Project& project, const project::InferenceSetup& setup,
                const InferenceResult& r) {
  Json figures;
  if (r.predicted.size() > 0 && r.predicted.size() <= k_max_observations)
    figures["observations"] =
        observations_of(*setup.observations, r.predicted, project.observations.has_value());
  figures["posterior"] = marginals_of(r.points, r.weights, setup.priors);
  if (setup.observations) {
    for (const posterior::Prior& prior : setup.priors)
      figures["prior"].push_back(density_of(posterior::marginal_density(prior)));
  }
  figures["draws"] = columns_of(some_of(r.draws));
  if (r.map.empty()) return figures;
  const assimilation::MapDetails& map = r.map.front();
  const Eigen::Index n = map.draws_of_map.rows();
  figures["map"] = marginals_of(map.draws_of_map, Eigen::VectorXd::Constant(n, 1.0 / n), setup.priors);
  // The first of them: every other point of a Sobol sequence lies in one half of the plane.
  figures["map_draws"] = columns_of(map.draws_of_map.topRows(std::min(k_shown_draws, n)));
  const std::vector<posterior::Prior> reference(setup.priors.size(), posterior::Prior::normal(0, 1));
  figures["pull_back"] = marginals_of(map.pulled_back, map.weights, reference);
  // The same points without their weights: a standard normal under the same smoothing.
  const Eigen::Index m = map.weights.size();
  figures["reference"] = marginals_of(map.pulled_back, Eigen::VectorXd::Constant(m, 1.0 / m), reference);
  figures["pull_back_draws"] = columns_of(numerics::resample(map.pulled_back, map.weights, k_shown_draws, 1));
  figures["diagnostic_by_order"] = map.map.diagnostic_by_order;
  figures["objective_by_order"] = map.map.objective_by_order;
  figures["training_diagnostic"] = map.map.training_diagnostic;
  figures["map_method"] = map.map.method;
  return figures;
}

/// n × d to C order.
std::vector<double> c_order(const Eigen::MatrixXd& m) {
  std::vector<double> out;
  out.reserve(m.size());
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index k = 0; k < m.cols(); ++k) out.push_back(m(i, k));
  return out;
}

void write_samples(const std::string& path, const project::Project& project,
                   const project::InferenceSetup& setup, const InferenceResult& r) {
  using Names = std::vector<std::string>;
  files::write_atomically(path, [&](const std::string& temporary) {
    files::NetcdfWriter out(temporary);
    add_draws("posterior", setup.axes, r.draws, r.chains > 1 ? r.chains : k_parts_of_draws, out);
    out.add_dimension("weighted_posterior", "point", r.points.rows());
    out.add_dimension("weighted_posterior", "parameter", setup.parameters, {"1", "parameter"});
    out.add_variable("weighted_posterior", "points", Names{"point", "parameter"}, c_order(r.points),
                     {"1", "points"});
    out.add_variable("weighted_posterior", "weights", Names{"point"},
                     std::span(r.weights.data(), r.weights.size()), {"1", "weights, sum 1"});
    if (setup.observations) add_prior_values("weighted_posterior", setup.priors, r.points, out);
    out.add_attribute("weighted_posterior", "parameters",
                      fmt::format("{}", fmt::join(setup.parameters, ",")));
    out.add_dimension("history", "step", std::vector<std::int64_t>{0}, {"", "step"});
    add_statistics("history", r, out);
    add_creator({"posterior"}, out);
    out.add_attribute("", "title", "Bayesian inference: posterior of the parameters");
    out.add_attribute("", "created_by", k_created_by);
    out.add_attribute("", "method", assimilation::to_text(r.method));
    out.add_attribute("", "seed", std::to_string(project.method.seed));
    out.add_attribute("", "project", project.text);
    out.close();
  });
}

/// The map as it was found, from the reference to standardised parameters, with what is needed to go on to
/// the parameters themselves: p_k = F_k⁻¹(Φ(z_k)), F_k the distribution function of prior k. A map of an
/// earlier run is taken away where this one has none.
void write_map(const std::string& path, const project::Project& project, const project::InferenceSetup& setup,
               const InferenceResult& r) {
  if (r.map.empty()) {
    std::error_code none;
    std::filesystem::remove(path, none);
    return;
  }
  posterior::MapMetadata metadata = {{"parameters", fmt::format("{}", fmt::join(setup.parameters, ","))},
                                     {"model", setup.model->where()},
                                     {"project", project.text},
                                     {"verdict", r.verdict},
                                     {"log_evidence", fmt::format("{:.17g}", r.log_evidence)}};
  for (std::size_t k = 0; k < setup.priors.size(); ++k)
    metadata["prior of " + setup.parameters[k]] = setup.priors[k].describe();
  posterior::save_map(path, r.map.front().map.composed(), metadata);
}

}  // namespace

Json inference_record(const InferenceResult& r, std::span<const model::Axis> axes,
                      const std::string& samples_file) {
  double model_seconds = 0;
  for (const assimilation::PhaseTime& phase : r.phases) model_seconds += phase.model_seconds;
  Json record = fields_record(r);
  record["parameters"] = parameter_names(axes);
  record["wall_clock"] = utc_text(std::chrono::system_clock::now());
  record["verdict"] = r.verdict;
  record["computation"] = r.computation;
  record["doubts"] = r.doubts;
  record["model_evaluations"] = r.calls.evaluations;
  record["model_calls"] = {{"evaluate", r.calls.evaluations},
                           {"gradient", r.calls.gradients},
                           {"apply_jacobian", r.calls.jacobians},
                           {"apply_hessian", r.calls.hessians}};
  record["elapsed_us"] = {
      {"update", r.seconds() * 1e6}, {"total", r.seconds() * 1e6}, {"model", model_seconds * 1e6}};
  record["samples_file"] = samples_file;
  record["physical"] = physical_record(axes, r.mean, r.covariance);
  if (r.fit_probability) record["fit_probability"] = *r.fit_probability;
  if (r.r_hat.size() > 0) {
    record["r_hat"] = to_json(r.r_hat);
    record["effective_sizes"] = to_json(r.effective_sizes);
    record["std_errors"] = to_json(r.std_errors);
    record["acceptance"] = r.acceptance;
  }
  if (!r.temperatures.empty()) record["temperatures"] = r.temperatures;
  if (!r.map.empty())
    record["map_file"] = (std::filesystem::path(samples_file).parent_path() / k_map_file).string();
  if (!r.warnings.empty()) record["warnings"] = r.warnings;
  return record;
}

Json comparison_record(const assimilation::Comparison& c, const std::string& first,
                       const std::string& second) {
  return {
      {"comparison",
       {{"methods", {first, second}},
        {"mean_difference", to_json(c.mean_difference)},
        {"std_ratio", to_json(c.std_ratio)},
        {"quantile_difference",
         {{"levels", numerics::k_quantile_levels}, {"values", rows_of(c.quantile_difference)}}},
        {"log_evidence_difference", c.log_evidence_difference},
        {"log_evidence_error", c.log_evidence_error},
        {"agreement", c.contradict() ? "contradict" : "agree"},
        {"limits", {{"mean", c.mean_limit}, {"std", c.std_limit}, {"log_evidence", c.log_evidence_limit}}}}}};
}

std::string samples_path(const std::string& folder) {
  return (std::filesystem::path(folder) / "samples.nc").string();
}

void write_inference(const std::string& folder, const project::Project& project,
                     const project::InferenceSetup& setup, const InferenceResult& r) {
  const std::string samples = samples_path(folder);
  write_samples(samples, project, setup, r);
  write_map((std::filesystem::path(folder) / k_map_file).string(), project, setup, r);
  Json content = inference_record(r, setup.axes, samples);
  content["created_by"] = k_created_by;
  content["project"] = project.text;
  content["seed"] = project.method.seed;
  content["tolerance"] = project.method.update.map.tolerance;
  content["model"] = setup.model->where();
  for (const posterior::Prior& prior : setup.priors) {
    content["priors"].push_back(prior.describe());
    content["supports"].push_back(support_of(prior));
  }
  for (const assimilation::PhaseTime& phase : r.phases)
    content["phases"].push_back(
        {{"name", phase.name}, {"seconds", phase.seconds}, {"model_seconds", phase.model_seconds}});
  content["figures"] = figures_of(project, setup, r);
  files::write_text_atomically((std::filesystem::path(folder) / "inference.json").string(),
                               files::json_line(content) + "\n");
}

}  // namespace knothe::record
