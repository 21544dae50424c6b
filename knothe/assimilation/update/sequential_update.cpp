#include "knothe/assimilation/update/sequential_update.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"

namespace knothe::assimilation {

SequentialUpdate::SequentialUpdate(std::shared_ptr<const model::ObservedModel> model,
                                   likelihood::NoiseModel noise, std::vector<posterior::Prior> priors,
                                   UpdateOptions options)
    : transform_(likelihood::truncated_to_box(*model, std::move(priors))),
      store_(model, std::move(noise), likelihood::medians(*transform_)),
      solver_(*model, transform_, store_.projector().central_functions(), options),
      supervision_(model, store_.projector().noise(), transform_, options),
      changes_(options),
      restart_on_alarm_(options.restart_on_alarm) {
  require_compatible(features_of(options) | features_of(store_.projector().noise()));
  store_.make_moved_forms(supervision_.is_joint());
  restart_sums();
}

EstimatedBias SequentialUpdate::bias() const {
  EstimatedBias bias;
  if (supervision_.is_joint())
    bias.functions = supervision_.expected_discrepancy(store_.projector().central_functions());
  if (const likelihood::ModelBias* learnt = supervision_.bias())
    if (auto at_sensors = learnt->latest()) bias.sensors = std::move(*at_sensors);
  return bias;
}

likelihood::ConditionalStates SequentialUpdate::lasting_errors() const {
  const auto step = store_.steps().find(result_.step);  // with such errors all are in memory
  likelihood::ConditionalStates states =
      step == store_.steps().end() ? store_.projector().lasting_errors() : step->second.lasting_errors;
  if (states.mean.size() > 0) states.mean += states.slope * store_.projector().central_functions();
  return states;
}

std::vector<std::size_t> SequentialUpdate::corrected_steps() const {
  std::vector<std::size_t> steps;
  if (!supervision_.learns()) return steps;
  for (const auto& [step, stored] : store_.steps())
    if (stored.corrected && step <= result_.step) steps.push_back(step);
  return steps;
}

const UpdateResult& SequentialUpdate::update(std::size_t step, std::size_t time_index,
                                             const Eigen::Ref<const Eigen::VectorXd>& values) {
  if (store_.contains(step))
    throw UsageError(
        fmt::format("step {} is assimilated already: withdraw it before assimilating it again", step));
  const auto start = monotonic_now();
  add(std::make_shared<const likelihood::Datum>(
          likelihood::Datum{{}, step, time_index, values, std::nullopt}),
      time_index);
  apply_changes();
  const double projection = microseconds_since(start);
  posterior_without_monitor(store_.last());
  result_.elapsed_us.projection += projection;
  return result_;
}

const UpdateResult& SequentialUpdate::remove(std::size_t step) {
  withdraw(step, {});
  return store_.empty() ? result_ : posterior_without_monitor(store_.last());
}

void SequentialUpdate::add(likelihood::DatumPointer datum, std::size_t time_index) {
  store_.add(std::move(datum), time_index);
  release_memory();
}

/// Of a long sequence, where a step is no more than its data, only those near the last one assimilated are in
/// memory: the others are made again where one goes back to them.
void SequentialUpdate::release_memory() {
  if (!store_.has_recall() || store_.steps().size() < std::max(4 * kept_, release_from_)) return;
  if (posteriors_depend_on_earlier()) return;
  sum_ahead();
  const std::size_t at = summed_.value_or(0);
  store_.keep_in_memory(at - std::min(at, kept_), at + kept_);
  release_from_ = 2 * store_.steps().size();
}

/// Of data that come faster than their turn does (a journal that is replayed), the sums for a preview, before
/// they are let go.
void SequentialUpdate::sum_ahead() {
  apply_changes();
  const auto end = store_.step_before(store_.last());
  if (!end || (summed_ && *summed_ >= *end)) return;
  if (!shown_ || (summed_ && shown_->before <= *summed_)) shown_ = {summed_ ? *summed_ + 1 : 0, sums_};
  const auto& steps = store_.steps();
  for (auto at = store_.step_from(shown_->before); at && *at < *end && steps.contains(*at);
       at = store_.step_from(*at + 1)) {
    shown_->sums.add(steps.at(*at));
    shown_->before = *at + 1;
  }
}

void SequentialUpdate::withdraw(std::size_t step, const likelihood::DatumKey& key) {
  store_.withdraw(step, key);
  if (store_.empty()) restart();
}

void SequentialUpdate::apply_changes() {
  const auto changed = store_.update_forms();
  if (!changed) return;
  if (shown_ && shown_->before > *changed) shown_.reset();
  if (summed_ && *summed_ >= *changed) rewind(*changed);
}

const likelihood::StepForm* SequentialUpdate::form_of(std::size_t step) const {
  const auto found = store_.steps().find(step);
  return found == store_.steps().end() ? nullptr : &found->second.assimilated();
}

likelihood::StepForm SequentialUpdate::form_up_to(std::size_t step) {
  apply_changes();
  likelihood::StepForm sum = likelihood::StepForm::zero(store_.projector().central_functions().size());
  bool first = true;
  store_.for_each(0, step + 1, [&](std::size_t number, const likelihood::StoredStep& stored) {
    // Data of a structure that changes grow old; a power of 1 leaves the sum as it is, to the bit.
    if (!std::exchange(first, false)) sum.raise(changes_.power_before(number));
    sum.add(stored.form);
  });
  return sum;
}

/// Composed maps need every step, and so do a correction and a structure that changes, which follow from all
/// steps before; the collapsed posterior only the last one, and the one before it for the increment of the
/// evidence.
bool SequentialUpdate::posteriors_depend_on_earlier() const {
  return solver_.is_sequential() || supervision_.learns() || changes_.possible();
}

const UpdateResult& SequentialUpdate::posterior_without_monitor(std::size_t step) {
  return compute(step, posteriors_depend_on_earlier());
}

const UpdateResult& SequentialUpdate::posterior_at(std::size_t step) {
  apply_changes();
  if (!followed_) restart();
  return compute(step, true);
}

const UpdateResult& SequentialUpdate::compute(std::size_t step, bool every) {
  apply_changes();
  release_memory();
  (void)store_.at(step);
  // Also where `step` is summed up, but only on the way back from a later one.
  const bool is_lost = previewed_ || result_.weights.size() == 0;
  if (summed_ && (*summed_ > step || (is_lost && (*summed_ == step || posteriors_depend_on_earlier()))))
    rewind(step);
  const std::size_t first = summed_ ? *summed_ + 1 : 0;
  // In the order of the steps, so that the sums are those of data that came in that order, to the bit.
  std::size_t from = first;
  if (!every) {
    from = first_to_solve(step);
    if (first < from) {
      store_.for_each(first, from, [&](std::size_t number, const likelihood::StoredStep& stored) {
        sums_.add(stored);
        summed_ = number;
        supervision_.lose_posterior();
        followed_ = false;
      });
    }
    from = std::max(first, from);
  }
  try {
    assimilate_from(from, step);
  } catch (...) {
    restart();  // discard the partial update
    throw;
  }
  return result_;
}

/// The step before, where its evidence is not known, of which that of `step` is an increment; else `step`.
std::size_t SequentialUpdate::first_to_solve(std::size_t step) const {
  const auto before = store_.step_before(step);
  return before && !store_.log_evidence(*before) ? *before : step;
}

const UpdateResult& SequentialUpdate::preview(std::size_t step) {
  if (posteriors_depend_on_earlier()) return posterior_at(step);
  apply_changes();
  release_memory();
  (void)store_.at(step);
  const likelihood::FormSums followed = sums_;
  std::size_t from = 0;
  if (summed_ && *summed_ < step && store_.log_evidence(*summed_)) {
    from = *summed_ + 1;
  } else {
    restart_sums();
  }
  const std::size_t first = std::max(from, first_to_solve(step));
  if (shown_ && shown_->before <= first && shown_->before > from) {
    sums_ = shown_->sums;
    from = shown_->before;
  }
  try {
    store_.for_each(from, first, [&](std::size_t, const auto& stored) { sums_.add(stored); });
    shown_ = {first, sums_};
    for (auto at = store_.step_from(first); at && *at <= step; at = store_.step_from(*at + 1)) {
      sums_.add(store_.at(*at));
      solve(*at);
    }
  } catch (...) {
    restart();
    throw;
  }
  sums_ = followed;
  previewed_ = true;  // result_ is not of `summed_`
  return result_;
}

const UpdateResult& SequentialUpdate::correct_bias(std::size_t from, std::size_t to) {
  if (from > to)
    throw UsageError(fmt::format("steps {} to {}: the first step to redo comes after the last", from, to));
  if (!supervision_.learns()) {
    throw UsageError(
        "the data are not kept: set learn_bias, or bias_correction, before assimilating what is to be "
        "redone");
  }
  supervision_.correct_by_hand(from, to);
  restart();
  return store_.empty() ? result_ : posterior_without_monitor(store_.last());
}

/// All earlier steps are in the sums, and `supervision_` knows them.
void SequentialUpdate::assimilate(std::size_t step) {
  const auto start = monotonic_now();
  likelihood::StoredStep& stored = store_.at(step);
  supervision_.save(step);
  if (!posteriors_depend_on_earlier() && sums_before_.wants(step)) sums_before_.save(step, sums_);
  if (changes_.possible()) {
    changes_.save(step, sums_);
    forget(step);
  }
  supervision_.correct(step, stored, store_.projector());
  const auto alarm = supervision_.check_prediction(step, stored, store_.projector().central_functions());
  if (alarm && restart_on_alarm_ && restart_at_change(step, *alarm)) return;
  if (alarm && supervision_.asks_for_correction(step)) return correct_since_drift(step, *alarm);
  const double before = microseconds_since(start);
  sums_.add(stored);
  summed_ = step;
  solve(step);
  const auto after = monotonic_now();
  supervision_.learn(stored, sums_.levels.empty() ? Eigen::VectorXd() : solver_.component_shares(result_),
                     result_);
  result_.elapsed_us.watch = before + microseconds_since(after);
}

void SequentialUpdate::assimilate_from(std::size_t from, std::size_t to) {
  for (auto step = store_.step_from(from); step && *step <= to; step = store_.step_from(*step + 1)) {
    assimilate(*step);
    release_memory();
  }
}

/// The posterior of the sums as that of `step`.
void SequentialUpdate::solve(std::size_t step) {
  likelihood::StoredStep& stored = store_.at(step);
  UpdateResult fresh;
  fresh.points.swap(result_.points);  // their memory is used again
  fresh.weights.swap(result_.weights);
  result_ = std::move(fresh);
  result_.step = step;
  result_.time = stored.time;
  result_.used = stored.form.used;
  result_.missing = stored.form.missing;
  previewed_ = false;
  solver_.set(sums_, supervision_.shares());
  solver_.solve(stored.assimilated(), result_, result_.elapsed_us);
  result_.log_evidence += sums_.forgotten;
  result_.log_evidence_lower_bound += sums_.forgotten;
  const auto before = store_.step_before(step);
  result_.log_evidence_increment =
      result_.log_evidence - (before ? store_.log_evidence(*before).value_or(0.0) : 0.0);
  stored.log_evidence = result_.log_evidence;
}

/// The data before `step`, all in the sums, grow old. Costs a posterior: the evidence of the data to come is
/// that under the wider one, whose constant no reweighting of points gives well.
void SequentialUpdate::forget(std::size_t step) {
  const double power = changes_.power_before(step);
  if (changes_.before(step)) supervision_.restart_sums();
  if (!summed_ || power == 1) return;
  sums_.forgotten = *store_.log_evidence(*summed_);  // log Z(S), and what was forgotten before
  sums_.raise(power);
  if (power == 0) {
    solver_.restart();
    supervision_.forget_posterior();
    return;
  }
  solver_.set(sums_, supervision_.shares());
  solver_.solve_widened(power, result_, result_.elapsed_us);
  sums_.forgotten -= result_.log_evidence;
  supervision_.set_posterior(result_);
}

/// The step at which an alarm rang says so, whatever has been done about it.
void SequentialUpdate::note(const ModelSupervision::DriftAlarm& alarm) {
  result_.monitor.alarm = true;
  result_.monitor.cumulative_sum = alarm.report.cumulative_sum;
  result_.monitor.threshold = alarm.report.threshold;
}

/// The drift began some steps ago: they were assimilated with a model that is wrong. They are taken out and
/// put back with the corrected one.
void SequentialUpdate::correct_since_drift(std::size_t step, const ModelSupervision::DriftAlarm& alarm) {
  redone_at_ = step;
  const std::size_t from = supervision_.begin_correction(store_.before(step, alarm.steps - 1), step);
  go_back_before(from);
  assimilate_from(from, step);
  note(alarm);
  result_.notice = fmt::format(
      "{}; correction of model bias switched on, and steps {} to {} withdrawn and assimilated again with the "
      "corrected model{}{}",
      alarm.notice, from, step, result_.notice.empty() ? "" : "; ", result_.notice);
}

/// The alarm at `step` is taken for a change where the drift began: the data from there on are assimilated
/// again with it. False where that is known already, or where there is nothing before it to be forgotten.
bool SequentialUpdate::restart_at_change(std::size_t step, const ModelSupervision::DriftAlarm& alarm) {
  const std::size_t onset = store_.before(step, alarm.steps - 1);
  if (!store_.step_before(onset) || changes_.before(onset)) return false;
  std::vector<std::size_t> found = changes_.found();
  found.push_back(onset);
  std::size_t from = *store_.step_from(0);
  if (supervision_.remembers(onset) && !solver_.is_sequential()) {
    from = supervision_.restore(onset);
    restore_sums(from);
  } else {
    restart();
  }
  changes_.set_found(std::move(found));
  redone_at_ = step;
  assimilate_from(from, step);
  note(alarm);
  result_.notice = changes_.notice(alarm.notice, onset, result_.notice);
  return true;
}

/// Nothing from `step` on is assimilated. Where the state before it is not remembered, or what came later has
/// changed the steps before it, nothing is at all.
void SequentialUpdate::rewind(std::size_t step) {
  const bool remembered = followed_ && supervision_.remembers(step) && !(redone_at_ && *redone_at_ >= step);
  if (!remembered || solver_.is_sequential()) {
    restart();
    return;
  }
  const std::size_t found = supervision_.restore(step);
  if (changes_.possible()) {
    restore_sums(found);
  } else {
    go_back_before(std::min(found, step));
  }
  result_ = {};
  previewed_ = false;
}

/// The state in which `step` comes next.
void SequentialUpdate::go_back_before(std::size_t step) {
  restart_sums();
  solver_.restart();
  summed_.reset();
  std::size_t from = 0;
  sums_before_.forget_after(step);
  if (const auto* milestone = sums_before_.last_up_to(step)) {
    sums_ = milestone->second;
    from = milestone->first;
    summed_ = store_.step_before(from);
  }
  store_.for_each(from, step, [&](std::size_t number, const likelihood::StoredStep& stored) {
    sums_.add(stored);
    summed_ = number;
    if (solver_.is_sequential()) solve(number);
  });
}

/// The sums before `step` again, which are remembered.
void SequentialUpdate::restore_sums(std::size_t step) {
  sums_ = changes_.restore(step);
  summed_ = store_.step_before(step);
}

void SequentialUpdate::restart_sums() {
  sums_ = likelihood::FormSums::zero(store_.projector().central_functions().size());
}

void SequentialUpdate::restart() {
  result_ = {};
  changes_.restart();
  solver_.restart();
  restart_sums();
  sums_before_.clear();
  shown_.reset();
  supervision_.restart();
  summed_.reset();
  followed_ = true;
  previewed_ = false;
  redone_at_.reset();
}

}  // namespace knothe::assimilation
