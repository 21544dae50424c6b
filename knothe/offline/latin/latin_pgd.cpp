#include "knothe/offline/latin/latin_pgd.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <numeric>
#include <optional>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/offline/latin/latin_activation.hpp"
#include "knothe/offline/latin/latin_prediction.hpp"
#include "knothe/offline/latin/latin_stage.hpp"
#include "knothe/offline/latin/latin_state.hpp"

namespace knothe::offline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double k_microseconds_between_saves = 30e6;
constexpr std::size_t k_batch = 32;  // lanes of a batch; fixed, so that results do not depend on the threads

class LatinPgd {
 public:
  LatinPgd(std::shared_ptr<const Structure> structure, const SolverOptions& loading,
           std::span<const DamageParameters> parameters, const LatinOptions& options);
  LatinSolution run();

 private:
  [[nodiscard]] LaneBatch make_batch(std::span<const int> points) const;
  [[nodiscard]] std::vector<LatinStageResult> global_stage(const std::vector<int>& points, bool fresh,
                                                           bool rescue);
  void record_stage(const std::vector<LatinStageResult>& results, LatinIteration& record);
  /// Points that are not accurate enough yet; adds modes for the worst of them.
  [[nodiscard]] std::vector<int> enrich(const std::vector<LatinStageResult>& results, LatinIteration& record);
  void join(std::span<const std::int64_t> cells);
  /// Cells join; the points for which the window must be computed again.
  [[nodiscard]] std::vector<int> activate();
  /// Cells, modes and first iterates of the window that a hybrid start expects.
  void apply_prediction();
  void solve_window();
  /// Goes on from the state file, if there is one of this run.
  void resume();
  void note_state(int next_step);
  void save_state();
  void recompress();
  [[nodiscard]] MatrixXd archived_states(int first, int last) const;

  const SolverOptions loading_;
  const std::vector<DamageParameters> parameters_;
  const LatinOptions options_;
  LatinBody body_;
  LatinBasis basis_;
  const Index points_;
  std::vector<double> thresholds_;
  int first_ = 0, last_ = 0;  ///< the window
  MatrixXd history_, end_;    ///< P × n_g: damage before the window, and at its end
  MatrixXd expanded_;         ///< archived modes on all dofs
  std::optional<LatinPrediction> prediction_;
  std::vector<MatrixXd> expected_;  ///< first iterates of the window (LatinStage::expected)
  LatinSolution solution_;
  std::clock_t start_ = std::clock();
  LatinState state_;  ///< at the start of the window, but for `expanded`; empty without a state file
  Index expanded_columns_ = 0;  ///< of `expanded_` then; columns are only added, so that is all to keep
  MonotonicTime saved_ = monotonic_now();
};

LatinPgd::LatinPgd(std::shared_ptr<const Structure> structure, const SolverOptions& loading,
                   std::span<const DamageParameters> parameters, const LatinOptions& options)
    : loading_(loading),
      parameters_(parameters.begin(), parameters.end()),
      options_(options),
      body_(std::move(structure), loading.regularisation),
      basis_(body_),
      points_(std::ssize(parameters)),
      history_(points_, 0) {
  for (const DamageParameters& point : parameters_) {
    thresholds_.push_back(point.threshold);
    check_band(body_.structure().mesh(), loading.regularisation, body_.band_ratios(), point);
  }
  solution_.residual = solution_.reaction = MatrixXd::Zero(points_, loading.steps);
  for (int step = 0; step < loading.steps; ++step)
    solution_.coordinates.push_back(
        MatrixXd::Constant(1, points_, loading.displacement * (step + 1) / loading.steps));
  expanded_.resize(body_.structure().dof_count(), 0);
  basis_.join(body_, {});
  if (!options_.start.empty()) prediction_.emplace(options_.start, body_.structure());
}

LaneBatch LatinPgd::make_batch(std::span<const int> points) const {
  LaneBatch batch;
  batch.points.assign(points.begin(), points.end());
  batch.threshold = VectorXd::Constant(batch.padded(), k_never);
  batch.brittleness = VectorXd::Zero(batch.padded());
  batch.history = MatrixXd::Zero(batch.padded(), body_.point_count());
  for (Index i = 0; i < batch.size(); ++i) {
    const int point = batch.points[i];
    batch.threshold[i] = parameters_[point].threshold;
    batch.brittleness[i] = parameters_[point].brittleness;
    batch.history.row(i) = history_.row(point);
  }
  return batch;
}

std::vector<LatinStageResult> LatinPgd::global_stage(const std::vector<int>& points, bool fresh,
                                                     bool rescue) {
  const LatinStage stage{body_,          basis_,
                         options_.step,  loading_.displacement,
                         loading_.steps, solution_.coordinates,
                         first_,         last_,
                         fresh,          rescue,
                         expected_};
  std::vector<LatinStageResult> results((points.size() + k_batch - 1) / k_batch);
  parallel_for(results.size(), options_.threads, [&](std::size_t b) {
    const std::size_t begin = b * k_batch;
    results[b] =
        stage.run(make_batch(std::span(points).subspan(begin, std::min(k_batch, points.size() - begin))));
  });
  return results;
}

void LatinPgd::record_stage(const std::vector<LatinStageResult>& results, LatinIteration& record) {
  double change = 0, size = 0;
  for (int step = first_; step < last_; ++step) {
    MatrixXd& stored = solution_.coordinates[step];
    const Index before = stored.rows(), rows = basis_.archived() + 1;
    stored.conservativeResize(rows, Eigen::NoChange);
    stored.bottomRows(rows - before).setZero();
    const std::size_t column = step - first_;
    for (const LatinStageResult& result : results) {
      const MatrixXd now = basis_.to_archive(result.coordinates[column]);
      for (Index i = 0; i < now.cols(); ++i) {
        const Index point = result.points[i];
        change += (now.col(i) - stored.col(point)).tail(rows - 1).squaredNorm();
        size += now.col(i).tail(rows - 1).squaredNorm();
        stored.col(point) = now.col(i);
        solution_.residual(point, step) = result.residual(i, step - first_);
        solution_.reaction(point, step) = result.reaction(i, step - first_);
        record.residual = std::max(record.residual, result.residual(i, step - first_));
      }
    }
  }
  for (const LatinStageResult& result : results) {
    solution_.local_points += result.local_points;
    for (Index i = 0; i < std::ssize(result.points); ++i) end_.row(result.points[i]) = result.history.row(i);
  }
  record.indicator = size > 0 ? std::sqrt(change / size) : 0;
}

std::vector<int> LatinPgd::enrich(const std::vector<LatinStageResult>& results, LatinIteration& record) {
  struct Lane {
    const LatinCandidate* candidate;
    int point;
    bool open;  ///< may need modes
  };
  std::vector<Lane> lanes;
  for (const LatinStageResult& result : results)
    for (Index i = 0; i < std::ssize(result.points); ++i) {
      const double residual = result.residual.row(i).maxCoeff();
      lanes.push_back({&result.candidates[i], result.points[i],
                       result.solved[i] == 0 || !(residual <= options_.tolerance)});
    }
  std::erase_if(lanes, [](const Lane& lane) { return !lane.open; });
  std::stable_sort(lanes.begin(), lanes.end(), [](const Lane& a, const Lane& b) {
    return a.candidate->elastic_error > b.candidate->elastic_error;
  });
  const std::size_t count = std::min<std::size_t>(lanes.size(), options_.modes_per_round);
  std::vector<LatinCorrection> corrections(count);
  if (count > 0) corrections[0] = correct(body_, basis_, *lanes[0].candidate);
  // Where the worst is clearly good enough the others need not be looked at.
  if (count > 0 && corrections[0].size <= 0.5 * options_.accuracy) corrections.resize(1);
  parallel_for(corrections.size(), options_.threads, [&](std::size_t k) {
    if (k > 0) corrections[k] = correct(body_, basis_, *lanes[k].candidate);
  });
  // How much softer than elastic the body is for the forces at hand; the lanes that were not looked at are
  // judged by the softest.
  double softness = 1;
  std::vector<int> failing;
  for (Index k = 0; k < std::ssize(lanes); ++k) {
    const double elastic = lanes[k].candidate->elastic_error;
    if (k < std::ssize(corrections) && elastic > 0)
      softness = std::max(softness, corrections[k].size / elastic);
    const double error = k < std::ssize(corrections) ? corrections[k].size : softness * elastic;
    record.correction = std::max(record.correction, error);
    if (!(error <= options_.accuracy)) failing.push_back(lanes[k].point);
  }
  for (Index k = 0; k < std::ssize(corrections); ++k) {
    if (corrections[k].size <= options_.accuracy) continue;
    if (basis_.archived() >= options_.max_modes)
      throw NumericalError(
          fmt::format("LATIN-PGD: {} space modes do not reach an accuracy of {} m (step {}, still {:.2g} m); "
                      "ask for less accuracy, or allow more modes",
                      options_.max_modes, options_.accuracy, last_, record.correction));
    (void)basis_.add(corrections[k].force, 1e-5);
  }
  std::sort(failing.begin(), failing.end());
  return failing;
}

MatrixXd LatinPgd::archived_states(int first, int last) const {
  MatrixXd states = MatrixXd::Zero(basis_.archived() + 1, points_ * (last - first));
  for (int step = first; step < last; ++step) {
    const MatrixXd& stored = solution_.coordinates[step];
    states.block(0, points_ * (step - first), stored.rows(), points_) = stored;
  }
  return states;
}

std::vector<int> LatinPgd::activate() {
  const Index known = expanded_.cols();
  if (known < basis_.archived()) {
    expanded_.conservativeResize(Eigen::NoChange, basis_.archived());
    expanded_.rightCols(basis_.archived() - known) =
        body_.expand(basis_.archive().rightCols(basis_.archived() - known));
  }
  if (body_.waiting().empty()) return {};
  const Activation activation =
      find_activation(body_, expanded_ * basis_.directions(),
                      basis_.to_working(archived_states(last_ - 1, last_)), thresholds_, options_.activation);
  if (activation.joining.empty()) return {};
  join(activation.joining);
  return activation.missed;
}

void LatinPgd::join(std::span<const std::int64_t> cells) {
  const Index before = body_.point_count();
  basis_.join(body_, cells);
  for (MatrixXd* damage : {&history_, &end_}) {
    damage->conservativeResize(points_, body_.point_count());
    damage->rightCols(body_.point_count() - before).setZero();
  }
}

void LatinPgd::apply_prediction() {
  if (!prediction_) return;
  const double imposed = solution_.coordinates[last_ - 1](0, 0);
  const auto cells = prediction_->joining(body_, last_ - 1, imposed, thresholds_, options_.activation);
  if (!cells.empty()) join(cells);
  const MatrixXd forces = prediction_->forces(body_, first_, last_, options_.accuracy);
  for (Index k = 0; k < forces.cols() && basis_.archived() < options_.max_modes; ++k)
    (void)basis_.add(forces.col(k), 1e-5);
  expected_.clear();
  for (int step = first_ - 1; step < last_; ++step)
    expected_.push_back(prediction_->expected(body_, basis_, step));
}

void LatinPgd::solve_window() {
  std::vector<int> all(points_);
  std::iota(all.begin(), all.end(), 0);
  std::vector<int> pending = all;
  apply_prediction();
  end_ = history_;
  for (int round = 0;; ++round) {
    if (cancellation_requested()) {
      save_state();
      check_cancellation(
          fmt::format("LATIN-PGD at step {} of {}; {}", first_, loading_.steps,
                      options_.state_file.empty()
                          ? "nothing is kept"
                          : fmt::format("steps before it are kept in {}; the same command goes on from there",
                                        options_.state_file)));
    }
    LatinIteration record{first_,
                          last_,
                          round,
                          static_cast<int>(basis_.size()),
                          static_cast<int>(basis_.archived()),
                          static_cast<int>(pending.size())};
    const auto results = global_stage(pending, round == 0, round >= options_.rescue_round);
    record_stage(results, record);
    pending = enrich(results, record);
    record.cpu_seconds = 1.0 * (std::clock() - start_) / CLOCKS_PER_SEC;
    solution_.history.push_back(record);
    if (!pending.empty() && round + 1 < options_.rounds) continue;
    const std::vector<int> open = pending;
    pending = activate();  // there a cell that had been taken as elastic is not
    if (!pending.empty() && open.empty()) continue;
    pending = open;
    break;
  }
  for (const int point : pending) solution_.accepted(point, solution_.accepted.cols() - 1) = 0;
  history_ = end_;
}

void LatinPgd::recompress() {
  if (options_.recompression == 0 || basis_.archived() == 0) return;
  basis_.recompress(archived_states(first_, last_), options_.recompression * options_.accuracy);
}

void LatinPgd::resume() {
  if (options_.state_file.empty()) return;
  std::optional<LatinState> state = read_state(options_.key, options_.state_file);
  if (!state) return;
  basis_.join(body_, state->cells);
  basis_.restore(state->modes);
  history_ = std::move(state->history);
  expanded_ = std::move(state->expanded);
  solution_ = std::move(state->solution);
  first_ = state->next_step;
  start_ -= static_cast<std::clock_t>(solution_.cpu_seconds * CLOCKS_PER_SEC);
  if (!options_.quiet)
    fmt::print(stderr, "LATIN-PGD goes on from step {} of {}, kept in {}\n", first_, loading_.steps,
               options_.state_file);
}

void LatinPgd::note_state(int next_step) {
  if (options_.state_file.empty()) return;
  solution_.cpu_seconds = 1.0 * (std::clock() - start_) / CLOCKS_PER_SEC;
  const auto cells = body_.cells();
  state_ = {next_step, {cells.begin(), cells.end()}, basis_.modes(), history_, {}, solution_};
  expanded_columns_ = expanded_.cols();
  if (microseconds_since(saved_) > k_microseconds_between_saves) save_state();
}

void LatinPgd::save_state() {
  if (options_.state_file.empty()) return;
  state_.expanded = expanded_.leftCols(expanded_columns_);
  write_state(state_, options_.key, options_.state_file);
  state_.expanded.resize(0, 0);
  saved_ = monotonic_now();
}

LatinSolution LatinPgd::run() {
  Progress progress("LATIN-PGD", loading_.steps, options_.quiet);
  resume();
  for (; first_ < loading_.steps; first_ = last_) {
    note_state(first_);
    last_ = std::min(loading_.steps, first_ + options_.window);
    solution_.accepted.conservativeResize(points_, solution_.accepted.cols() + 1);
    solution_.accepted.rightCols(1).setOnes();
    solve_window();
    recompress();
    const LatinIteration& now = solution_.history.back();
    progress.advance_to(
        last_, fmt::format("stage {}, {} space modes, residual {:.1e}, correction {:.2g} µm, change {:.1e}",
                           solution_.history.size(), basis_.archived(), now.residual, 1e6 * now.correction,
                           now.indicator));
    if (options_.on_window) options_.on_window(last_);
  }
  for (MatrixXd& stored : solution_.coordinates) {
    const Index before = stored.rows();
    stored.conservativeResize(basis_.archived() + 1, Eigen::NoChange);
    stored.bottomRows(basis_.archived() + 1 - before).setZero();
  }
  solution_.space = body_.expand(basis_.archive());
  solution_.active_cells = body_.cells().size();
  solution_.cpu_seconds = 1.0 * (std::clock() - start_) / CLOCKS_PER_SEC;
  if (std::error_code ignored; !options_.state_file.empty())
    std::filesystem::remove(options_.state_file, ignored);
  return std::move(solution_);
}

}  // namespace

LatinSolution solve_latin_pgd(std::shared_ptr<const Structure> structure, const SolverOptions& loading,
                              std::span<const DamageParameters> parameters, const LatinOptions& options) {
  options.validate();
  loading.validate();
  if (parameters.empty()) throw UsageError("LATIN-PGD: no parameter point is given");
  for (const DamageParameters& point : parameters) point.validate();
  if (loading.regularisation.kind == DamageRegularisation::gradient)
    throw ProjectError(
        "LATIN-PGD cannot do gradient damage: its local stage is one Gauss point's, and the averaged strain "
        "is that of all; take method = \"snapshots\", or regularisation = \"crack-band\"");
  return LatinPgd(std::move(structure), loading, parameters, options).run();
}

}  // namespace knothe::offline
