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
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/draws/importance_proposal.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"
#include "knothe/posterior/weighted_posterior_file.hpp"
#include "knothe/record/fields.hpp"
#include "knothe/record/physical_parameters.hpp"
#include "knothe/record/prior_values.hpp"
#include "knothe/record/results.hpp"
#include "knothe/record/step_record.hpp"

namespace knothe::record {
namespace {

using Names = std::vector<std::string>;
using files::SinglePrecision;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
/// Independent draws need no chains, but what compares chains (r̂) does.
constexpr Eigen::Index k_chains = 4;
constexpr Eigen::Index k_predicted_values = 2'000'000;  ///< at most, in all: 8 MB
constexpr Eigen::Index k_prior_values = k_predicted_values / 4;
constexpr double k_nothing = 1e-6;           ///< a smaller range of a log density
constexpr Eigen::Index k_enough_draws = 25;  ///< of a chain, to say how probable each value is
constexpr std::uint64_t k_prior_seed = 1;
constexpr Eigen::Index k_weighted_points = 2048;  ///< of each step but the last, at most
constexpr double k_missing = std::numeric_limits<double>::quiet_NaN();

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

/// Draws of a distribution of the parameters, four chains, and what the model's functions are at every
/// `stride`-th of them.
struct Draws {
  Eigen::MatrixXd parameters;
  Eigen::Index stride = 1, per_chain = 0;  ///< of those with functions
  Eigen::MatrixXd functions;               ///< chosen × r, chain after chain
  [[nodiscard]] Eigen::Index chosen() const { return functions.rows(); }
};

class Writer {
 public:
  Writer(files::NetcdfWriter& out, const PosteriorFile& file)
      : out_(out),
        file_(file),
        n_steps_(file.steps.size()),
        n_observations_(file.sensors.displacement_count()),
        n_rows_(file.observed.observations()) {
    for (const KeptStep& step : file.steps) {
      steps_.push_back(step.result.step);
      times_.push_back(step.result.time);
    }
  }

  /// posterior, posterior_predictive, log_likelihood.
  void write_posterior() {
    const Eigen::Index n = k_chains * file_.draws;
    const auto d = std::ssize(file_.priors);
    Eigen::VectorXd lower(d), upper(d);
    for (Eigen::Index k = 0; k < d; ++k) {
      const posterior::Prior& prior = file_.priors[k];
      lower[k] = prior.lower(), upper[k] = prior.upper();
    }
    const posterior::Posterior& last = file_.steps.back().result;
    const Eigen::MatrixXd parameters = numerics::distinct_draws(last.points, last.weights, n, lower, upper);
    add_draws("posterior", file_.axes, parameters, k_chains, out_);
    const Draws draws = drawn(parameters, k_predicted_values);
    write_predictions("posterior_predictive", draws, true);
    write_log_likelihood(draws);
  }

  /// prior, prior_predictive.
  void write_prior() {
    const posterior::PriorTransform transform({file_.priors.begin(), file_.priors.end()});
    const Eigen::MatrixXd z =
        numerics::monte_carlo_normal_points(k_chains * file_.draws, transform.dimension(), k_prior_seed);
    const Eigen::MatrixXd parameters = transform.points(z);
    add_draws("prior", file_.axes, parameters, k_chains, out_);
    write_predictions("prior_predictive", drawn(parameters, k_prior_values), false);
  }

  void write_data() {
    const std::string group = "observed_data";
    add_steps(group);
    for (const auto& [name, series] : file_.series) {
      const auto row = std::find(file_.sensors.scalars.begin(), file_.sensors.scalars.end(), name);
      if (row == file_.sensors.scalars.end() &&
          series.values.size() == n_steps_)  // a clock, a known parameter
        out_.add_variable(group, variable_of(name), Names{"step"}, series.values, {series.units, "measured"});
    }
    Eigen::MatrixXd values = Eigen::MatrixXd::Constant(n_rows_, n_steps_, k_missing);
    for (std::size_t s = 0; s < n_steps_; ++s) {
      const Eigen::VectorXd& measured = file_.steps[s].datum.values;
      const Eigen::Index there = std::min(n_rows_, measured.size());
      values.col(s).head(there) = measured.head(there);
    }
    for (std::size_t k = 0; k < file_.sensors.scalars.size(); ++k) {
      const std::string& name = file_.sensors.scalars[k];
      const Eigen::VectorXd row = values.row(n_observations_ + k);
      out_.add_variable(group, variable_of(name), Names{"step"}, std::span(row.data(), row.size()),
                        {units_of(name), "measured"});
      if (const auto series = file_.series.find(name); series != file_.series.end() && series->second.std)
        out_.add_number(group, variable_of(name), "std", *series->second.std);
    }
    if (n_observations_ == 0) return;
    add_observations(group);
    const Eigen::MatrixXd displacements = values.topRows(n_observations_);
    out_.add_variable(group, "displacement", Names{"step", "observation"},
                      std::span(displacements.data(), displacements.size()), {"m", "measured displacement"});
    write_constants();
  }

  /// What is said of each step: its moments, and how they were found.
  void write_history() {
    const std::string group = "history";
    out_.add_dimension(group, "step", steps_, {"", "assimilated step"});
    out_.add_attribute(group, "coordinates", "time");
    std::vector<const assimilation::UpdateResult*> steps;
    for (const KeptStep& step : file_.steps) steps.push_back(&step.result);
    add_statistics(group, steps, out_);
    add_by_step("verdict", "0 ok, 1 caution, 2 reject",
                [](const auto& r) -> double { return static_cast<int>(r.verdict.level); });
    add_by_step("fit_probability", "of a misfit as large as that of all data so far",
                [](const auto& r) { return r.verdict.fit_probability; });
    Names reasons, names;
    for (const KeptStep& step : file_.steps) {
      Names messages;
      for (const assimilation::VerdictReason& reason : step.result.verdict.reasons)
        messages.push_back(fmt::format("{}: {}", to_text(reason.part), reason.message));
      reasons.push_back(fmt::format("{}", fmt::join(messages, "; ")));
    }
    out_.add_variable(group, "verdict_reasons", Names{"step"}, reasons, {"", "why, where not ok"});
    for (const model::Axis& axis : file_.axes) names.push_back(axis.name);
    out_.add_dimension(group, "parameter", names, {"", "parameter"});
    out_.add_dimension(group, "level", numerics::k_quantile_levels, {"1", "of the quantiles"});
    std::vector<double> mean, std, quantiles;
    for (const KeptStep& step : file_.steps) {
      append(mean, step.result.mean);
      append(std, step.result.standard_deviations());
      append(quantiles, step.result.quantiles);
    }
    out_.add_variable(group, "mean", Names{"step", "parameter"}, mean, {"1", "of the posterior of the step"});
    out_.add_variable(group, "std", Names{"step", "parameter"}, std, {"1", "of the posterior of the step"});
    out_.add_variable(group, "quantiles", Names{"step", "parameter", "level"}, quantiles,
                      {"1", "of the posterior of the step"});
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
    add_prior_values("last_posterior", file_.priors, last.points, out_);
    out_.add_number("last_posterior", "weights", "step", steps_.back());
    out_.add_number("last_posterior", "weights", "time", times_.back());
  }

  /// What each group is, for those who open the file without this page.
  void describe_groups() {
    using Text = std::pair<const char*, const char*>;
    for (const auto& [group, text] :
         {Text{"posterior", "independent draws from the posterior of all data; the chains only divide them"},
          Text{"posterior_predictive", "what the sensors would measure under the draws, noise included"},
          Text{"log_likelihood", likelihood_text_}, Text{"prior", "independent draws from the prior"},
          Text{"prior_predictive",
               "what the sensors would measure under draws from the prior, noise included"},
          Text{"observed_data", "measured values"}, Text{"sample_stats", "of each draw"},
          Text{"history", "of the posterior after each step: moments, computation and verdict"},
          Text{"weighted_posterior", "weighted points of each step's posterior, at most 2048"},
          Text{"last_posterior", "all weighted points of the last step's posterior"}})
      out_.add_attribute(group, "description", text);
    add_creator({"posterior", "posterior_predictive", "log_likelihood", "prior", "prior_predictive",
                 "observed_data", "sample_stats"},
                out_);
  }

 private:
  /// As many of the draws as `values` numbers allow, with their functions.
  [[nodiscard]] Draws drawn(const Eigen::MatrixXd& parameters, Eigen::Index values) const {
    const Eigen::Index all = parameters.rows() / k_chains, numbers = std::ssize(steps_) * n_rows_;
    const Eigen::Index wanted =
        std::clamp<Eigen::Index>(values / std::max<Eigen::Index>(1, k_chains * numbers), 1, all);
    Draws draws{parameters, (all + wanted - 1) / wanted, 0, {}};
    draws.per_chain = (all + draws.stride - 1) / draws.stride;
    Eigen::MatrixXd chosen(k_chains * draws.per_chain, parameters.cols());
    for (Eigen::Index chain = 0, row = 0; chain < k_chains; ++chain)
      for (Eigen::Index j = 0; j < all; j += draws.stride)
        chosen.row(row++) = parameters.row(chain * all + j);
    model::FunctionBatch batch;
    batch.resize(chosen.rows(), chosen.cols(), file_.observed.functions->count(), 0);
    file_.observed.functions->evaluate(chosen, 0, batch);
    draws.functions = batch.value;
    return draws;
  }

  /// The model at a step under the draws, rows × chosen; with the correction of its bias where there is one.
  [[nodiscard]] Eigen::MatrixXd predicted(const KeptStep& step, const Draws& draws, bool corrected) const {
    const std::size_t t = step.datum.time_index;
    Eigen::MatrixXd values =
        file_.observed.space * (file_.observed.core[t] * draws.functions.transpose()).eval();
    values.colwise() += file_.observed.lift.col(t);
    if (corrected && step.bias.size() > 0) values.topRows(step.bias.size()).colwise() += step.bias;
    if (corrected && step.error.size() > 0) values.colwise() += step.error.head(n_rows_);
    return values;
  }

  /// Values of each step, rows × chosen, into a group: displacements, and each series.
  void write_by_step(const std::string& group, const Draws& draws, const std::vector<Eigen::MatrixXd>& steps,
                     const std::string& units, const std::string& meaning) {
    // 32 bits would make steps of log densities that draws hardly change, and Pareto's k of these.
    const auto stored = [&](std::span<const double> values) -> files::NetcdfValues {
      return units.empty() ? files::NetcdfValues(SinglePrecision{values}) : files::NetcdfValues(values);
    };
    const Eigen::Index n = draws.chosen(), n_displacements = n_observations_;
    std::vector<double> all;
    all.reserve(n * n_steps_ * n_displacements);
    for (Eigen::Index j = 0; j < n; ++j)
      for (const Eigen::MatrixXd& step : steps) append(all, step.col(j).head(n_displacements));
    if (n_displacements > 0)
      out_.add_variable(group, "displacement", Names{"chain", "draw", "step", "observation"}, stored(all),
                        {units.empty() ? "m" : units, meaning});
    for (std::size_t k = 0; k < file_.sensors.scalars.size(); ++k) {
      std::vector<double> series;
      for (Eigen::Index j = 0; j < n; ++j)
        for (const Eigen::MatrixXd& step : steps) series.push_back(step(n_displacements + k, j));
      const std::string& name = file_.sensors.scalars[k];
      out_.add_variable(group, variable_of(name), Names{"chain", "draw", "step"}, stored(series),
                        {units.empty() ? units_of(name) : units, meaning});
    }
  }

  void write_predictions(const std::string& group, const Draws& draws, bool corrected) {
    std::vector<Eigen::MatrixXd> steps;
    for (const KeptStep& step : file_.steps) {
      const Eigen::Index there = std::min(n_rows_, step.datum.values.size());
      steps.push_back(Eigen::MatrixXd::Constant(n_rows_, draws.chosen(), k_missing));
      steps.back().topRows(there) =
          predicted(step, draws, corrected).topRows(there) +
          likelihood::noise_draws(*step.datum.noise, there, draws.chosen(), step.result.step);
    }
    add_groups_dimensions(group, draws);
    write_by_step(group, draws, steps, "",
                  "what the sensors would measure: model, bias where it is corrected, and noise");
  }

  /// Of each value where there are draws enough, else of all values of a step together.
  void write_log_likelihood(const Draws& draws) {
    const std::string group = "log_likelihood";
    bool by_value = draws.per_chain >= std::min(k_enough_draws, file_.draws);
    for (const KeptStep& step : file_.steps)
      by_value = by_value && likelihood::can_be_split(step.datum.values, *step.datum.noise);
    std::vector<Eigen::MatrixXd> steps;
    Eigen::MatrixXd sums(draws.chosen(), n_steps_);
    for (const KeptStep& step : file_.steps) {
      const Eigen::Index there = std::min(n_rows_, step.datum.values.size());
      const Eigen::MatrixXd values = predicted(step, draws, true).topRows(there);
      const Eigen::VectorXd measured = step.datum.values.head(there);
      sums.col(std::ssize(steps)) = likelihood::log_likelihoods(values, measured, *step.datum.noise);
      steps.push_back(Eigen::MatrixXd::Zero(n_rows_, draws.chosen()));
      if (!by_value) continue;
      Eigen::MatrixXd split = likelihood::pointwise_log_likelihoods(values, measured, *step.datum.noise);
      for (auto row : split.rowwise())  // what says nothing is one number: rounding has no tail to be fitted
        if (row.maxCoeff() - row.minCoeff() < k_nothing) row.setConstant(row.mean());
      steps.back().topRows(there) = split;
    }
    if (by_value) {
      likelihood_text_ =
          "log density of each measured value given the draw and the other values of its step; 0 where "
          "nothing was measured; errors that steps share are not in it";
      add_groups_dimensions(group, draws);
      write_by_step(group, draws, steps, "1", "log density");
    } else {
      likelihood_text_ =
          "log density of the values of each step given the draw; errors that steps share are not in it";
      add_chains(group, k_chains, draws.per_chain, draws.stride, out_);
      add_steps(group);
      const RowMajor rows = sums;
      out_.add_variable(group, n_observations_ > 0 ? "displacement" : "series",
                        Names{"chain", "draw", "step"}, std::span(rows.data(), rows.size()),
                        {"1", "log density"});
    }
    add_chains("sample_stats", k_chains, draws.per_chain, draws.stride, out_);
    const Eigen::VectorXd total = sums.rowwise().sum();
    out_.add_variable("sample_stats", "log_likelihood", Names{"chain", "draw"},
                      std::span(total.data(), total.size()),
                      {"1", "log density of the values of all steps given the draw"});
  }

  void add_groups_dimensions(const std::string& group, const Draws& draws) {
    add_chains(group, k_chains, draws.per_chain, draws.stride, out_);
    add_steps(group);
    if (n_observations_ > 0) add_observations(group);
  }

  [[nodiscard]] std::string units_of(const std::string& series) const {
    const auto found = file_.series.find(series);
    return found == file_.series.end() ? "" : found->second.units;
  }

  void write_constants() {
    const std::string group = "constant_data";
    add_observations(group);
    out_.add_dimension(group, "axis", Names{"x", "y", "z"}, {"1", "direction"});
    out_.add_variable(group, "points", Names{"observation", "axis"}, file_.sensors.points,
                      {"m", "measurement points"});
    const std::vector<std::int64_t> components(file_.sensors.components.begin(),
                                               file_.sensors.components.end());
    out_.add_variable(group, "component", Names{"observation"}, components, {"1", "0 x, 1 y, 2 z"});
    const Eigen::VectorXd std = file_.noise.standard_deviations();
    out_.add_variable(group, "noise_std", Names{"observation"}, std::span(std.data(), n_observations_),
                      {"m", "standard deviation"});
  }

  void write_points(const std::string& group, Names dimensions, std::span<const double> points,
                    std::span<const double> weights) {
    Names names;
    for (const model::Axis& axis : file_.axes) names.push_back(axis.name);
    out_.add_variable(group, "weights", dimensions, weights, {"1", "importance weights, sum 1"});
    dimensions.emplace_back("parameter");
    out_.add_dimension(group, "parameter", names, {"", "parameter"});
    out_.add_variable(group, "points", dimensions, points, {"1", "parameters"});
    out_.add_attribute(group, "parameters", fmt::format("{}", fmt::join(names, ",")));
  }

  void add_steps(const std::string& group) {
    out_.add_dimension(group, "step", steps_, {"", "assimilated step"});
    out_.add_variable(group, "time", Names{"step"}, times_, {"1", "model time"});
    out_.add_attribute(group, "coordinates", "time");
  }

  /// The sensors: a name, place and component of each.
  void add_observations(const std::string& group) {
    const model::Sensors& sensors = file_.sensors;
    Names names, directions;
    std::array<std::vector<double>, 3> places;
    for (Eigen::Index i = 0; i < n_observations_; ++i) {
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
  void add_by_step(const std::string& name, const std::string& meaning, const Get& get) {
    std::vector<double> values;
    for (const KeptStep& step : file_.steps) values.push_back(get(step.result));
    out_.add_variable("history", name, Names{"step"}, values, {"1", meaning});
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
  std::size_t n_steps_;
  Eigen::Index n_observations_, n_rows_;
  const char* likelihood_text_ = "";
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

void write_posterior_file(const std::string& path, const PosteriorFile& file) {
  files::write_atomically(path, [&](const std::string& temporary) {
    files::NetcdfWriter out(temporary);
    Writer writer(out, file);
    writer.write_posterior();
    writer.write_prior();
    writer.write_data();
    writer.write_history();
    writer.write_forecasts();
    writer.write_weighted_points();
    writer.describe_groups();
    out.add_attribute("", "title", "Bayesian assimilation: posterior of the parameters, forecasts, verdict");
    out.add_attribute("", "created_by", k_created_by);
    out.add_attribute("", "project", file.project);
    out.add_attribute("", "seed", std::to_string(file.seed));
    out.add_attribute("", "verdict", files::json_line(verdict_record(file.verdict)));
    out.close();
  });
}

assimilation::UpdateResult read_last_posterior(const std::string& path,
                                               const std::vector<std::string>& parameters) {
  posterior::WeightedPosterior found = posterior::read_weighted_posterior(path);
  if (found.parameters != parameters) {
    throw DataError(fmt::format("{}: holds the posterior of {}, not of {}: run `knothe assimilate` again",
                                path, fmt::join(found.parameters, ","), fmt::join(parameters, ",")));
  }
  const files::Hdf5Reader file(path);
  assimilation::UpdateResult stored;
  if (file.has("/last_posterior")) {
    stored.step = file.number_attribute("/last_posterior/weights", "step");
    stored.time = file.number_attribute("/last_posterior/weights", "time");
  } else {
    stored.step = file.read("/weighted_posterior/step").back();
    stored.time = file.read("/sample_stats/time").back();
  }
  if (file.has_attribute("/", "verdict"))
    stored.verdict =
        read_verdict(nlohmann::json::parse(file.text_attribute("/", "verdict"), nullptr, false), path);
  stored.points = std::move(found.points);
  stored.weights = std::move(found.weights);
  return stored;
}

}  // namespace knothe::record
