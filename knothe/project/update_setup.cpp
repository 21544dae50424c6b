#include "knothe/project/update_setup.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>

#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/data/series_interpolation.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/model/reduced/known_parameter.hpp"
#include "knothe/model/reduced/parameter_order.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/project/observed_data.hpp"
#include "knothe/project/priors.hpp"

namespace knothe::project {
namespace {

void check_parameters(const Project& project, const std::vector<std::string>& model_names) {
  std::vector<std::string> names;
  for (const NamedPrior& parameter : project.parameters) names.push_back(parameter.name);
  for (const KnownParameter& parameter : project.known) names.push_back(parameter.name);
  for (const std::string& name : names) {
    if (std::find(model_names.begin(), model_names.end(), name) == model_names.end()) {
      throw project.error_at(
          "parameters." + name,
          fmt::format("\"{}\" is not a parameter of the model {}{}; it has {}", name, project.model,
                      did_you_mean(name, model_names), fmt::join(model_names, ", ")));
    }
  }
  for (const std::string& name : model_names) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw project.error_at("parameters",
                             fmt::format("[parameters] lacks a prior for \"{}\", a parameter of the model {}",
                                         name, project.model));
    }
  }
}

assimilation::UpdateOptions update_options(const MethodOptions& method) {
  assimilation::UpdateOptions options = method.update;
  options.kind = method.kind;
  options.samples = method.samples;
  options.map.seed = method.seed;
  if (method.unknown_noise_level)
    options.noise_level = likelihood::NoiseLevel(method.noise_level_shape, method.noise_level_scale);
  return options;
}

likelihood::RobustOptions robust_options(const MethodOptions& method) {
  return {method.gate, method.student_t ? method.degrees_of_freedom : 0};
}

/// What the project asks for, as far as it is known before the data are looked at.
assimilation::Features features_of(const Project& project) {
  using assimilation::Feature;
  assimilation::Features features = features_of(update_options(project.method));
  const likelihood::RobustOptions robust = robust_options(project.method);
  features |= assimilation::features_of(robust.gate, robust.degrees_of_freedom);
  add(features, Feature::truncation, project.method.truncation_error);
  add(features, Feature::clock, !project.clock.empty());
  add(features, Feature::known, !project.known.empty());
  add(features, Feature::candidates, !project.candidates.empty());
  add(features, Feature::verified, project.method.verify == ModelVerification::full_order);
  return features;
}

void refuse_conflicts(const Project& project, const assimilation::Features& features) {
  const assimilation::Conflict found = assimilation::find_conflict(features);
  if (found.message.empty()) return;
  if (found.key.empty()) throw UsageError(found.message);
  throw project.error_at(found.key == "parameters" ? "parameters." + project.known[0].name : found.key,
                         found.message);
}

/// The measurements' noise with the model's own error besides.
likelihood::NoiseModel noise_with_truncation(const Project& project, const model::SeparatedModel& model,
                                             const ObservedData& data) {
  std::vector<double> times;
  for (const std::size_t index : data.time_indices) times.push_back(data.observed->time[index]);
  return with_truncation(
      data.measurements.noise,
      model::observe_truncation(model::read_truncation_error(project.model), model.contents(), project.model,
                                data.measurements.sensors, sensors_of(project, data.measurements), times));
}

/// With the project's parameters in its order, then the known ones.
model::SeparatedModel load_whole_model(const Project& project) {
  const auto stored = model::SeparatedModel::load(project.model);
  check_parameters(project, stored.parameter_names());
  std::vector<std::string> names;
  for (const NamedPrior& parameter : project.parameters) names.push_back(parameter.name);
  for (const KnownParameter& parameter : project.known) names.push_back(parameter.name);
  model::SeparatedModel model(model::with_parameter_order(stored.contents(), names), project.model);
  return model;
}

/// The model with its known parameters at the project's values, or else at `last`.
model::SeparatedModel with_known_fixed(const Project& project, const model::SeparatedModel& whole,
                                       const Eigen::RowVectorXd& last) {
  if (project.known.empty()) return whole;
  model::ModelContents contents = whole.contents();
  for (std::size_t k = project.known.size(); k-- > 0;) {
    const KnownParameter& known = project.known[k];
    const std::vector<double>& nodes = contents.axes.back().nodes;
    if (!known.value && last.size() == 0) {
      throw project.error_at(
          "parameters." + known.name,
          fmt::format("[parameters.{}] needs \"value\" here: the data are not looked at", known.name));
    }
    const double value = known.value.value_or(last.size() == 0 ? 0 : last[k]);
    if (!(value >= nodes.front() && value <= nodes.back())) {
      throw project.error_at("parameters." + known.name + ".value",
                             fmt::format("parameters.{}.value = {} lies outside the model's axis, {} to {}",
                                         known.name, value, nodes.front(), nodes.back()));
    }
    contents = model::with_last_fixed(contents, value);
  }
  return model::SeparatedModel(std::move(contents), whole.where());
}

/// "No reading" is often written as a number, −9999 or 1e99. A wrong unit is smaller than that; it is for the
/// verdict.
void refuse_sentinels(const Project& project, const ObservedData& data) {
  constexpr double k_beyond_any_unit = 1e6;
  const likelihood::Measurements& m = data.measurements;
  likelihood::PlausibleRange range(*data.observed, m.sensors, m.noise.measurement().standard_deviations());
  range.widen(k_beyond_any_unit);
  for (Index t = 0; t < m.values.cols(); ++t) {
    const std::string complaint = range.complaint(m.values.col(t));
    if (!complaint.empty())
      throw DataError(
          fmt::format("{}: time {}: {}: a number that stands for \"no reading\"? Leave such fields "
                      "empty (CSV), or give the attribute _FillValue (HDF5)",
                      project.data, m.time[t], complaint));
  }
}

}  // namespace

model::SeparatedModel load_model(const Project& project) {
  return with_known_fixed(project, load_whole_model(project), {});
}

namespace {

/// Whether what is known has one value for all data: those that come one by one bring no other. Not for
/// models that are compared: those are read anew, with the recorded values.
bool is_fixed(const Project& project, const assimilation::Features& features) {
  return features[static_cast<std::size_t>(assimilation::Feature::service)] && project.candidates.empty() &&
         std::all_of(project.known.begin(), project.known.end(),
                     [](const KnownParameter& known) { return known.value.has_value(); });
}

/// The series that come one by one beside pictures, by one clock.
void announce_series(const Project& project, likelihood::Measurements& measurements) {
  const std::vector<double> nothing(measurements.time.size(), std::nan(""));
  std::optional<std::size_t> clock;
  for (const DataSource& source : project.sources) clock = add_clock(source, measurements);
  for (const auto& [name, std] : project.series_std)
    measurements.series[name] = {nothing, std, {}, "", nothing, clock};
}

/// `features`: what it is for.
UpdateSetup set_up(const Project& given, assimilation::Features features, bool live,
                   std::shared_ptr<PictureMeasurements> pictures = nullptr) {
  Project project = given;
  const bool fixed = is_fixed(given, features);
  if (fixed) project.known.clear();
  features |= features_of(project);
  refuse_conflicts(project, features);
  project.require(!project.model.empty(), "a model: `model = \"MODEL.h5\"`");
  const bool from_pictures =
      pictures || live || !project.pictures.folder.empty() || !project.pictures.pictures.empty();
  project.require(!project.data.empty() || from_pictures,
                  "data: `data = \"DATA.h5\"`, or `[data] pictures = \"FOLDER\"`");
  project.require(!project.parameters.empty(),
                  "a table [parameters] with a prior for each parameter of the model that is inferred");
  const model::SeparatedModel whole = fixed ? load_model(given) : load_whole_model(given);
  const std::vector<posterior::Prior> priors = priors_of(project, whole.contents().axes);
  if (live && !project.data.empty()) {
    const char* const key = project.serve.camera.wanted ? "serve.camera" : "serve.watch_pictures";
    throw project.error_at(
        key, fmt::format("\"{}\" and \"data.file\" both say where the sensors are: give one", key));
  }
  const bool recorded = std::any_of(project.sources.begin(), project.sources.end(),
                                    [](const DataSource& source) { return !source.file.empty(); });
  if (live && recorded)
    throw project.error_at("data.sources",
                           "[data.sources] are recorded files: beside pictures that are still "
                           "to come [data.std] names the series, which come one by one");
  if (!pictures && (project.data.empty() || !project.pictures.folder.empty()))
    pictures = std::make_shared<PictureMeasurements>(project, whole, live);
  likelihood::Measurements measurements =
      pictures ? pictures->measurements() : read_recorded(project, whole.contents());
  // Data that come one by one may be of any time of the model, and each of these is a step.
  if (features[static_cast<std::size_t>(assimilation::Feature::service)])
    measurements = likelihood::at_times(std::move(measurements), whole.contents().time);
  if (live)
    announce_series(project, measurements);
  else if (pictures && project.sources.empty() && !project.series_std.empty())
    throw project.error_at("data.std",
                           "[data.std] is of the series of data.file, or of those sent to `knothe serve` "
                           "beside pictures: there are none");
  else
    add_sources(project, measurements);
  if (fixed)
    for (const KnownParameter& known : given.known) measurements.series.erase(known.name);
  if (project.method.offset_std > 0)
    measurements.noise = measurements.noise.with_offsets(project.method.offset_std);
  ObservedData data = observe_data(project, whole, priors, std::move(measurements),
                                   project.data.empty() ? project.pictures.folder : project.data);
  if (project.method.truncation_error) data.measurements.noise = noise_with_truncation(project, whole, data);
  refuse_conflicts(project, features | assimilation::features_of(data.measurements.noise));
  if (!pictures) refuse_sentinels(project, data);
  assimilation::Problem problem{
      std::move(data.observed),       data.measurements.noise,        std::move(priors),
      update_options(project.method), robust_options(project.method), std::nullopt};
  Eigen::RowVectorXd last(data.known.cols());
  if (last.size() > 0) last = data.known.row(data.known.rows() - 1);
  return {with_known_fixed(project, whole, last),
          std::move(data.measurements),
          std::move(problem),
          std::move(data.time_indices),
          std::move(pictures),
          std::move(data.unused),
          std::move(data.known)};
}

}  // namespace

UpdateSetup set_up(const Project& project) {
  return set_up(project, {}, false);
}

UpdateSetup set_up_again(const Project& project, std::shared_ptr<PictureMeasurements> pictures, bool online) {
  assimilation::Features features;
  add(features, assimilation::Feature::service, online);
  return set_up(project, features, online && project.serve.takes_pictures(), std::move(pictures));
}

UpdateSetup set_up_online(const Project& project) {
  assimilation::Features features;
  add(features, assimilation::Feature::service);
  return set_up(project, features, project.serve.takes_pictures());
}

namespace {

/// Messages of forecasts and decisions begin with their table, "[forecast.NAME]": at its place in the file.
template <class Make>
auto at_its_table(const Project& project, const char* otherwise, const Make& make) {
  try {
    return make();
  } catch (const ProjectError& error) {
    const std::string text = error.what();
    throw project.error_at(text.starts_with("[") ? text.substr(1, text.find(']') - 1) : otherwise, text);
  }
}

/// The model at the sensors at its own times, whatever the times of the data.
std::shared_ptr<const model::ObservedModel> at_own_times(const Project& project, const UpdateSetup& setup) {
  if (setup.problem.model->time == setup.model.contents().time) return setup.problem.model;
  const model::Sensors& sensors = setup.measurements.sensors;
  return std::make_shared<const model::ObservedModel>(model::with_scalars(
      model::observe(setup.model, sensors), setup.model, sensors_of(project, setup.measurements)));
}

}  // namespace

assimilation::Forecaster make_forecaster(const Project& project, const UpdateSetup& setup) {
  return at_its_table(project, "forecast", [&] {
    return assimilation::Forecaster(setup.model, setup.measurements.sensors, project.forecasts);
  });
}

std::optional<assimilation::Decider> make_decider(const Project& project, const UpdateSetup& setup) {
  if (!project.decide) return std::nullopt;
  return at_its_table(project, "decide", [&]() -> std::optional<assimilation::Decider> {
    const auto observed = at_own_times(project, setup);
    const auto priors = likelihood::truncated_to_box(*observed, setup.problem.priors)->priors();
    Eigen::VectorXd prior_std(std::ssize(priors));
    for (Index a = 0; a < prior_std.size(); ++a) prior_std[a] = priors[a].std();
    return assimilation::Decider(setup.model, observed, setup.measurements.sensors,
                                 setup.measurements.noise.measurement(), prior_std, project.forecasts,
                                 *project.decide);
  });
}

likelihood::PlausibleRange serve_limits(const Project& project, const UpdateSetup& setup) {
  const model::Sensors& sensors = setup.measurements.sensors;
  likelihood::PlausibleRange range(*setup.problem.model, sensors,
                                   setup.measurements.noise.measurement().standard_deviations());
  std::vector<std::string> names = {"displacement"};
  names.insert(names.end(), sensors.scalars.begin(), sensors.scalars.end());
  for (const auto& [name, limit] : project.serve.limits) {
    const std::size_t place = std::find(names.begin(), names.end(), name) - names.begin();
    if (place == names.size())
      throw project.error_at("serve.limits." + name,
                             fmt::format("\"{}\" in [serve.limits] is not measured{}; there are: {}", name,
                                         did_you_mean(name, names), fmt::join(names, ", ")));
    place == 0 ? range.limit_displacements(limit) : range.limit_scalar(place - 1, limit);
  }
  return range;
}

likelihood::GaussianNoise with_series_noise(const likelihood::GaussianNoise& of_picture,
                                            const likelihood::Measurements& measurements) {
  const Eigen::Index series = measurements.noise.scalar_count();
  if (series == 0) return of_picture;
  return of_picture.with_independent(measurements.noise.measurement().standard_deviations().tail(series));
}

likelihood::NoiseModel with_truncation(const likelihood::NoiseModel& noise,
                                       const model::ObservedTruncation& error) {
  constexpr Eigen::Index k_max_rows = 1000;
  likelihood::NoiseModel result = noise;
  for (Eigen::Index i = 0; i < std::ssize(error.factors); ++i) {
    const Eigen::VectorXd left_out = error.left_out.col(i);
    const likelihood::GaussianNoise& own = noise.at_step(i);
    result = result.with_step_error(i, error.factors[i]);
    if (left_out.isZero(0)) continue;
    if (own.is_independent()) {
      const Eigen::VectorXd variance = own.standard_deviations().cwiseAbs2() + left_out;
      result = result.with_step(i, likelihood::GaussianNoise::independent(variance.cwiseSqrt()));
      continue;
    }
    if (noise.size() > k_max_rows)
      throw UsageError(fmt::format(
          "truncation_error = \"on\": {} observed dofs with correlated noise are more than {}: choose some "
          "(`knothe select`)",
          noise.size(), k_max_rows));
    result = result.with_step_error(i, Eigen::MatrixXd(left_out.cwiseSqrt().asDiagonal()));
  }
  return result;
}

}  // namespace knothe::project
