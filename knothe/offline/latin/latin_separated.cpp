#include "knothe/offline/latin/latin_separated.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/model/reduced/deviation.hpp"
#include "knothe/offline/latin/latin_activation.hpp"
#include "knothe/offline/latin/latin_prediction.hpp"
#include "knothe/offline/latin/latin_separated_stage.hpp"
#include "knothe/offline/latin/latin_separation.hpp"
#include "knothe/offline/latin/latin_state.hpp"

namespace knothe::offline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double k_min_relaxation = 0.125;
constexpr double k_much_worse = 2;          // energy error after an update / before
constexpr double k_start_tolerance = 1e-3;  // of the separation of a hybrid start

class LatinSeparated {
 public:
  LatinSeparated(std::shared_ptr<const Structure> structure, const SolverOptions& loading,
                 const std::vector<model::Axis>& axes, std::span<const DamageParameters> parameters,
                 const SeparatedOptions& options);
  SeparatedSolution run();

 private:
  [[nodiscard]] LatinSeparatedStage stage() const {
    return {body_,          basis_,          grid_, parameters_, terms_, loading_.displacement,
            loading_.steps, options_.threads};
  }
  [[nodiscard]] double cpu_seconds() const {
    return static_cast<double>(std::clock() - start_) / CLOCKS_PER_SEC;
  }
  [[nodiscard]] int steps() const { return terms_.time.rows(); }
  void begin();
  /// Goes on from the state file, if there is one of this run.
  bool resume();
  void note_state();
  void save_state();
  /// The range becomes [0, steps): functions of time go on along the line through their last two values.
  void extend(int steps);
  /// Cells join that are damaged, or nearly, at the steps from `first` on.
  bool activate(int first);
  void stop_if_asked();
  /// Iterates over the range. Whether it became accurate.
  bool solve_range();
  /// A term more. False if there is nothing to gain.
  bool enrich(const SeparatedStageResult& result, const LatinCorrection& correction);
  void recompress();
  /// Recompression of the last range. Whether what is left is accurate; if that alone takes the accuracy
  /// away, nothing is left out.
  bool finish(bool accurate);
  /// A local stage on the iterate as it is, recorded. Whether it is accurate.
  bool is_accurate();
  void record_stage(const SeparatedStageResult& result, double correction, int round);

  const SolverOptions loading_;
  const std::vector<DamageParameters> parameters_;
  const SeparatedOptions options_;
  LatinBody body_;
  LatinBasis basis_;
  LatinGrid grid_;
  LatinTerms terms_;
  std::vector<double> thresholds_;
  double relaxation_ = 1, energy_error_ = 1, indicator_ = 1;
  SeparatedSolution result_;
  std::clock_t start_ = std::clock();
  SeparatedState state_;  ///< at the start of the range; empty without a state file
  MonotonicTime saved_ = monotonic_now();
};

LatinSeparated::LatinSeparated(std::shared_ptr<const Structure> structure, const SolverOptions& loading,
                               const std::vector<model::Axis>& axes,
                               std::span<const DamageParameters> parameters, const SeparatedOptions& options)
    : loading_(loading),
      parameters_(parameters.begin(), parameters.end()),
      options_(options),
      body_(std::move(structure), loading.regularisation),
      basis_(body_),
      relaxation_(options.relaxation) {
  for (const model::Axis& axis : axes) {
    grid_.sizes.push_back(std::ssize(axis.nodes));
    grid_.weights.push_back(model::trapezoid_weights(axis.nodes));
    terms_.parameters.emplace_back(grid_.sizes.back(), 0);
  }
  if (grid_.points() != std::ssize(parameters_))
    throw UsageError(fmt::format("LATIN-PGD: the axes have {} grid points, and {} parameter points are given",
                                 grid_.points(), parameters_.size()));
  for (const DamageParameters& point : parameters_) {
    thresholds_.push_back(point.threshold);
    check_band(body_.structure().mesh(), loading.regularisation, body_.band_ratios(), point);
  }
  basis_.join(body_, {});
}

void LatinSeparated::begin() {
  if (options_.start.empty()) return;
  const LatinPrediction prediction(options_.start, body_.structure());
  for (int step = 0; step < loading_.steps; ++step) {
    const double imposed = loading_.displacement * (step + 1) / loading_.steps;
    const auto cells = prediction.joining(body_, step, imposed, thresholds_, options_.activation);
    if (!cells.empty()) basis_.join(body_, cells);
  }
  const MatrixXd forces =
      prediction.forces(body_, 0, loading_.steps, options_.recompression * options_.accuracy);
  for (Index k = 0; k < forces.cols(); ++k) (void)basis_.add(forces.col(k), 1e-8);
  if (basis_.size() == 0) return;
  std::vector<MatrixXd> expected;
  for (int step = 0; step < loading_.steps; ++step)
    expected.push_back(prediction.expected(body_, basis_, step));
  terms_ = separate(expected, grid_, options_.max_terms, k_start_tolerance);
  basis_.restore(basis_.modes());  // as a run that goes on from here has it
}

void LatinSeparated::extend(int steps) {
  const Index before = terms_.time.rows();
  terms_.time.conservativeResize(steps, terms_.space.cols());
  for (Index t = before; t < steps; ++t) {
    if (t == 0)
      terms_.time.row(t).setZero();
    else if (t == 1)
      terms_.time.row(t) = 2 * terms_.time.row(0);
    else
      terms_.time.row(t) = 2 * terms_.time.row(t - 1) - terms_.time.row(t - 2);
  }
}

bool LatinSeparated::resume() {
  if (options_.state_file.empty()) return false;
  std::optional<SeparatedState> state = read_state<SeparatedState>(options_.key, options_.state_file);
  if (!state) return false;
  basis_.join(body_, state->cells);
  basis_.restore(state->modes);
  terms_ = std::move(state->terms);
  relaxation_ = state->relaxation;
  indicator_ = state->indicator;
  result_.history = std::move(state->history);
  result_.solution.local_points = state->local_points;
  start_ -= static_cast<std::clock_t>(state->cpu_seconds * CLOCKS_PER_SEC);
  if (!options_.quiet)
    fmt::print(stderr, "LATIN-PGD, fully separated, goes on from step {} of {}, kept in {}\n", steps(),
               loading_.steps, options_.state_file);
  return true;
}

void LatinSeparated::note_state() {
  if (options_.state_file.empty()) return;
  const auto cells = body_.cells();
  state_ = {{cells.begin(), cells.end()},  basis_.modes(), terms_, relaxation_, indicator_, result_.history,
            result_.solution.local_points, cpu_seconds()};
  if (microseconds_since(saved_) > k_microseconds_between_saves) save_state();
}

void LatinSeparated::save_state() {
  if (options_.state_file.empty()) return;
  write_state(state_, options_.key, options_.state_file);
  saved_ = monotonic_now();
}

bool LatinSeparated::activate(int first) {
  if (body_.waiting().empty()) return false;
  const std::vector<MatrixXd> states = stage().states();
  const MatrixXd expanded = body_.expand(basis_.forces());
  bool joined = false;
  for (int step = first; step < steps(); ++step) {
    const Activation found = find_activation(body_, expanded, states[step], thresholds_, options_.activation);
    if (found.joining.empty()) continue;
    basis_.join(body_, found.joining);
    joined = true;
  }
  return joined;
}

bool LatinSeparated::enrich(const SeparatedStageResult& result, const LatinCorrection& correction) {
  std::optional<NewTerm> term = stage().rank_one(correction, options_.fixed_point);
  const LatinCandidate& worst = result.worst.front();
  if (!term)
    term = stage().rank_one({body_.flexibility() * worst.residual, worst.residual, 0}, options_.fixed_point);
  if (!term) return false;
  (void)basis_.add(term->force, 1e-5);
  terms_.append(basis_.forces().transpose() * term->displacement, term->functions.time,
                term->functions.parameters);
  terms_.normalise();
  return true;
}

void LatinSeparated::record_stage(const SeparatedStageResult& result, double correction, int round) {
  LatinSolution& solution = result_.solution;
  solution.residual.leftCols(steps()) = result.residual;
  solution.reaction.leftCols(steps()) = result.reaction;
  solution.local_points += grid_.points() * steps() * body_.point_count();
  energy_error_ = result.energy_error;
  result_.history.push_back({steps(), round, static_cast<int>(terms_.count()),
                             static_cast<int>(basis_.size()), result.energy_error, result.residual.maxCoeff(),
                             correction, indicator_, relaxation_, cpu_seconds()});
  if (!result.residual.allFinite())
    throw NumericalError(
        fmt::format("LATIN-PGD, fully separated: the iterate is no longer finite (steps 0 to {}, stage {}, "
                    "{} terms); take the joint form: leave [offline.latin] separation away",
                    steps() - 1, result_.history.size(), terms_.count()));
}

bool LatinSeparated::is_accurate() {
  const SeparatedStageResult result = stage().run();
  const double correction = stage().correct_worst(result.worst).bound;
  record_stage(result, correction, result_.history.empty() ? 0 : result_.history.back().round + 1);
  return correction <= options_.accuracy;
}

/// Relative change from `before` (of fewer modes, perhaps) to `now`.
double change(const std::vector<MatrixXd>& before, const std::vector<MatrixXd>& now) {
  double difference = 0, size = 0;
  for (Index t = 0; t < std::ssize(now); ++t) {
    const Index known = before[t].rows();
    difference += (now[t].topRows(known) - before[t]).squaredNorm() +
                  now[t].bottomRows(now[t].rows() - known).squaredNorm();
    size += now[t].bottomRows(now[t].rows() - 1).squaredNorm();
  }
  return size > 0 ? std::sqrt(difference / size) : 0;
}

void LatinSeparated::stop_if_asked() {
  if (!cancellation_requested()) return;
  save_state();
  const Index kept = state_.terms.time.rows();
  check_cancellation(
      fmt::format("LATIN-PGD, fully separated, at step {} of {}; {}", steps(), loading_.steps,
                  options_.state_file.empty() || kept == loading_.steps
                      ? "nothing is kept"
                      : fmt::format("{} steps are kept in {}; the same command goes on from there", kept,
                                    options_.state_file)));
}

bool LatinSeparated::solve_range() {
  double before = -1;
  bool enriched = true;  // the stage before added a term: that it gained little says nothing
  LatinTerms kept;       // before the last update
  for (int round = 0;; ++round) {
    stop_if_asked();
    SeparatedStageResult result = stage().run();
    const auto [correction, bound] = stage().correct_worst(result.worst);
    record_stage(result, bound, round);
    if (bound <= options_.accuracy) return true;
    const bool worse = before >= 0 && energy_error_ > before;
    const auto give_up = [&] {  // with the better of the last two iterates
      if (worse) terms_ = kept;
      return worse && is_accurate();
    };
    if (round + 1 >= options_.rounds) return give_up();
    std::vector<MatrixXd> states = stage().states();
    if (before >= 0 && energy_error_ > k_much_worse * before && relaxation_ > k_min_relaxation) {
      relaxation_ /= 2;  // the update was far too long: half of it
      terms_ = kept;
      states = stage().states();
      result = stage().run();
    } else {
      relaxation_ = worse ? std::max(std::min(k_min_relaxation, options_.relaxation), relaxation_ / 2)
                          : std::min(options_.relaxation, 1.4 * relaxation_);
      const bool stagnates = !enriched && energy_error_ > options_.stagnation * before;
      before = energy_error_;
      enriched = terms_.count() == 0 || stagnates;
      if (enriched) {
        if (terms_.count() >= options_.max_terms || !enrich(result, correction)) return give_up();
        result = stage().run();  // the equations of the longer basis
      }
      kept = terms_;
    }
    update_functions(result.projection, terms_, options_.sweeps, relaxation_, options_.threads);
    update_space(result.projection, terms_, relaxation_, options_.threads);
    indicator_ = change(states, stage().states());
  }
}

void LatinSeparated::recompress() {
  if (terms_.count() == 0 || options_.recompression == 0) return;
  // Where there is no room left, a tenth of the terms goes for those that later steps need.
  const bool full = terms_.count() >= options_.max_terms && steps() < loading_.steps;
  const Index most = full ? options_.max_terms * 9 / 10 : options_.max_terms;
  terms_ = with_fewer_terms(terms_, grid_, std::max<Index>(1, most), options_.recompression * energy_error_);
  const std::vector<MatrixXd> states = stage().states();
  MatrixXd all(basis_.size() + 1, grid_.points() * steps());
  for (int step = 0; step < steps(); ++step)
    all.middleCols(grid_.points() * step, grid_.points()) = states[step];
  const MatrixXd archived = basis_.directions() * terms_.space;
  basis_.recompress(basis_.to_archive(all), options_.recompression * options_.accuracy);
  terms_.space = basis_.directions().transpose() * archived;
  terms_.normalise();
}

bool LatinSeparated::finish(bool accurate) {
  if (terms_.count() == 0) return accurate;
  const LatinTerms terms = terms_;
  const auto modes = basis_.modes();
  recompress();
  if (is_accurate() || !accurate) return result_.history.back().correction <= options_.accuracy;
  basis_.restore(modes);
  terms_ = terms;
  return is_accurate();
}

SeparatedSolution LatinSeparated::run() {
  LatinSolution& solution = result_.solution;
  solution.residual = solution.reaction = MatrixXd::Zero(grid_.points(), loading_.steps);
  for (int step = 0; step < loading_.steps; ++step)  // before anything is damaged
    solution.reaction.col(step).setConstant(2 * body_.structure().unit_reaction() * loading_.displacement *
                                            (step + 1) / loading_.steps);
  Progress progress("LATIN-PGD, fully separated", loading_.steps, options_.quiet);
  if (!resume()) begin();
  bool accurate = true;
  do {
    if (options_.on_range) options_.on_range(steps());
    note_state();
    const int first = steps();
    if (first < loading_.steps) extend(std::min(loading_.steps, first + options_.window));
    do {
      if (body_.dof_count() > 0) accurate = solve_range();
    } while (activate(first < steps() ? first : 0));
    if (steps() < loading_.steps)
      recompress();
    else
      accurate = finish(accurate);
    if (result_.history.empty()) continue;
    const SeparatedIteration& now = result_.history.back();
    progress.advance_to(
        steps(),
        fmt::format("stage {}, {} terms, residual {:.1e}, correction {:.2g} µm, change {:.1e}",
                    result_.history.size(), now.terms, now.residual, 1e6 * now.correction, now.indicator));
  } while (steps() < loading_.steps);
  solution.accepted = Eigen::MatrixXi::Constant(grid_.points(), 1, accurate ? 1 : 0);
  solution.space = body_.expand(basis_.forces());
  solution.coordinates = stage().states();
  solution.active_cells = body_.cells().size();
  solution.cpu_seconds = cpu_seconds();
  if (std::error_code ignored; !options_.state_file.empty())
    std::filesystem::remove(options_.state_file, ignored);
  result_.terms = std::move(terms_);
  return std::move(result_);
}

}  // namespace

void SeparatedOptions::validate() const {
  const auto refuse = [](const std::string& why) {
    throw ProjectError("LATIN-PGD, fully separated: " + why);
  };
  if (!(accuracy > 0) || !std::isfinite(accuracy))
    refuse(fmt::format("accuracy is {} m; it must be positive", accuracy));
  if (window < 1) refuse(fmt::format("window is {} steps; it must be at least 1", window));
  if (max_terms < 1 || rounds < 1 || sweeps < 1 || fixed_point < 0)
    refuse(
        fmt::format("max_terms, rounds and sweeps are {}, {} and {}; they must be at least 1 (fixed_point, "
                    "{}, at least 0)",
                    max_terms, rounds, sweeps, fixed_point));
  if (!(relaxation > 0 && relaxation <= 1))
    refuse(fmt::format("relaxation is {}; it must be above 0 and at most 1", relaxation));
  if (!(stagnation > 0 && stagnation < 1))
    refuse(fmt::format("stagnation is {}; it must be between 0 and 1", stagnation));
  if (!(recompression >= 0 && recompression <= 1))
    refuse(fmt::format("recompression is {}; it must be from 0 to 1", recompression));
  if (!(activation > 0 && activation < 1))
    refuse(fmt::format("activation is {}; it must be between 0 and 1", activation));
}

SeparatedSolution solve_latin_separated(std::shared_ptr<const Structure> structure,
                                        const SolverOptions& loading, const std::vector<model::Axis>& axes,
                                        std::span<const DamageParameters> parameters,
                                        const SeparatedOptions& options) {
  options.validate();
  require_latin_problem(loading, parameters);
  return LatinSeparated(std::move(structure), loading, axes, parameters, options).run();
}

}  // namespace knothe::offline
