#include "knothe/library/assimilation.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/engine/engine.hpp"
#include "knothe/library/plain.hpp"
#include "knothe/reduction/model/parameter_order.hpp"
#include "knothe/reduction/model/separated_model.hpp"
#include "knothe/reduction/model/truncation_error.hpp"

namespace knothe {

using library::plain, library::vector_of;

namespace {

assimilation::Prior prior_of(const Prior& prior) {
  switch (prior.family) {
    case Prior::Family::uniform:
      return assimilation::Prior::uniform(prior.first, prior.second);
    case Prior::Family::lognormal:
      return assimilation::Prior::lognormal(prior.first, prior.second);
    case Prior::Family::normal:
      break;
  }
  return assimilation::Prior::normal(prior.first, prior.second);
}

Eigen::SparseMatrix<double> matrix_of(const Noise::Precision& precision) {
  const auto n = static_cast<Eigen::Index>(precision.row_begin.size()) - 1;
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t row = 0; row + 1 < precision.row_begin.size(); ++row)
    for (std::int64_t i = precision.row_begin[row]; i < precision.row_begin[row + 1]; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (at >= precision.values.size() || at >= precision.columns.size() || precision.columns[at] < 0 ||
          precision.columns[at] >= n)
        throw UsageError(fmt::format(
            "noise: the precision's entry {} of row {} is outside the {} x {} matrix", i, row, n, n));
      entries.emplace_back(static_cast<int>(row), static_cast<int>(precision.columns[at]),
                           precision.values[at]);
    }
  Eigen::SparseMatrix<double> matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

assimilation::GaussianNoise noise_of(const Noise& noise, std::size_t sensors) {
  const std::size_t size =
      noise.precision.row_begin.empty() ? noise.std.size() : noise.precision.row_begin.size() - 1;
  if (size != sensors || (!noise.std.empty() && !noise.precision.row_begin.empty()))
    throw UsageError(
        fmt::format("noise of {} values for {} sensors: give one standard deviation each, or their precision",
                    size, sensors));
  return noise.std.empty() ? assimilation::GaussianNoise::correlated(matrix_of(noise.precision))
                           : assimilation::GaussianNoise::independent(vector_of(noise.std));
}

Verdict verdict_of(const assimilation::Verdict& verdict) {
  const auto level = [](assimilation::VerdictLevel l) { return static_cast<Verdict::Level>(l); };
  Verdict result{level(verdict.level), {}};
  for (const assimilation::VerdictReason& reason : verdict.reasons)
    result.reasons.push_back({to_text(reason.part), level(reason.level), reason.message});
  return result;
}

/// An engine without noise and priors: the model at the sensors, its parameters in the order of the priors,
/// and its own error there.
engine::EngineSetup observe(const std::string& file, const Sensors& sensors,
                            const std::vector<Prior>& priors) {
  if (sensors.size() == 0 || sensors.points.size() != 3 * sensors.size())
    throw UsageError(fmt::format("{} sensors with {} coordinates: each has a component and a point x, y, z",
                                 sensors.size(), sensors.points.size()));
  std::vector<std::string> names;
  for (const Prior& prior : priors) names.push_back(prior.parameter);
  const reduction::SeparatedModel model(reduction::with_parameter_order(reduction::read_model(file), names),
                                        file);
  const reduction::Dofs places{sensors.points, {sensors.components.begin(), sensors.components.end()}};
  engine::EngineSetup setup;
  setup.sensors = reduction::Sensors(places);
  setup.known_errors =
      reduction::observe_off_grid(reduction::read_truncation_error(file), model.contents(), file, places,
                                  model.contents().time, static_cast<Eigen::Index>(sensors.size()));
  setup.model = std::make_shared<reduction::ObservedModel>(reduction::observe(model, places));
  return setup;
}

std::vector<assimilation::Prior> densities_of(const std::vector<Prior>& priors) {
  std::vector<assimilation::Prior> densities;
  std::transform(priors.begin(), priors.end(), std::back_inserter(densities), prior_of);
  return densities;
}

assimilation::UpdateOptions settings_of(const AssimilationOptions& options) {
  assimilation::UpdateOptions settings;
  settings.map.tolerance = options.tolerance;
  settings.map.max_order = options.max_order;
  settings.map.seed = options.seed;
  return settings;
}

}  // namespace

struct Assimilation::Implementation {
  engine::Engine engine;

  Implementation(engine::EngineSetup setup, const Noise& noise, const std::vector<Prior>& priors,
                 const AssimilationOptions& options)
      : engine([&] {
          setup.noise = noise_of(noise, static_cast<std::size_t>(setup.model->observations()));
          setup.priors = densities_of(priors);
          setup.update = settings_of(options);
          return setup;
        }()) {}

  /// The posterior of all data.
  [[nodiscard]] Posterior posterior() {
    const auto last = engine.last_step();
    if (!last) return {};
    const assimilation::UpdateResult result = engine.conclude(*last).update;
    Posterior p;
    p.mean = plain(result.mean);
    p.covariance = plain(result.covariance);
    p.maximum_a_posteriori = plain(result.maximum_a_posteriori);
    p.levels.assign(numerics::k_quantile_levels.begin(), numerics::k_quantile_levels.end());
    p.quantiles = plain(result.quantiles);
    p.points = plain(result.points);
    p.weights = plain(result.weights);
    p.log_evidence = result.log_evidence;
    p.map_order = result.map_order;
    p.variance_diagnostic = result.variance_diagnostic;
    p.effective_sample_size = result.effective_sample_size;
    p.tolerance_reached = result.tolerance_reached;
    p.trusted = result.trusted;
    p.remark = result.remark;
    p.verdict = verdict_of(result.verdict);
    return p;
  }
  void require_step(std::size_t step) const {
    const std::size_t steps = engine.model().time.size();
    if (step >= steps)
      throw UsageError(fmt::format("step {}: the model has the steps 0 to {}", step, steps - 1));
  }
};

Assimilation::Assimilation(const std::string& model_file, const Sensors& sensors, const Noise& noise,
                           const std::vector<Prior>& priors, const AssimilationOptions& options)
    : implementation_(
          std::make_unique<Implementation>(observe(model_file, sensors, priors), noise, priors, options)) {}
Assimilation::~Assimilation() = default;
Assimilation::Assimilation(Assimilation&&) noexcept = default;
Assimilation& Assimilation::operator=(Assimilation&&) noexcept = default;

std::vector<double> Assimilation::times() const {
  return implementation_->engine.model().time;
}
std::vector<std::size_t> Assimilation::steps() const {
  return implementation_->engine.steps();
}

std::vector<double> Assimilation::predict(std::span<const double> p, std::size_t step) const {
  implementation_->require_step(step);
  const std::size_t dimension = implementation_->engine.model().parameters.size();
  if (p.size() != dimension)
    throw UsageError(fmt::format("prediction at {} parameters: the model has {}", p.size(), dimension));
  return plain(implementation_->engine.model().predict(vector_of(p), step));
}

Posterior Assimilation::assimilate(const Datum& datum) {
  implementation_->require_step(datum.step);
  const auto sensors = static_cast<std::size_t>(implementation_->engine.model().observations());
  if (datum.values.size() != sensors)
    throw UsageError(
        fmt::format("datum of step {}: {} values for {} sensors; NaN stands for one that is missing",
                    datum.step, datum.values.size(), sensors));
  if (implementation_->engine.data_count(datum.step) > 0)
    throw UsageError(
        fmt::format("step {} is assimilated already: withdraw it before adding another", datum.step));
  assimilation::Datum added{{}, datum.step, datum.step, vector_of(datum.values), std::nullopt};
  if (!datum.noise.empty()) added.noise = noise_of(datum.noise, sensors);
  implementation_->engine.add(added);
  return implementation_->posterior();
}

Posterior Assimilation::withdraw(std::size_t step) {
  if (!implementation_->engine.withdraw(step, {}))
    throw UsageError(fmt::format("step {} is not assimilated: there is nothing to withdraw", step));
  return implementation_->posterior();
}

}  // namespace knothe
