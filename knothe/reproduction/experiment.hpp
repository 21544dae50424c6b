#pragma once
/// @file Synthetic measurements of the beam, and what their assimilation gives, step by step.
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/data/measurements.hpp"
#include "knothe/assimilation/update/marginal_density.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/forecast/forecaster.hpp"
#include "knothe/reduction/model/separated_model.hpp"
#include "knothe/reduction/observe/observed_model.hpp"
#include "knothe/report/results/results.hpp"
#include "knothe/reproduction/published.hpp"

namespace knothe::reproduction {

using reduction::Sensors;

/// 30 nodes drawn at random from the outer face with |x| ≤ 120 mm, x and y components (§6.3.1: "in the
/// central part of the beam"): 60 dofs.
[[nodiscard]] Sensors random_nodes(const reduction::SeparatedModel& model, std::uint64_t seed);
/// The same as numbers of the model's dofs.
[[nodiscard]] std::vector<std::size_t> random_dofs(const reduction::Dofs& dofs, std::uint64_t seed);
/// The sensors with these numbers.
[[nodiscard]] Sensors part_of(const Sensors& sensors, std::span<const Eigen::Index> numbers);
[[nodiscard]] std::shared_ptr<const reduction::ObservedModel> observed(const reduction::SeparatedModel& model,
                                                                       const Sensors& sensors);

/// What the sensors show of `exact` (n × n_t), with white noise.
[[nodiscard]] assimilation::Measurements measure(const Eigen::MatrixXd& exact, const Sensors& sensors,
                                                 const std::vector<double>& time, std::uint64_t seed,
                                                 double noise_std = published::k_noise_std);
/// The displacements that a model predicts at parameters `p`, n × n_t.
[[nodiscard]] Eigen::MatrixXd predicted(const reduction::ObservedModel& model, const Eigen::VectorXd& p);

/// The paper's prior, of mean (0.9, 1.1) and covariance 0.2 I; the update truncates it to the model's box.
[[nodiscard]] std::vector<assimilation::Prior> paper_priors();
/// As the paper computes: one map per datum, composed, by BFGS with the gradient, to a diagnostic of 1e-3.
[[nodiscard]] assimilation::UpdateOptions paper_options(std::uint64_t seed);
/// As knothe computes by default: all data in one quadratic form and one map.
[[nodiscard]] assimilation::UpdateOptions default_options(std::uint64_t seed);

/// An assimilation from beginning to end.
struct Run {
  std::vector<std::string> parameters;
  std::vector<assimilation::Prior> priors;  ///< truncated
  std::vector<assimilation::UpdateResult> steps;
  std::vector<std::vector<assimilation::MarginalDensity>> marginals;  ///< step × parameter, if asked for
  std::vector<std::vector<forecast::NamedForecast>> forecasts;        ///< step × forecast, if asked for
  std::vector<std::vector<forecast::NamedForecast>> published;  ///< crack lengths by Eq. 33, beside them
  /// And with inverse maps of the field, after the first and the last step.
  std::vector<std::vector<forecast::NamedForecast>> published_by_map;
  std::vector<double> update_ms, forecast_ms;  ///< CPU time of each step

  [[nodiscard]] const assimilation::UpdateResult& last() const { return steps.back(); }
  [[nodiscard]] double mean(Eigen::Index k) const { return last().mean[k]; }
  [[nodiscard]] double std(Eigen::Index k) const { return std_at(steps.size() - 1, k); }
  [[nodiscard]] double std_at(std::size_t i, Eigen::Index k) const;
  /// Distance of the last mean from the truth, in standard deviations.
  [[nodiscard]] double off_by(Eigen::Index k, double truth) const;
  /// The same at the worst step and for the worse parameter, and that step.
  struct Distance {
    double std = 0;
    std::size_t step = 0;
  };
  [[nodiscard]] Distance worst_off(const Eigen::VectorXd& truth) const;
  /// Where the last marginal of a parameter is largest. Needs marginals.
  [[nodiscard]] double mode_of_marginal(std::size_t k) const;
  /// The first step at which the standard deviation is below `fraction` of the prior's; the number of steps
  /// if none is.
  [[nodiscard]] std::size_t first_below(Eigen::Index k, double fraction) const;
  /// Steps with a map of an order above 1.
  [[nodiscard]] std::vector<std::size_t> high_order_steps() const;
};

struct RunOptions {
  assimilation::UpdateOptions update;
  std::vector<std::size_t> steps;  ///< model times of the data used; empty: all
  bool marginals = false;
  forecast::Forecaster* forecaster = nullptr;
  std::string label;  ///< of the progress; empty: none shown
};

/// Assimilates the data (one column per model time). Throws Interrupted when the user asks to stop.
[[nodiscard]] Run assimilate(const std::shared_ptr<const reduction::ObservedModel>& model,
                             const assimilation::Measurements& data, const RunOptions& options);

/// The run as what `knothe report` draws; every `stride`-th step and the last.
[[nodiscard]] report::Results as_results(const Run& run, const Eigen::VectorXd& truth,
                                         std::size_t stride = 1);

}  // namespace knothe::reproduction
