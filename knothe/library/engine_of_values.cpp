#include "knothe/library/engine_of_values.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/text.hpp"
#include "knothe/library/plain.hpp"
#include "knothe/model/observe/scalar_observations.hpp"
#include "knothe/model/reduced/parameter_order.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/posterior/prior/earlier_posteriors.hpp"

namespace knothe::library {
namespace {

Eigen::SparseMatrix<double> matrix_of(const Noise::Precision& precision) {
  const auto n = std::ssize(precision.row_begin) - 1;
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t row = 0; row + 1 < precision.row_begin.size(); ++row)
    for (std::int64_t i = precision.row_begin[row]; i < precision.row_begin[row + 1]; ++i) {
      const std::size_t at = i;
      if (at >= precision.values.size() || at >= precision.columns.size() || precision.columns[at] < 0 ||
          precision.columns[at] >= n)
        throw UsageError(fmt::format(
            "noise: the precision's entry {} of row {} is outside the {} x {} matrix", i, row, n, n));
      entries.emplace_back(row, precision.columns[at], precision.values[at]);
    }
  Eigen::SparseMatrix<double> matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

model::Dofs places_of(const Sensors& sensors) {
  if (sensors.size() == 0 || sensors.points.size() != 3 * sensors.components.size())
    throw UsageError(fmt::format("{} with {}: each has a component and a point x, y, z",
                                 counted(sensors.components.size(), "sensor"),
                                 counted(sensors.points.size(), "coordinate")));
  return {sensors.points, {sensors.components.begin(), sensors.components.end()}};
}

/// An engine without noise and priors: the model at the sensors, its parameters in the order of the priors,
/// and its own error there.
assimilation::EngineSetup observe(const std::string& file, const Sensors& sensors,
                                  const std::vector<Prior>& priors) {
  const model::Sensors places(places_of(sensors), sensors.series);
  std::vector<std::string> names;
  for (const Prior& prior : priors) names.push_back(prior.parameter);
  const model::SeparatedModel model(model::with_parameter_order(model::read_model(file), names), file);
  assimilation::EngineSetup setup;
  setup.model = std::make_shared<model::ObservedModel>(observed(model, sensors));
  setup.sensors = places;
  setup.known_errors = model::observe_off_grid(model::read_truncation_error(file), model.contents(), file,
                                               setup.sensors, {}, model.contents().time, std::ssize(sensors));
  return setup;
}

assimilation::UpdateOptions settings_of(const AssimilationOptions& options) {
  assimilation::UpdateOptions settings;
  settings.map.tolerance = options.tolerance;
  settings.map.max_order = options.max_order;
  settings.map.seed = options.seed;
  return settings;
}

}  // namespace

model::ObservedModel observed(const model::SeparatedModel& model, const Sensors& sensors) {
  model::ObservedModel seen = model::observe(model, places_of(sensors));
  std::vector<model::ScalarObservation> series;
  for (const std::string& name : sensors.series) {
    series.emplace_back();
    series.back().name = series.back().output = name;
  }
  return series.empty() ? seen : model::with_scalars(seen, model, series);
}

std::vector<posterior::Prior> priors_of(const std::vector<Prior>& priors) {
  posterior::EarlierPosteriors earlier;
  std::vector<posterior::Prior> result;
  for (const Prior& prior : priors) {
    switch (prior.family) {
      case Prior::Family::uniform:
        result.push_back(posterior::Prior::uniform(prior.first, prior.second));
        break;
      case Prior::Family::lognormal:
        result.push_back(posterior::Prior::lognormal(prior.first, prior.second));
        break;
      case Prior::Family::posterior:
        result.push_back(
            earlier.prior_of(prior.results, prior.name_there.empty() ? prior.parameter : prior.name_there));
        break;
      case Prior::Family::normal:
        result.push_back(posterior::Prior::normal(prior.first, prior.second));
    }
  }
  return result;
}

likelihood::GaussianNoise noise_of(const Noise& noise, std::size_t sensors) {
  const std::size_t size =
      noise.precision.row_begin.empty() ? noise.std.size() : noise.precision.row_begin.size() - 1;
  if (size != sensors || (!noise.std.empty() && !noise.precision.row_begin.empty()))
    throw UsageError(fmt::format("noise of {} for {}: give one standard deviation each, or their precision",
                                 counted(size, "value"), counted(sensors, "sensor")));
  return noise.std.empty() ? likelihood::GaussianNoise::correlated(matrix_of(noise.precision))
                           : likelihood::GaussianNoise::independent(vector_of(noise.std));
}

assimilation::EngineSetup engine_setup(const std::string& model_file, const Sensors& sensors,
                                       const Noise& noise, const std::vector<Prior>& priors,
                                       const AssimilationOptions& options) {
  assimilation::EngineSetup setup = observe(model_file, sensors, priors);
  setup.noise = noise_of(noise, sensors.size());
  setup.priors = priors_of(priors);
  setup.update = settings_of(options);
  return setup;
}

}  // namespace knothe::library
