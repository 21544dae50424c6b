// What one sensor measured, beside what the posterior of a step predicts of it at all times of the model.
#include <algorithm>
#include <cmath>

#include "knothe/model/reduced/loading.hpp"
#include "knothe/service/net/page_views.hpp"

namespace knothe::service {
namespace {

constexpr Eigen::Index k_draws = 100;
constexpr std::size_t k_max_measured = 400;  // each is read from disk where it is old
constexpr double k_sigmas_of_95_percent = 1.959963984540054;

/// Of one sensor at a time step: rows are points of the parameters, n × d.
class SensorPrediction {
 public:
  SensorPrediction(const model::ObservedModel& model, Eigen::Index sensor, const Eigen::MatrixXd& points)
      : model_(model), sensor_(sensor) {
    functions_.resize(points.rows(), points.cols(), model.functions->count(), 0);
    model.functions->evaluate(points, 0, functions_);
  }
  [[nodiscard]] Eigen::ArrayXd at(std::size_t step) const {
    const Eigen::RowVectorXd row = model_.space.row(sensor_) * model_.core[step];
    return model_.lift(sensor_, Eigen::Index(step)) + (functions_.value * row.transpose()).array();
  }

 private:
  const model::ObservedModel& model_;
  Eigen::Index sensor_;
  model::FunctionBatch functions_;
};

Eigen::MatrixXd some_draws(const Eigen::MatrixXd& samples) {
  const Eigen::Index n = std::min(k_draws, samples.rows());
  Eigen::MatrixXd drawn(n, samples.cols());
  for (Eigen::Index i = 0; i < n; ++i) drawn.row(i) = samples.row(i * samples.rows() / n);
  return drawn;
}

/// {mean, low, high} at all model times; the band holds 95 % of what the sensor will read.
Json predicted(const SensorPrediction& draws, std::size_t times, double noise_std) {
  Json mean = Json::array(), low = Json::array(), high = Json::array();
  for (std::size_t step = 0; step < times; ++step) {
    const Eigen::ArrayXd values = draws.at(step);
    const double middle = values.mean();
    const double half =
        k_sigmas_of_95_percent * std::hypot(std::sqrt((values - middle).square().mean()), noise_std);
    mean.push_back(middle), low.push_back(middle - half), high.push_back(middle + half);
  }
  return {{"mean", mean}, {"low", low}, {"high", high}};
}

/// {time, value} up to step `last`: every so many steps where there are more than a page needs.
Json measured(const Site& site, std::size_t last, Eigen::Index sensor) {
  Json time = Json::array(), value = Json::array();
  auto steps = site.lines().events_from(0);
  std::erase_if(steps, [&](const auto& entry) { return entry.second > last; });
  const std::size_t stride = 1 + steps.size() / k_max_measured;
  for (std::size_t i = 0; i < steps.size(); i += stride) {
    const auto line = site.lines().line(steps[i].second);
    if (!line || line->missing[sensor]) continue;
    const SensorPrediction mean(*line->model->setup.problem.model, sensor, line->mean.transpose());
    time.push_back(line->time);
    value.push_back(line->residual[sensor] + mean.at(line->step)[0]);
  }
  return {{"time", time}, {"value", value}};
}

}  // namespace

std::string first_signal(const Site& site) {
  const auto& scalars = site.setup().measurements.sensors.scalars;
  if (!scalars.empty()) return scalars.front();
  const model::ObservedModel& model = *site.setup().problem.model;
  model::FunctionBatch functions;
  functions.resize(1, site.centre().size(), model.functions->count(), 0);
  model.functions->evaluate(site.centre().transpose(), 0, functions);
  const Eigen::VectorXd last = model.lift.col(std::ssize(model.time) - 1) +
                               model.space * (model.core.back() * functions.value.row(0).transpose());
  Eigen::Index largest = 0;
  (last.array() / site.noise_std().array()).abs().maxCoeff(&largest);
  return std::to_string(largest);
}

Json signal(const Site& site, const std::string& sensor, const std::string& step) {
  const auto line = line_of(site, step);
  const model::Sensors& sensors = site.setup().measurements.sensors;
  EntryRequest asked;
  if (sensor.find_first_not_of("0123456789") == std::string::npos)
    asked.sensor_index = parse_index(sensor, "sensor");
  else
    asked.sensor_name = sensor;
  const std::size_t which = sensor_of(asked, sensors), places = sensors.displacement_count();
  const model::ObservedModel& model = *line->model->setup.problem.model;
  const std::string name = which < places ? sensors.label(which) : sensors.scalars[which - places];
  Json answer = {
      {"name", name},
      {"units", which < places ? "m" : model::output_units(line->model->setup.model.contents(), name)},
      {"step", line->step},
      {"time", line->time},
      {"times", model.time},
      {"predicted", predicted({model, Eigen::Index(which), some_draws(line->samples)}, model.time.size(),
                              site.noise_std()[which])},
      {"measured", measured(site, line->step, Eigen::Index(which))}};
  const ServedModel& served = *line->model;
  const auto imposed =
      model::loading_of(served.setup.model, served.project.clock, {line->mean.begin(), line->mean.end()});
  if (!imposed.values.empty())
    answer["loading"] = {{"name", imposed.name}, {"units", imposed.units}, {"values", imposed.values}};
  return answer;
}

}  // namespace knothe::service
