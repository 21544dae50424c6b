#include "knothe/assimilation/forecast/forecaster.hpp"

#include <algorithm>

#include "knothe/assimilation/forecast/forecast_inputs.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {
namespace {

using model::SeparatedModel;
using Quantity = ForecastSpecification::Quantity;

constexpr double k_min_discrepancy = 1e-12;  ///< m; where the predicted fields are those of cracks
constexpr double k_same_time = 1e-9;

TimePosition horizon_of(const SeparatedModel& model, const ForecastSpecification& specification) {
  return locate_horizon(model.contents().time, specification.horizon,
                        fmt::format("[forecast.{}] horizon", specification.name));
}

LinearPrediction at_position(const model::ObservedModel& model, const TimePosition& position) {
  return interpolate(position, at_step(model, position.lower), at_step(model, position.upper));
}

/// δ, from few draws: it varies little from one point of a posterior to the next.
double estimated_discrepancy(const CrackBridge& bridge, const model::RowMatrix& functions,
                             const Eigen::Ref<const Eigen::VectorXd>& weights) {
  constexpr Index k_draws = 64;
  const Index n = std::min(k_draws, functions.rows());
  const model::RowMatrix drawn = functions(numerics::equal_draws(weights, n), Eigen::all);
  return std::max(bridge.update(drawn, Eigen::VectorXd::Ones(n)).discrepancy_std, k_min_discrepancy);
}

/// The forecast of q + by.
ScalarForecast moved(ScalarForecast forecast, double by) {
  forecast.mean += by;
  forecast.maximum_a_posteriori += by;
  for (double& value : forecast.values) value += by;
  for (double& point : forecast.points) point += by;
  return forecast;
}

}  // namespace

Forecaster::Forecaster(const SeparatedModel& model, const model::Dofs& seen,
                       const std::vector<ForecastSpecification>& specifications)
    : functions_(model.functions()), specifications_(specifications) {
  for (const ForecastSpecification& specification : specifications) {
    if (specification.quantity == Quantity::crack_length)
      add_crack(model, seen, specification);
    else
      add_scalar(model, specification);
  }
  if (functions_->dimension() == 2)
    table_.emplace(functions_->lower(), functions_->upper(), 2 * std::ssize(cracks_) + std::ssize(scalars_));
}

void Forecaster::add_crack(const SeparatedModel& model, const model::Dofs& seen,
                           const ForecastSpecification& specification) {
  CrackMetaModel elastic = elastic_cracks(model, seen, specification.name);
  const TimePosition position = horizon_of(model, specification);
  const std::vector<double> imposed = imposed_displacements(model, specification.name);
  cracks_.push_back({specification.name,
                     CrackBridge(std::move(elastic), at_position(model::observe(model, seen), position),
                                 position.interpolate(imposed[position.lower], imposed[position.upper]),
                                 bridge_options(specification)),
                     specification.length_offset, specification.discrepancy_std});
}

void Forecaster::add_scalar(const SeparatedModel& model, const ForecastSpecification& specification) {
  const TimePosition horizon = horizon_of(model, specification);
  const LinearQuantity quantity = linear_quantity(model, specification, std::span(&horizon, 1));
  scalars_.push_back(
      {specification.name, forecast_units(model.contents(), specification),
       QuantityOfInterest(quantity.functions, quantity.lift[0], quantity.coefficients.col(0),
                          specification.threshold.value_or(0), specification.model_error_std)});
}

void Forecaster::evaluate_functions(const Eigen::Ref<const Eigen::MatrixXd>& points) {
  batch_.resize(points.rows(), functions_->dimension(), functions_->count(), 0);
  functions_->evaluate(points, 0, batch_);
}

std::vector<NamedForecast> Forecaster::update(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                              const Eigen::Ref<const Eigen::VectorXd>& weights) {
  // Points without weight cost as much as the others.
  const double least = 1e-12 * weights.sum();
  std::vector<Index> kept;
  for (Index i = 0; i < weights.size(); ++i)
    if (!(weights[i] >= 0.0 && weights[i] <= least)) kept.push_back(i);
  const Eigen::MatrixXd at = points(kept, Eigen::all);
  const Eigen::VectorXd weight = weights(kept);
  std::vector<NamedForecast> forecasts =
      table_ ? forecasts_of(table_->evaluate(at, weight, [&](const auto& nodes) { return values_at(nodes); }),
                            weight)
             : forecasts_from(at, weight);
  complete(forecasts);
  return forecasts;
}

/// What `table_` holds.
Eigen::MatrixXd Forecaster::values_at(const Eigen::MatrixXd& points) {
  Eigen::MatrixXd values(points.rows(), 2 * std::ssize(cracks_) + std::ssize(scalars_));
  evaluate_functions(points);
  Index column = 0;
  for (const Crack& crack : cracks_) {
    CrackBridge::Nearest nearest = crack.bridge.nearest(batch_.value);
    values.col(column++) = std::move(nearest.length);
    values.col(column++) = std::move(nearest.square);
  }
  for (const Scalar& scalar : scalars_)
    values.col(column++) = scalar.quantity.is_of(*functions_) ? scalar.quantity.values(batch_.value)
                                                              : scalar.quantity.evaluate(points);
  return values;
}

std::vector<NamedForecast> Forecaster::forecasts_of(const Eigen::MatrixXd& values,
                                                    const Eigen::VectorXd& weights) const {
  std::vector<NamedForecast> forecasts;
  Index column = 0;
  for (const Crack& crack : cracks_) {
    forecasts.push_back(
        forecast_of(crack, crack.bridge.forecast(values.col(column), values.col(column + 1), weights)));
    column += 2;
  }
  for (const Scalar& scalar : scalars_)
    forecasts.push_back(
        {scalar.name, scalar.units, scalar.quantity.forecast(values.col(column++), weights), std::nullopt});
  return forecasts;
}

/// The same without a table: of a crack from some of the points, where they are many.
std::vector<NamedForecast> Forecaster::forecasts_from(const Eigen::MatrixXd& points,
                                                      const Eigen::VectorXd& weights) {
  std::vector<NamedForecast> forecasts;
  evaluate_functions(points);
  for (const Crack& crack : cracks_)
    forecasts.push_back(forecast_of(crack, crack.bridge.update(batch_.value, weights)));
  for (const Scalar& scalar : scalars_)
    forecasts.push_back({scalar.name, scalar.units,
                         scalar.quantity.is_of(*functions_)
                             ? scalar.quantity.forecast(scalar.quantity.values(batch_.value), weights)
                             : scalar.quantity.update(points, weights),
                         std::nullopt});
  return forecasts;
}

NamedForecast Forecaster::forecast_of(const Crack& crack, CrackForecast found) {
  return {crack.name, "m", moved(std::move(found.length), crack.offset), found.discrepancy_std};
}

void Forecaster::complete(std::vector<NamedForecast>& forecasts) const {
  const auto place = [&](const NamedForecast& forecast) {
    return std::find_if(specifications_.begin(), specifications_.end(),
                        [&](const ForecastSpecification& s) { return s.name == forecast.name; });
  };
  for (NamedForecast& forecast : forecasts) {
    const ForecastSpecification& s = *place(forecast);
    forecast.horizon = s.horizon;
    forecast.threshold_stated = s.threshold.has_value();
    forecast.threshold = s.threshold.value_or(s.quantity == Quantity::crack_length ? s.prior_mean : 0);
  }
  std::sort(forecasts.begin(), forecasts.end(),
            [&](const NamedForecast& a, const NamedForecast& b) { return place(a) < place(b); });
}

std::vector<NamedForecast> Forecaster::published(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                                 const Eigen::Ref<const Eigen::VectorXd>& weights,
                                                 FieldDensity density) {
  std::vector<NamedForecast> forecasts;
  if (cracks_.empty()) return forecasts;
  evaluate_functions(points);
  const FunctionMoments moments = moments_of_functions(batch_.value, weights);
  for (const Crack& crack : cracks_) {
    const double discrepancy = crack.discrepancy_std
                                   ? *crack.discrepancy_std
                                   : estimated_discrepancy(crack.bridge, batch_.value, weights);
    ScalarForecast length = density == FieldDensity::normal
                                ? crack.bridge.published(moments, discrepancy)
                                : crack.bridge.published_by_map(batch_.value, weights, discrepancy);
    forecasts.push_back({crack.name, "m", moved(std::move(length), crack.offset), discrepancy});
  }
  complete(forecasts);
  return forecasts;
}

void mark_past(std::vector<NamedForecast>& forecasts, double time) {
  for (NamedForecast& forecast : forecasts) forecast.is_past = forecast.horizon < time - k_same_time;
}

}  // namespace knothe::assimilation
