#pragma once
/// @file §6.4: a model with too few modes, and its correction.
#include <string>
#include <vector>

#include "knothe/reproduction/experiment.hpp"

namespace knothe::reproduction {

/// The same data, from m = 6, assimilated in five ways.
struct BiasRuns {
  Run reference;  ///< with m = 6
  Run biased;     ///< with m = 3
  Run published;  ///< with m = 3, Eq. 16-20 to the letter: two modes, extrapolated by a line
  Run corrected;  ///< the same, and what the modes were off by lately added to the covariance ("linear")
  Run joint;      ///< with m = 3, the discrepancy unknown together with the parameters (knothe's default)
};

/// An update with a correction of model bias, two modes and a line where it is extrapolated.
[[nodiscard]] assimilation::UpdateOptions corrected_options(assimilation::BiasCorrectionMode mode,
                                                            assimilation::BiasOptions::Way way,
                                                            std::uint64_t seed);

/// `with_joint`: also the last one, which takes the longest. `marginals`: for plots.
[[nodiscard]] BiasRuns bias_runs(const reduction::SeparatedModel& paper, const reduction::SeparatedModel& few,
                                 const Sensors& sensors, const assimilation::Measurements& data,
                                 std::uint64_t seed, bool marginals, bool with_joint);

/// The data less what Eq. 17-20 (`published`) extrapolate to each from the residuals that the model has at
/// the true parameters without noise, `exact` (n × n_t) being what the sensors would show.
[[nodiscard]] assimilation::Measurements less_true_residual(const reduction::ObservedModel& model,
                                                            const Eigen::VectorXd& truth,
                                                            const Eigen::MatrixXd& exact,
                                                            assimilation::Measurements data);

/// Increments of the log-evidence, step by step.
[[nodiscard]] std::vector<double> evidence_increments(const Run& run);
/// Moving average over `width` values around each; fewer at the ends.
[[nodiscard]] std::vector<double> smoothed(const std::vector<double>& values, std::size_t width);

}  // namespace knothe::reproduction
