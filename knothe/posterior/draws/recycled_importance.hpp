#pragma once
/// @file Importance sampling that recycles all its draws: for densities that cost so much that each
/// evaluation has to count.
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/mode_search.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {

struct RecycledImportanceOptions {
  /// Done when the stated errors are within this share of the tolerances.
  double share_of_tolerance = ImportanceResult::k_share_of_tolerance;
  Eigen::Index draws = 1000;  ///< of a round
  std::int64_t max_evaluations = 20000;
  /// What counts towards `max_evaluations`, derivatives too; empty: the evaluations made here.
  std::function<std::int64_t()> spent = {};
  std::uint64_t seed = 1;
  /// Modes that are known already: where draws from N(0, I) do not lead on, others are made around these.
  std::vector<Mode> modes = {};
  /// From the density's own variables to those whose means and standard deviations count (n × d); empty: the
  /// same.
  std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)> variables = {};
  std::function<bool(double)> progress = {};  ///< with the share of `max_evaluations`; false interrupts
  /// Whether walks from the outermost draws look for mass beyond them before the draws are called good.
  bool looks_beyond = true;
};

struct RecycledImportanceResult : ImportanceResult {
  std::vector<double> temperatures;  ///< β of each round
};

/// Adaptive multiple importance sampling (Cornuet, Marin, Mira, Robert 2012) along ρ^{1−β} π̄^β, ρ = N(0, I).
/// All draws so far, whichever proposal they come from, are weighted as draws from the mixture of all
/// proposals so far; β is the largest for which the weights are worth enough draws; the next proposal is
/// fitted to them (`ImportanceProposal`), those far from the mean counted more. Draws at low β keep sight of
/// modes far away. Where β is still below 1 after eight rounds, or so few draws have any density that nothing
/// can be fitted to them, the mass is far away or small: then draws come from Laplace approximations as well,
/// at the modes found by ascent from four draws, for which alone derivatives are asked for. Draws that look
/// good are judged by walks from the outermost of them (`walk_outwards`); where these find mass, draws are
/// made there and rounds go on. A function of the target and the options alone. Errors: NumericalError if the
/// target is zero at all first draws; Interrupted; those of the target.
[[nodiscard]] RecycledImportanceResult recycled_importance(LogDensity& target,
                                                           const RecycledImportanceOptions& options = {});

}  // namespace knothe::posterior
