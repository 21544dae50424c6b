#include "knothe/record/posterior_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/files/netcdf.hpp"
#include "knothe/likelihood/noise/predictive.hpp"
#include "knothe/numerics/statistics/distinct_draws.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/draws/importance_proposal.hpp"
#include "knothe/record/physical_parameters.hpp"
#include "knothe/record/step_record.hpp"

namespace knothe::record {
namespace {

using Names = std::vector<std::string>;
using files::SinglePrecision;
constexpr Eigen::Index k_draws = 500;
constexpr std::size_t k_predictive_draws = 50;    ///< at most; of many sensors fewer,
constexpr std::size_t k_predictive_values = 4e6;  ///< for this many numbers (16 MB) in all
constexpr Eigen::Index k_weighted_points = 2048;  ///< of each step but the last, at most
constexpr double k_missing = std::numeric_limits<double>::quiet_NaN();

std::vector<std::int64_t> counted(std::size_t n, std::size_t stride = 1) {
  std::vector<std::int64_t> numbers(n);
  for (std::size_t i = 0; i < n; ++i) numbers[i] = i * stride;
  return numbers;
}

/// At most `count` of a posterior's points, with weights that add up to 1: those that `count` draws fall on.
posterior::WeightedPoints thinned(const posterior::Posterior& posterior, Eigen::Index count) {
  if (posterior.weights.size() <= count) return {posterior.points, posterior.weights};
  std::map<Eigen::Index, double> chosen;
  for (const Eigen::Index i : numerics::equal_draws(posterior.weights, count)) chosen[i] += 1.0 / count;
  posterior::WeightedPoints kept{Eigen::MatrixXd(std::ssize(chosen), posterior.points.cols()),
                                 Eigen::VectorXd(std::ssize(chosen))};
  Eigen::Index row = 0;
  for (const auto& [i, weight] : chosen) {
    kept.points.row(row) = posterior.points.row(i);
    kept.weights[row++] = weight;
  }
  return kept;
}

/// What a series is called in a group that has names of its own.
std::string variable_of(const std::string& series) {
  static const std::set<std::string> k_taken = {"chain",     "draw", "step", "time", "observation",
                                                "direction", "x",    "y",    "z",    "displacement"};
  return k_taken.contains(series) ? "series_" + series : series;
}

/// Appends a matrix in C order.
void append(std::vector<double>& values, const Eigen::Ref<const Eigen::MatrixXd>& m) {
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index k = 0; k < m.cols(); ++k) values.push_back(m(i, k));
}

class Writer {
 public:
  Writer(files::NetcdfWriter& out, const PosteriorFile& file)
      : out_(out),
        file_(file),
        n_steps_(file.steps.size()),
        n_observations_(file.measurements.sensors.displacement_count()) {
    for (const KeptStep& step : file.steps) {
      steps_.push_back(step.result.step);
      times_.push_back(step.result.time);
    }
  }

  /// posterior, posterior_predictive, log_likelihood.
  void write_draws() {
    const std::vector<std::string>& scalars = file_.measurements.sensors.scalars;
    const std::size_t n_rows = n_observations_ + scalars.size();
    const std::size_t affordable = k_predictive_values / std::max<std::size_t>(1, n_steps_ * n_rows);
    const std::size_t wanted = std::clamp<std::size_t>(affordable, 4, k_predictive_draws);
    const std::size_t stride = (k_draws + wanted - 1) / wanted, n_predicted = (k_draws + stride - 1) / stride;
    const auto observed = file_.observed ? file_.observed
                                         : std::make_shared<const model::ObservedModel>(
                                               model::observe(file_.model, file_.measurements.sensors));
    const std::size_t d = file_.priors.size();
    std::vector<std::vector<double>> draws(d, std::vector<double>(k_draws * n_steps_));
    std::vector<double> likelihood(k_draws * n_steps_), predicted(n_predicted * n_steps_ * n_observations_);
    std::vector<std::vector<double>> series(scalars.size(), std::vector<double>(n_predicted * n_steps_));
    for (std::size_t s = 0; s < n_steps_; ++s) {
      const StepDraws here = draw_step(file_.steps[s], *observed, file_.priors, n_rows, k_draws, stride);
      for (std::size_t j = 0; j < k_draws; ++j) {
        const Eigen::Index row = j;
        for (std::size_t k = 0; k < d; ++k) draws[k][j * n_steps_ + s] = here.parameters(row, k);
        likelihood[j * n_steps_ + s] = here.log_likelihood[row];
      }
      for (std::size_t j = 0; j < n_predicted; ++j) {
        const auto column = here.predicted.col(j);
        std::copy_n(column.data(), n_observations_, predicted.begin() + (j * n_steps_ + s) * n_observations_);
        for (std::size_t k = 0; k < scalars.size(); ++k)
          series[k][j * n_steps_ + s] = column[n_observations_ + k];
      }
    }
    write_posterior(draws);
    add_draws("posterior_predictive", counted(n_predicted, stride));
    const std::string meaning =
        "what the sensors would measure: model, bias where it is corrected, and noise";
    if (n_observations_ > 0) {
      add_observations("posterior_predictive");
      out_.add_variable("posterior_predictive", "displacement", Names{"chain", "draw", "step", "observation"},
                        SinglePrecision{predicted}, {"m", meaning});
    }
    for (std::size_t k = 0; k < scalars.size(); ++k)
      out_.add_variable("posterior_predictive", variable_of(scalars[k]), Names{"chain", "draw", "step"},
                        SinglePrecision{series[k]},
                        {file_.measurements.series.at(scalars[k]).units, meaning});
    add_draws("log_likelihood", counted(k_draws));
    out_.add_variable("log_likelihood", "datum", Names{"chain", "draw", "step"}, likelihood,
                      {"1", "log density of the step's datum under the draw of that step"});
  }

  void write_data() {
    add_steps("observed_data");
    const auto& m = file_.measurements;
    for (const auto& [name, series] : m.series) {
      out_.add_variable("observed_data", variable_of(name), Names{"step"},
                        std::span(series.values.data(), n_steps_), {series.units, "measured"});
      if (series.std) out_.add_number("observed_data", variable_of(name), "std", *series.std);
    }
    if (n_observations_ == 0) return;
    add_observations("observed_data");
    out_.add_variable("observed_data", "displacement", Names{"step", "observation"},
                      std::span(m.values.data(), n_steps_ * n_observations_), {"m", "measured displacement"});
    const std::string group = "constant_data";
    add_observations(group);
    out_.add_dimension(group, "axis", Names{"x", "y", "z"}, {"1", "direction"});
    out_.add_variable(group, "points", Names{"observation", "axis"}, m.sensors.points,
                      {"m", "measurement points"});
    const std::vector<std::int64_t> components(m.sensors.components.begin(), m.sensors.components.end());
    out_.add_variable(group, "component", Names{"observation"}, components, {"1", "0 x, 1 y, 2 z"});
    const Eigen::VectorXd std = m.noise.measurement().standard_deviations();
    out_.add_variable(group, "noise_std", Names{"observation"}, std::span(std.data(), n_observations_),
                      {"m", "standard deviation"});
  }

  void write_statistics() {
    add_steps("sample_stats");
    add_statistic("map_order", "order of the map", [](const auto& r) { return double(r.map_order); });
    add_statistic("variance_diagnostic", "verified variance diagnostic",
                  [](const auto& r) { return r.variance_diagnostic; });
    add_statistic("ess", "effective sample size, fraction",
                  [](const auto& r) { return r.effective_sample_size; });
    add_statistic("trusted", "1 if trusted", [](const auto& r) { return r.trusted ? 1.0 : 0.0; });
    add_statistic("verdict", "0 ok, 1 caution, 2 reject",
                  [](const auto& r) { return static_cast<double>(r.verdict.level); });
    add_statistic("fit_probability", "of a misfit as large as that of all data so far",
                  [](const auto& r) { return r.verdict.fit_probability; });
    add_statistic("log_evidence", "log p(d_0 ... d_i)", [](const auto& r) { return r.log_evidence; });
    add_statistic("log_evidence_increment", "log p(d_i | d_0 ... d_i-1)",
                  [](const auto& r) { return r.log_evidence_increment; });
    Names reasons;
    for (const KeptStep& step : file_.steps) {
      Names messages;
      for (const assimilation::VerdictReason& reason : step.result.verdict.reasons)
        messages.push_back(fmt::format("{}: {}", to_text(reason.part), reason.message));
      reasons.push_back(fmt::format("{}", fmt::join(messages, "; ")));
    }
    out_.add_variable("sample_stats", "verdict_reasons", Names{"step"}, reasons, {"", "why, where not ok"});
  }

  /// What is said of the quantities of interest.
  void write_forecasts() {
    const auto& last = file_.steps.back().forecasts;
    if (last.empty()) return;
    const std::string group = "forecast";
    Names names, units;
    std::vector<double> horizons, thresholds;
    for (const assimilation::NamedForecast& f : last) {
      names.push_back(f.name), units.push_back(f.units);
      horizons.push_back(f.horizon), thresholds.push_back(f.threshold);
    }
    add_steps(group);
    out_.add_dimension(group, "forecast", names, {"", "name of the forecast"});
    out_.add_dimension(group, "level", numerics::k_quantile_levels, {"1", "of the quantiles"});
    out_.add_variable(group, "units", Names{"forecast"}, units, {"", "of the quantity"});
    out_.add_variable(group, "horizon", Names{"forecast"}, horizons, {"1", "model time"});
    out_.add_variable(group, "threshold", Names{"forecast"}, thresholds, {"", "in the quantity's units"});
    out_.add_attribute(group, "coordinates", "time units horizon threshold");
    using F = assimilation::ScalarForecast;
    add_forecast("mean", "mean", [](const F& f) { return f.mean; });
    add_forecast("std", "standard deviation", [](const F& f) { return f.std; });
    add_forecast("maximum_a_posteriori", "most probable value",
                 [](const F& f) { return f.maximum_a_posteriori; });
    add_forecast("probability_above_threshold", "P(q > threshold)",
                 [](const F& f) { return f.probability_above_threshold; });
    add_forecast("probability_below_threshold", "P(q < threshold)",
                 [](const F& f) { return 1 - f.probability_above_threshold; });
    std::vector<double> quantiles;
    for (const KeptStep& step : file_.steps)
      for (const assimilation::NamedForecast& f : step.forecasts)
        quantiles.insert(quantiles.end(), f.forecast.values.begin(), f.forecast.values.end());
    out_.add_variable(group, "quantiles", Names{"step", "forecast", "level"}, quantiles, {"", "quantiles"});
  }

  void write_weighted_points() {
    std::vector<posterior::WeightedPoints> kept;
    Eigen::Index n = 0;
    for (const KeptStep& step : file_.steps) {
      kept.push_back(thinned(step.result, k_weighted_points));
      n = std::max(n, kept.back().weights.size());
    }
    const std::string group = "weighted_posterior";
    add_steps(group);
    out_.add_dimension(group, "point", n);
    // Steps with fewer points are filled up with their first point at weight zero.
    std::vector<double> points, weights;
    for (const posterior::WeightedPoints& step : kept) {
      const Eigen::Index there = step.weights.size();
      append(points, step.points);
      append(points, step.points.row(0).replicate(n - there, 1));
      append(weights, step.weights);
      weights.resize(weights.size() + (n - there), 0.0);
    }
    write_points(group, {"step", "point"}, points, weights);
    // All that the last step has: forecasts are made from these.
    const posterior::Posterior& last = file_.steps.back().result;
    points.clear(), weights.clear();
    append(points, last.points), append(weights, last.weights);
    out_.add_dimension("last_posterior", "point", weights.size());
    write_points("last_posterior", {"point"}, points, weights);
    out_.add_number("last_posterior", "weights", "step", steps_.back());
    out_.add_number("last_posterior", "weights", "time", times_.back());
  }

  /// What each group is, for those who open the file without this page.
  void describe_groups() {
    using Text = std::pair<const char*, const char*>;
    for (const auto& [group, text] :
         {Text{"posterior",
               "draws at each step from the posterior of all data up to it; draw n of one step "
               "has nothing to do with draw n of another"},
          Text{"posterior_predictive",
               "what the sensors would measure at the step under draws of its posterior, noise included"},
          Text{"log_likelihood", "log density of the last datum of the step given the draw"},
          Text{"observed_data", "measured values"},
          Text{"sample_stats", "of the computation and the verdict, by step"},
          Text{"weighted_posterior", "weighted points of each step's posterior, at most 2048"},
          Text{"last_posterior", "all weighted points of the last step's posterior"}})
      out_.add_attribute(group, "description", text);
  }

 private:
  void write_posterior(const std::vector<std::vector<double>>& draws) {
    add_draws("posterior", counted(k_draws));
    for (std::size_t k = 0; k < draws.size(); ++k)
      add_draws_of(file_.model.contents().axes[k], {"chain", "draw", "step"}, draws[k], out_);
  }

  void write_points(const std::string& group, Names dimensions, std::span<const double> points,
                    std::span<const double> weights) {
    const Names names = file_.model.parameter_names();
    out_.add_variable(group, "weights", dimensions, weights, {"1", "importance weights, sum 1"});
    dimensions.emplace_back("parameter");
    out_.add_dimension(group, "parameter", names, {"", "parameter"});
    out_.add_variable(group, "points", dimensions, points, {"1", "parameters"});
    out_.add_attribute(group, "parameters", fmt::format("{}", fmt::join(names, ",")));
  }

  void add_draws(const std::string& group, const std::vector<std::int64_t>& draws) {
    out_.add_dimension(group, "chain", counted(1), {"", "chain"});
    out_.add_dimension(group, "draw", draws, {"", "draw"});
    add_steps(group);
  }

  void add_steps(const std::string& group) {
    out_.add_dimension(group, "step", steps_, {"", "assimilated step"});
    out_.add_variable(group, "time", Names{"step"}, times_, {"1", "model time"});
    out_.add_attribute(group, "coordinates", "time");
  }

  /// The sensors: a name, place and component of each.
  void add_observations(const std::string& group) {
    const model::Sensors& sensors = file_.measurements.sensors;
    Names names, directions;
    std::array<std::vector<double>, 3> places;
    for (std::size_t i = 0; i < n_observations_; ++i) {
      directions.emplace_back(1, "xyz"[sensors.components[i]]);
      names.push_back(sensors.label(i));
      for (std::size_t axis = 0; axis < 3; ++axis) places[axis].push_back(sensors.points[3 * i + axis]);
    }
    out_.add_dimension(group, "observation", names, {"", "name of the sensor, or its component and number"});
    out_.add_variable(group, "direction", Names{"observation"}, directions, {"", "of the displacement"});
    for (std::size_t axis = 0; axis < 3; ++axis)
      out_.add_variable(group, std::string(1, "xyz"[axis]), Names{"observation"}, places[axis],
                        {"m", "position of the sensor"});
    const bool by_step = group != "constant_data";
    out_.add_attribute(group, "coordinates", by_step ? "time direction x y z" : "direction x y z");
  }

  template <class Get>
  void add_statistic(const std::string& name, const std::string& meaning, const Get& get) {
    std::vector<double> values;
    for (const KeptStep& step : file_.steps) values.push_back(get(step.result));
    out_.add_variable("sample_stats", name, Names{"step"}, values, {"1", meaning});
  }

  template <class Get>
  void add_forecast(const std::string& name, const std::string& meaning, const Get& get) {
    std::vector<double> values;
    for (const KeptStep& step : file_.steps)
      for (const assimilation::NamedForecast& f : step.forecasts) values.push_back(get(f.forecast));
    out_.add_variable("forecast", name, Names{"step", "forecast"}, values, {"", meaning});
  }

  files::NetcdfWriter& out_;
  const PosteriorFile& file_;
  std::size_t n_steps_, n_observations_;
  std::vector<std::int64_t> steps_;
  std::vector<double> times_;
};

}  // namespace

KeptStep retain_step(const assimilation::StepResult& result, likelihood::Datum datum,
                     const model::ObservedModel* observed) {
  KeptStep kept{result.update, std::move(datum), result.forecasts, result.bias.sensors};
  if (result.bias.functions.size() > 0 && observed != nullptr)
    kept.bias = observed->space * (observed->core[kept.datum.time_index] * result.bias.functions);
  for (assimilation::NamedForecast& forecast : kept.forecasts)
    forecast.forecast.points.clear(), forecast.forecast.density.clear();
  return kept;
}

StepDraws draw_step(const KeptStep& step, const model::ObservedModel& observed,
                    std::span<const posterior::Prior> priors, Eigen::Index rows, Eigen::Index draws,
                    Eigen::Index stride) {
  const auto d = std::ssize(priors);
  Eigen::VectorXd lower(d), upper(d);
  for (Eigen::Index k = 0; k < d; ++k) lower[k] = priors[k].lower(), upper[k] = priors[k].upper();
  const assimilation::UpdateResult& result = step.result;
  StepDraws out{numerics::distinct_draws(result.points, result.weights, draws, lower, upper), {}, {}};
  model::FunctionBatch batch;
  batch.resize(draws, d, observed.functions->count(), 0);
  observed.functions->evaluate(out.parameters, 0, batch);
  const std::size_t t = step.datum.time_index;
  // Forces and gauges stand behind the displacements.
  const Eigen::Index all = std::min(observed.observations(), step.datum.values.size());
  Eigen::MatrixXd predicted =
      observed.space.topRows(all) * (observed.core[t] * batch.value.transpose()).eval();
  predicted.colwise() += observed.lift.col(t).head(all);
  if (step.bias.size() > 0) predicted.topRows(step.bias.size()).colwise() += step.bias;
  out.log_likelihood = likelihood::log_likelihoods(predicted, step.datum.values.head(all), *step.datum.noise);
  const Eigen::Index shown = (draws + stride - 1) / stride;
  const Eigen::Index there = std::min(rows, all);
  out.predicted.setConstant(rows, shown, k_missing);
  out.predicted.topRows(there) = predicted.topRows(there)(Eigen::all, Eigen::seqN(0, shown, stride)) +
                                 likelihood::noise_draws(*step.datum.noise, there, shown, result.step);
  return out;
}

void write_posterior_file(const std::string& path, const PosteriorFile& file) {
  files::write_atomically(path, [&](const std::string& temporary) {
    files::NetcdfWriter out(temporary);
    Writer writer(out, file);
    writer.write_draws();
    writer.write_data();
    writer.write_statistics();
    writer.write_forecasts();
    writer.write_weighted_points();
    writer.describe_groups();
    out.add_attribute("", "created_by", k_created_by);
    out.add_attribute("", "project", file.project.text);
    out.add_attribute("", "seed", std::to_string(file.project.method.seed));
    out.add_attribute("", "verdict", files::json_line(verdict_record(file.verdict)));
    out.close();
  });
}

assimilation::UpdateResult read_last_posterior(const std::string& path,
                                               const std::vector<std::string>& parameters) {
  const files::Hdf5Reader file(path);
  const std::string names = file.text_attribute("/weighted_posterior", "parameters");
  if (names != fmt::format("{}", fmt::join(parameters, ","))) {
    throw DataError(fmt::format("{}: holds the posterior of {}, not of {}: run `knothe assimilate` again",
                                path, names, fmt::join(parameters, ",")));
  }
  // Files before 0.2 have the last step among the others only.
  const bool apart = file.has("/last_posterior");
  const std::string group = apart ? "/last_posterior/" : "/weighted_posterior/";
  const files::Shape shape = file.shape(group + "points");
  if (shape.size() != (apart ? 2 : 3) || shape[0] == 0 || shape.back() != parameters.size())
    throw DataError(path + ": weighted_posterior/points must have the shape [step, point, parameter]");
  assimilation::UpdateResult stored;
  std::vector<double> points, weights;
  if (apart) {
    points = file.read(group + "points");
    weights = file.read(group + "weights", files::Shape{shape[0]});
    stored.step = file.number_attribute(group + "weights", "step");
    stored.time = file.number_attribute(group + "weights", "time");
  } else {
    const std::size_t last = shape[0] - 1;
    points = file.read_slab(group + "points", {last, 0, 0}, {1, shape[1], shape[2]});
    weights = file.read_slab(group + "weights", {last, 0}, {1, shape[1]});
    stored.step = file.read(group + "step")[last];
    stored.time = file.read("/sample_stats/time")[last];
  }
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto n = std::ssize(weights), d = std::ssize(parameters);
  stored.points = Eigen::Map<const RowMajor>(points.data(), n, d);
  stored.weights = Eigen::Map<const Eigen::VectorXd>(weights.data(), n);
  return stored;
}

}  // namespace knothe::record
