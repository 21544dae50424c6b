#include "knothe/project/inference_setup.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/model/forward/separated_forward_model.hpp"
#include "knothe/model/forward/umbridge_model.hpp"
#include "knothe/project/observed_data.hpp"
#include "knothe/project/priors.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {
namespace {

using assimilation::Observations;
using likelihood::GaussianNoise;

Observations observations_of(const ObservationOptions& o) {
  const auto n = std::ssize(o.values);
  const Eigen::VectorXd values = Eigen::Map<const Eigen::VectorXd>(o.values.data(), n);
  if (o.covariance.empty())
    return {values, GaussianNoise::independent(Eigen::Map<const Eigen::VectorXd>(o.std.data(), n))};
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    covariance.row(i) = Eigen::Map<const Eigen::RowVectorXd>(o.covariance[i].data(), n);
  return {values, GaussianNoise::of_covariance(0.5 * (covariance + covariance.transpose()))};
}

void set_up_server(const Project& project, InferenceSetup& setup) {
  const UmbridgeOptions& o = project.umbridge;
  if (!o.density)
    project.require(project.observations.has_value(),
                    "a table [observations] (only a model of kind = \"density\" does without)");
  if (project.observations && (!project.observations->dofs.empty() || !project.observations->steps.empty() ||
                               !project.observations->output.empty()))
    throw project.error_at("observations",
                           "\"dofs\", \"steps\" and \"output\" choose from a separated model; all outputs of "
                           "a UM-Bridge model are observed, in their order");
  setup.priors = priors_of(project);
  model::UmbridgeSettings settings = o;
  settings.parameters = setup.parameters;
  std::unique_ptr<model::UmbridgeModel> model;
  try {
    model = std::make_unique<model::UmbridgeModel>(settings);
  } catch (const UsageError& error) {  // the address
    throw project.error_at("model.umbridge", error.what());
  }
  if (model->dimension() != std::ssize(setup.parameters))
    throw project.error_at(
        "parameters", fmt::format("[parameters] has {} parameters, but {} takes {} values (input sizes {})",
                                  setup.parameters.size(), model->where(), model->dimension(),
                                  fmt::join(model->input_sizes(), ", ")));
  if (o.density && model->output_count() != 1)
    throw project.error_at(
        "model.kind",
        fmt::format("model.kind = \"density\" means one number, but {} returns {} (output sizes {})",
                    model->where(), model->output_count(), fmt::join(model->output_sizes(), ", ")));
  for (const std::string& name : setup.parameters) setup.axes.push_back({name, {}, "", "", 1});
  setup.model = std::move(model);
}

/// The values of [observations], of dofs or of an output at time steps.
void set_up_chosen(const Project& project, const model::SeparatedModel& model, InferenceSetup& setup) {
  const ObservationOptions& o = *project.observations;
  if (o.steps.empty())
    throw project.error_at("observations",
                           "[observations] of a separated model needs \"steps\", the time steps observed");
  if (o.dofs.empty() && o.output.empty())
    throw project.error_at(
        "observations",
        "[observations] of a separated model needs \"dofs\" or \"output\": what was observed");
  try {
    setup.model = std::make_unique<model::SeparatedForwardModel>(
        o.output.empty() ? model::observe_dofs(model, o.dofs) : model::observe_output(model, o.output),
        o.steps, model.where());
  } catch (const UsageError& error) {
    const std::string text = error.what();
    throw project.error_at(text.find("step") != std::string::npos ? "observations.steps"
                           : o.output.empty()                     ? "observations.dofs"
                                                                  : "observations.output",
                           text);
  }
}

/// All values of a data file, displacements and series, step after step, with the errors that they share.
void set_up_recorded(const Project& project, const model::SeparatedModel& model, InferenceSetup& setup) {
  likelihood::Measurements recorded = read_recorded(project, model.contents());
  add_sources(project, recorded);
  Project inferred = project;  // what is known is in the model
  for (const KnownParameter& known : project.known) recorded.series.erase(known.name);
  inferred.known.clear();
  const ObservedData all = observe_data(inferred, model, setup.priors, std::move(recorded), project.data);
  const likelihood::Measurements& data = all.measurements;
  const Eigen::Index n = data.values.rows();
  const Eigen::VectorXd centre =
      likelihood::medians(*likelihood::truncated_to_box(*all.observed, setup.priors));
  Eigen::MatrixXd predicted(n, data.values.cols());
  std::vector<Eigen::Index> present;
  for (Eigen::Index t = 0; t < data.values.cols(); ++t) {
    predicted.col(t) = all.observed->predict(centre, all.time_indices[t]);
    for (Eigen::Index i = 0; i < n; ++i)
      if (!std::isnan(data.values(i, t)) && data.noise.at_step(t).is_measured(i))
        present.push_back(t * n + i);
  }
  if (present.empty())
    throw DataError(project.data + ": nothing is measured of what the model predicts: no value with a std");
  auto observed =
      std::make_unique<model::SeparatedForwardModel>(*all.observed, all.time_indices, model.where());
  observed->restrict_to(present);
  setup.model = std::move(observed);
  setup.observations = Observations{data.values.reshaped()(present),
                                    likelihood::joint_noise(data.noise, data.values, predicted)};
}

void set_up_separated(const Project& project, InferenceSetup& setup) {
  const model::SeparatedModel model = load_model(project);
  setup.axes = model.contents().axes;
  setup.priors = priors_of(project, setup.axes);
  if (project.observations)
    set_up_chosen(project, model, setup);
  else
    set_up_recorded(project, model, setup);
}

}  // namespace

InferenceSetup set_up_inference(const Project& project) {
  const bool server = !project.umbridge.url.empty();
  project.require(server || !project.model.empty(),
                  "a model: [model] with \"umbridge\", a server's address, or \"separated\", a file");
  project.require(!project.parameters.empty(), "a table [parameters] with a prior for each parameter");
  project.require(server || project.observations || !project.data.empty(),
                  "observations: a table [observations], or `data = \"DATA.h5\"`");
  if (project.observations && !project.data.empty())
    throw project.error_at("observations",
                           "[observations] and `data` both say what was observed: leave one of them out");
  InferenceSetup setup;
  for (const NamedPrior& parameter : project.parameters) setup.parameters.push_back(parameter.name);
  if (server)
    set_up_server(project, setup);
  else
    set_up_separated(project, setup);
  if (!project.observations || project.umbridge.density) return setup;
  if (setup.model->output_count() != std::ssize(project.observations->values))
    throw project.error_at(
        "observations.values",
        fmt::format("{} values were observed, but {} returns {}", project.observations->values.size(),
                    setup.model->where(), setup.model->output_count()));
  setup.observations = observations_of(*project.observations);
  return setup;
}

assimilation::InferenceOptions inference_options(const Project& project, posterior::Method method) {
  assimilation::InferenceOptions options;
  options.method = method;
  options.map = project.method.update.map;
  options.map.seed = project.method.seed;
  options.map.verification_points = project.method.verification_points;
  options.map.search_modes = project.method.mode_search;
  options.samples = project.method.samples;
  options.evaluations = project.method.evaluations;
  options.seconds = project.method.seconds;
  options.seed = project.method.seed;
  for (const NamedPrior& parameter : project.parameters) options.names.push_back(parameter.name);
  return options;
}

}  // namespace knothe::project
