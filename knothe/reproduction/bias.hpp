#pragma once
/// @file §6.4: a model with too few modes, and its correction.
#include <string>
#include <vector>

#include "knothe/reproduction/experiment.hpp"

namespace knothe::reproduction {

/// The same data, from m = 6, assimilated in four ways.
struct BiasRuns {
  Run reference;  ///< with m = 6
  Run biased;     ///< with m = 3
  Run corrected;  ///< with m = 3, corrected as in the paper: two modes, extrapolated by a line (Eq. 16-20)
  Run joint;      ///< with m = 3, the discrepancy unknown together with the parameters (knothe's default)
};

/// `with_joint`: also the last one, which takes the longest. `marginals`: for plots.
[[nodiscard]] BiasRuns bias_runs(const reduction::SeparatedModel& paper, const reduction::SeparatedModel& few,
                                 const Sensors& sensors, const assimilation::Measurements& data,
                                 std::uint64_t seed, bool marginals, bool with_joint);

/// Increments of the log-evidence, step by step.
[[nodiscard]] std::vector<double> evidence_increments(const Run& run);
/// Moving average over `width` values around each; fewer at the ends.
[[nodiscard]] std::vector<double> smoothed(const std::vector<double>& values, std::size_t width);

}  // namespace knothe::reproduction
