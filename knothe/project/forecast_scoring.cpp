#include "knothe/project/forecast_scoring.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "knothe/assimilation/forecast/forecast_inputs.hpp"

namespace knothe::project {
namespace {

using Quantity = assimilation::ForecastSpecification::Quantity;

/// The row of the data that measures the quantity.
std::optional<Eigen::Index> row_of(const assimilation::ForecastSpecification& f, const UpdateSetup& setup) {
  const model::Sensors& sensors = setup.measurements.sensors;
  const Eigen::Index displacements = sensors.displacement_count();
  if (f.quantity == Quantity::output) {
    const auto found = std::find(sensors.scalars.begin(), sensors.scalars.end(), f.output);
    if (found == sensors.scalars.end()) return std::nullopt;
    return displacements + (found - sensors.scalars.begin());
  }
  if (f.quantity != Quantity::displacement) return std::nullopt;
  for (Eigen::Index j = 0; j < displacements; ++j) {
    const auto x = sensors.point(j);
    const double distance = std::hypot(x[0] - f.point[0], x[1] - f.point[1], x[2] - f.point[2]);
    if (distance <= 1e-6 && sensors.components[j] == f.component) return j;
  }
  return std::nullopt;
}

std::optional<std::size_t> time_of(double horizon, const UpdateSetup& setup) {
  const std::vector<double>& time = setup.model.contents().time;
  const double step = time.size() > 1 ? (time.back() - time.front()) / (time.size() - 1) : 1;
  for (const std::size_t index : setup.time_indices) {
    if (std::abs(setup.problem.model->time[index] - horizon) <= 1e-6 * step) return index;
  }
  return std::nullopt;
}

}  // namespace

assimilation::ForecastScores forecasts_to_score(const Project& project, const UpdateSetup& setup) {
  assimilation::ForecastScores scores;
  if (setup.pictures) return scores;
  const Eigen::VectorXd std = setup.measurements.noise.measurement().standard_deviations();
  for (const assimilation::ForecastSpecification& f : project.forecasts) {
    const auto row = row_of(f, setup);
    const auto time_index = time_of(f.horizon, setup);
    if (!row || !time_index || !(std[*row] > 0)) continue;
    scores.wait_for(f.name, forecast_units(setup.model.contents(), f), *setup.problem.model, *row,
                    *time_index, std::hypot(std[*row], f.model_error_std));
  }
  return scores;
}

}  // namespace knothe::project
