// What was measured beside what the posterior of the same step predicts.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/report/data/report_record.hpp"
#include "knothe/report/data/words.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::ordered_json;

constexpr double k_sigmas_of_95_percent = 1.959963984540054;
constexpr Index k_max_residuals = 4000;

/// Mean and standard deviation over the draws of one predicted number at each step.
struct Prediction {
  std::vector<double> mean, std;
};

/// `values`: draw by draw, in each `count` numbers a step, of which number `which`.
Prediction prediction_of(const std::vector<double>& values, std::size_t draws, std::size_t steps,
                         std::size_t count, std::size_t which) {
  Prediction p;
  for (std::size_t s = 0; s < steps; ++s) {
    double sum = 0, squares = 0;
    for (std::size_t j = 0; j < draws; ++j) sum += values[(j * steps + s) * count + which];
    const double mean = sum / draws;
    for (std::size_t j = 0; j < draws; ++j)
      squares += std::pow(values[(j * steps + s) * count + which] - mean, 2);
    p.mean.push_back(mean);
    p.std.push_back(std::sqrt(squares / std::max<double>(1, draws - 1.0)));
  }
  return p;
}

/// Collects signals and residuals.
class Predictions {
 public:
  void add(const std::string& label, const std::string& units, const std::vector<double>& time,
           const std::vector<double>& measured, const Prediction& p) {
    Json signal = {{"label", label}, {"units", units}, {"time", time}};
    const auto number = [](double v) { return std::isfinite(v) ? Json(v) : Json(nullptr); };
    for (std::size_t s = 0; s < time.size(); ++s) {
      signal["measured"].push_back(number(measured[s]));
      signal["mean"].push_back(number(p.mean[s]));
      signal["low"].push_back(number(p.mean[s] - k_sigmas_of_95_percent * p.std[s]));
      signal["high"].push_back(number(p.mean[s] + k_sigmas_of_95_percent * p.std[s]));
    }
    signals_.push_back(std::move(signal));
  }
  void add_residuals(const std::vector<double>& time, const std::vector<double>& measured,
                     const Prediction& p) {
    for (std::size_t s = 0; s < time.size(); ++s)
      if (std::isfinite(measured[s]) && p.std[s] > 0)
        residuals_.emplace_back(time[s], (measured[s] - p.mean[s]) / p.std[s]);
  }
  [[nodiscard]] Json record() {
    Json record = Json::object();
    if (!signals_.empty()) record["measured"] = std::move(signals_);
    if (residuals_.empty()) return record;
    std::stable_sort(residuals_.begin(), residuals_.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    Json time = Json::array(), value = Json::array();
    const Index stride = 1 + (std::ssize(residuals_) - 1) / k_max_residuals;
    for (Index i = 0; i < std::ssize(residuals_); i += stride)
      time.push_back(residuals_[i].first), value.push_back(residuals_[i].second);
    record["residuals"] = {{"time", std::move(time)}, {"value", std::move(value)}};
    return record;
  }

 private:
  Json signals_ = Json::array();
  std::vector<std::pair<double, double>> residuals_;
};

std::vector<double> every(const std::vector<double>& values, std::size_t count, std::size_t which) {
  std::vector<double> out;
  for (std::size_t i = which; i < values.size(); i += count) out.push_back(values[i]);
  return out;
}

/// Sensors: residuals of all, and of each component the one whose prediction varies most.
void add_displacements(const files::Hdf5Reader& file, const std::vector<double>& time, Predictions& into) {
  const std::string name = "/posterior_predictive/displacement";
  const files::Shape shape = file.shape(name);
  if (shape.size() != 4 || shape[2] != time.size()) return;
  const std::size_t draws = shape[0] * shape[1], steps = shape[2], sensors = shape[3];
  const std::vector<double> predicted = file.read(name, true),
                            all = file.read("/observed_data/displacement", true),
                            points = file.read("/constant_data/points");
  const std::vector<std::int64_t> components = file.read_integers("/constant_data/component");
  if (all.size() != steps * sensors || points.size() != 3 * sensors || components.size() != sensors) return;
  std::array<double, 3> widest{-1, -1, -1};
  std::array<std::size_t, 3> chosen{};
  for (std::size_t j = 0; j < sensors; ++j) {
    const Prediction p = prediction_of(predicted, draws, steps, sensors, j);
    into.add_residuals(time, every(all, sensors, j), p);
    double low = INFINITY, high = -INFINITY;  // of steps that the sensor was measured at
    for (const double mean : p.mean)
      if (std::isfinite(mean)) low = std::min(low, mean), high = std::max(high, mean);
    const std::size_t c = components[j];
    if (c < 3 && high - low > widest[c]) widest[c] = high - low, chosen[c] = j;
  }
  // The one that moves more comes first.
  std::array<std::size_t, 3> order{0, 1, 2};
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return widest[a] > widest[b]; });
  for (const std::size_t c : order) {
    const std::size_t j = chosen[c];
    if (widest[c] >= 0)
      into.add(
          fmt::format("u_{} at ({:.1f}, {:.1f}) mm", "xyz"[c], 1e3 * points[3 * j], 1e3 * points[3 * j + 1]),
          "m", time, every(all, sensors, j), prediction_of(predicted, draws, steps, sensors, j));
  }
}

/// Scalar series of posterior.nc, by its own names.
void add_series(const files::Hdf5Reader& file, const record::Results& results,
                const std::vector<double>& time, Predictions& into) {
  for (const auto& [name, fit] : results.residuals.series) {
    std::string variable = name;
    if (!file.has("/posterior_predictive/" + variable)) variable = "series_" + name;
    const std::string predicted = "/posterior_predictive/" + variable,
                      measured = "/observed_data/" + variable;
    if (!file.has(predicted) || !file.has(measured)) continue;
    const files::Shape shape = file.shape(predicted);
    const std::vector<double> values = file.read(measured, true);
    if (shape.size() != 3 || shape[2] != time.size() || values.size() != time.size()) continue;
    const Prediction p = prediction_of(file.read(predicted, true), shape[0] * shape[1], shape[2], 1, 0);
    into.add(name, fit.units, time, values, p);
    into.add_residuals(time, values, p);
  }
}

/// Without draws: the mean, and the noise around it.
void add_series(const record::Results& results, Predictions& into) {
  for (const auto& [name, fit] : results.residuals.series) {
    std::vector<double> time;
    for (const double step : fit.step) {
      const auto found = std::find_if(results.steps.begin(), results.steps.end(),
                                      [&](const record::Step& s) { return s.step == step; });
      time.push_back(found == results.steps.end() ? step : found->time);
    }
    const Prediction p{fit.predicted, std::vector<double>(time.size(), fit.std)};
    into.add(name, fit.units, time, fit.measured, p);
    into.add_residuals(time, fit.measured, p);
  }
}

}  // namespace

Json predictions_record(const record::Results& results) {
  const std::string path = (std::filesystem::path(results.folder) / "posterior.nc").string();
  std::error_code none;
  Predictions predictions;
  if (std::filesystem::exists(path, none)) {
    try {
      const files::Hdf5Reader file(path);
      const std::vector<double> time = file.read("/observed_data/time");
      add_series(file, results, time, predictions);
      if (file.has("/posterior_predictive/displacement")) add_displacements(file, time, predictions);
      return predictions.record();
    } catch (const DataError&) {
      predictions = {};  // of another version, or broken: a report is made of what can be read
    }
  }
  add_series(results, predictions);
  return predictions.record();
}

}  // namespace knothe::report
