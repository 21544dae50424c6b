#include "knothe/assimilation/monitor/model_supervision.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

#include "knothe/assimilation/monitor/model_selection.hpp"
#include "knothe/assimilation/update/structure_changes.hpp"

namespace knothe::assimilation {
namespace {

/// Directions of w in which a discrepancy may go, at most: the leading ones of the prior's spread.
constexpr Eigen::Index k_discrepancy_functions = 12;

}  // namespace

ModelSupervision::ModelSupervision(std::shared_ptr<const model::ObservedModel> model,
                                   const likelihood::NoiseModel& noise,
                                   std::shared_ptr<const posterior::PriorTransform> transform,
                                   const UpdateOptions& options)
    : model_(std::move(model)),
      transform_(std::move(transform)),
      mode_(options.bias_correction),
      options_(options.monitor),
      learns_(options.learn_bias || mode_ != likelihood::BiasCorrectionMode::off),
      is_joint_(options.bias.way == likelihood::BiasOptions::Way::joint),
      sizes_(options.bias.sizes),
      prior_(likelihood::prior_functions(*model_->functions, *transform_)),
      has_milestones_(!learns_ && !StructureChanges(options).possible()) {
  initial_.corrected = mode_ == likelihood::BiasCorrectionMode::on;
  // Any of the sums may ring the alarm: each does it so much more seldom.
  const std::size_t count = 1 + 2 * transform_->dimension();
  initial_.sums.assign(
      count,
      Cusum(options_.reference, cusum_threshold(options_.reference, options_.average_run_length * count)));
  if (learns_ && !is_joint_) {
    // A dof that is not measured at all has no noise; it is missing from every datum.
    const Eigen::VectorXd std = noise.measurement().standard_deviations();
    initial_.bias.emplace((std.array() > 0).select(std, 1.0), options.bias);
  }
  if (is_joint()) {
    const Eigen::Index q = std::min(prior_.factor.cols(), k_discrepancy_functions);
    for (const double size : sizes_)
      initial_.joint.emplace_back(prior_.factor.leftCols(q), size, options.bias.memory);
    const Eigen::Index kinds = sizes_.size() + 1;
    initial_.shares = Eigen::VectorXd::Constant(kinds, 1.0 / kinds);
  }
  restart();
}

void ModelSupervision::restart() {
  state_ = initial_;
  saved_.clear();
  milestones_.clear();
  forgotten_.reset();
  forget_posterior();
}

void ModelSupervision::save(std::size_t step) {
  Saved now{state_, points_, is_known_};
  if (has_milestones_ && milestones_.wants(step)) milestones_.save(step, now);
  saved_.insert_or_assign(step, std::move(now));
  if (saved_.size() <= k_remembered) return;
  forgotten_ = saved_.begin()->first;
  saved_.erase(saved_.begin());
}

/// Further back than the last that are kept.
bool ModelSupervision::is_far_back(std::size_t step) const {
  return forgotten_ && *forgotten_ >= step;
}

bool ModelSupervision::remembers(std::size_t step) const {
  return is_far_back(step) ? milestones_.last_up_to(step) != nullptr
                           : saved_.lower_bound(step) != saved_.end();
}

void ModelSupervision::set_state(const Saved& saved) {
  state_ = saved.state;
  points_ = saved.points;
  current_ = points_.weights.size() == 0 ? prior_ : likelihood::functions_at(*model_->functions, points_);
  is_known_ = saved.is_known;
}

std::size_t ModelSupervision::restore(std::size_t step) {
  milestones_.forget_after(step);
  if (is_far_back(step)) {
    const auto* milestone = milestones_.last_up_to(step);
    assert(milestone != nullptr);
    set_state(milestone->second);
    saved_.clear();
    forgotten_.reset();
    if (milestone->first > 0) forgotten_ = milestone->first - 1;
    return milestone->first;
  }
  const auto it = saved_.lower_bound(step);
  assert(it != saved_.end());
  set_state(it->second);
  const std::size_t found = it->first;
  saved_.erase(it, saved_.end());
  return found;
}

std::size_t ModelSupervision::begin_correction(std::size_t onset, std::size_t step) {
  const std::size_t from = restore(is_joint_ ? saved_.begin()->first : onset);
  state_.corrected = true;
  state_.corrected_until = step;
  state_.without = 0;
  for (Cusum& sum : state_.sums) sum.restart();
  return from;
}

bool ModelSupervision::corrects(std::size_t step) const {
  if (!learns_) return false;
  const auto holds = [&](const auto& range) { return range.first <= step && step <= range.second; };
  return std::any_of(by_hand_.begin(), by_hand_.end(), holds) || state_.corrected;
}

bool ModelSupervision::asks_for_correction(std::size_t step) const {
  return mode_ == likelihood::BiasCorrectionMode::automatic && !corrects(step);
}

void ModelSupervision::correct(std::size_t step, likelihood::StoredStep& stored,
                               likelihood::DatumProjector& projector) {
  stored.levels.clear();
  stored.corrected_form.reset();
  stored.corrected = corrects(step);
  if (!is_joint_ && stored.values() == nullptr) stored.corrected = false;  // several data
  if (projector.depends_on_order() && !stored.moved) stored.corrected = false;
  if (!stored.corrected) return;
  if (is_joint_) {
    stored.levels = condition(stored);
  } else if (const auto correction = state_.bias->extrapolate(stored.time)) {
    projector.project(step, stored.time_index, *stored.values(), *correction,
                      stored.corrected_form.emplace());
  } else {
    stored.corrected = false;  // nothing was learnt yet
  }
}

/// Joint: the forms of a datum, corrected with each size of the discrepancy; takes it in.
std::vector<likelihood::StepForm> ModelSupervision::condition(const likelihood::StoredStep& stored) {
  std::vector<likelihood::StepForm> forms;
  for (likelihood::JointDiscrepancy& joint : state_.joint)
    forms.push_back(stored.moved ? joint.condition(*stored.moved, model_->core[stored.time_index])
                                 : joint.condition(stored.form));
  return forms;
}

void ModelSupervision::set_shares(Eigen::VectorXd shares) {
  state_.shares = std::move(shares);
  state_.report.discrepancy = 0;
  for (std::size_t k = 0; k < sizes_.size(); ++k)
    state_.report.discrepancy += sizes_[k] * state_.shares[k + 1];
}

Eigen::VectorXd ModelSupervision::expected_discrepancy(const Eigen::VectorXd& central) const {
  // E[ξ | v] is affine in v, so its mean over the posterior is its value at the posterior mean of w.
  const Eigen::VectorXd v = current_.mean - central;
  Eigen::VectorXd expected = Eigen::VectorXd::Zero(v.size());
  for (std::size_t k = 0; k < state_.joint.size(); ++k)
    expected += state_.shares[k + 1] * state_.joint[k].expected(v);
  return expected;
}

/// Whether one of the sums is above the threshold.
bool ModelSupervision::add_scores(const PredictiveCheck& check) {
  MonitorReport& report = state_.report;
  report.upper_probability = check.upper_probability;
  bool alarm = state_.sums[0].add(-predictive_score(check.upper_probability, options_.largest_score));
  for (Eigen::Index a = 0; a < check.lower_probability.size(); ++a) {
    const double z = predictive_score(check.lower_probability[a], options_.largest_score);
    alarm = state_.sums[2 * a + 1].add(z) || alarm;
    alarm = state_.sums[2 * a + 2].add(-z) || alarm;
  }
  const auto largest = std::max_element(state_.sums.begin(), state_.sums.end(),
                                        [](const Cusum& a, const Cusum& b) { return a.value() < b.value(); });
  report.cumulative_sum = largest->value();
  report.threshold = largest->threshold();
  state_.drift = largest->steps();
  return alarm;
}

std::optional<ModelSupervision::DriftAlarm> ModelSupervision::check_prediction(
    std::size_t step, const likelihood::StoredStep& stored, const Eigen::VectorXd& central) {
  state_.notice.clear();
  if (!is_known_) return {};
  Eigen::Index likeliest = 0;  // size of the discrepancy
  if (!stored.levels.empty()) state_.shares.maxCoeff(&likeliest);
  const likelihood::StepForm& used = likeliest == 0 ? stored.assimilated() : stored.levels[likeliest - 1];
  const PredictiveCheck check = predictive_check(used, current_, central);
  const bool before = state_.report.alarm;
  bool alarm = add_scores(check);
  if (mode_ == likelihood::BiasCorrectionMode::automatic && state_.corrected && stored.corrected &&
      !(state_.corrected_until && step <= *state_.corrected_until)) {
    const double without = predictive_check(stored.form, current_, central).log_density;
    state_.without = std::max(0.0, state_.without + without - check.log_density);
    if (state_.without > options_.switch_off) {
      state_.corrected = false;
      state_.notice = fmt::format(
          "correction of model bias switched off from the next step: the model alone has predicted the last "
          "data better by a Bayes factor of {:.0f} ({} evidence)",
          std::exp(state_.without), jeffreys_scale(state_.without));
      for (Cusum& sum : state_.sums) sum.restart();
      alarm = false;
    }
  }
  state_.report.alarm = alarm;
  if (!alarm || before) return {};
  state_.notice = fmt::format(
      "the {}model does not fit the data: its predictions have drifted for {} steps (cumulative sum {:.1f}, "
      "threshold {:.1f}: one false alarm in {:.0f} steps)",
      stored.corrected ? "corrected " : "", state_.drift, state_.report.cumulative_sum,
      state_.report.threshold, options_.average_run_length);
  return DriftAlarm{state_.drift, state_.notice, state_.report};
}

void ModelSupervision::learn(const likelihood::StoredStep& stored, Eigen::VectorXd shares,
                             UpdateResult& result) {
  if (shares.size() > 0) set_shares(std::move(shares));
  set_posterior(result);
  state_.increments.push_back(result.log_evidence_increment);
  if (std::ssize(state_.increments) > options_.smoothing) state_.increments.pop_front();
  state_.report.smoothed_increment =
      std::accumulate(state_.increments.begin(), state_.increments.end(), 0.0) / state_.increments.size();
  if (state_.bias && stored.values() != nullptr) learn_residual(stored);
  result.bias_corrected = stored.corrected;
  result.monitor = state_.report;
  result.notice = state_.notice;
}

void ModelSupervision::learn_residual(const likelihood::StoredStep& stored) {
  // Eq. 16 and 19: mean of d − M(p), and standard deviation of M(p), under the posterior.
  const Eigen::MatrixXd& core = model_->core[stored.time_index];
  const Eigen::VectorXd predicted =
      model_->lift.col(stored.time_index) + model_->space * (core * current_.mean);
  const Eigen::MatrixXd factor = core * current_.factor;
  Eigen::VectorXd spread(stored.values()->size());
  constexpr Eigen::Index k_block = 512;  // rows that stay in the cache
  for (Eigen::Index first = 0; first < spread.size(); first += k_block) {
    const Eigen::Index count = std::min(k_block, spread.size() - first);
    spread.segment(first, count) = (model_->space.middleRows(first, count) * factor).rowwise().norm();
  }
  state_.bias->add(stored.time, *stored.values() - predicted, spread);
}

void ModelSupervision::restart_sums() {
  for (Cusum& sum : state_.sums) sum.restart();
  state_.drift = 0;
  state_.report.alarm = false;
}

void ModelSupervision::set_posterior(const posterior::Posterior& posterior) {
  points_ = likelihood::few_points(posterior);
  current_ = likelihood::functions_at(*model_->functions, points_);
  is_known_ = true;
}

void ModelSupervision::forget_posterior() {
  points_ = {};
  current_ = prior_;
  is_known_ = true;
}

}  // namespace knothe::assimilation
