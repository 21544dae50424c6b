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
  const auto step = store_.steps().find(result_.step);
  likelihood::ConditionalStates states =
      step == store_.steps().end() ? store_.projector().lasting_errors() : step->second.lasting_errors;
  if (states.mean.size() > 0) states.mean += states.slope * store_.projector().central_functions();
  return states;
}

bool SequentialUpdate::is_corrected() const {
  if (!supervision_.learns()) return false;
  const auto& steps = store_.steps();
  return std::any_of(steps.begin(), steps.upper_bound(result_.step),
                     [](const auto& entry) { return entry.second.corrected; });
}

std::vector<std::size_t> SequentialUpdate::corrected_steps() const {
  std::vector<std::size_t> steps;
  for (const auto& [step, stored] : store_.steps()) {
    if (stored.corrected) steps.push_back(step);
  }
  return steps;
}

const UpdateResult& SequentialUpdate::update(std::size_t step, std::size_t time_index,
                                             const Eigen::Ref<const Eigen::VectorXd>& values) {
  if (store_.steps().contains(step))
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
  return store_.steps().empty() ? result_ : posterior_without_monitor(store_.last());
}

void SequentialUpdate::add(likelihood::DatumPointer datum, std::size_t time_index) {
  store_.add(std::move(datum), time_index);
}

void SequentialUpdate::withdraw(std::size_t step, const likelihood::DatumKey& key) {
  store_.withdraw(step, key);
  if (store_.steps().empty()) restart();
}

void SequentialUpdate::apply_changes() {
  const auto changed = store_.update_forms();
  if (changed && summed_ && *summed_ >= *changed) rewind(*changed);
}

const likelihood::StepForm* SequentialUpdate::form_of(std::size_t step) const {
  const auto found = store_.steps().find(step);
  return found == store_.steps().end() ? nullptr : &found->second.assimilated();
}

likelihood::StepForm SequentialUpdate::form_up_to(std::size_t step) {
  apply_changes();
  likelihood::StepForm sum = likelihood::StepForm::zero(store_.projector().central_functions().size());
  const auto& steps = store_.steps();
  for (auto it = steps.begin(); it != steps.end() && it->first <= step; ++it) {
    // Data of a structure that changes grow old; a power of 1 leaves the sum as it is, to the bit.
    if (it != steps.begin()) sum.raise(changes_.power_before(it->first));
    sum.add(it->second.form);
  }
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
  const auto last = store_.find(step);
  auto& steps = store_.steps();
  // Also where `step` is summed up, but only on the way back from a later one.
  const bool is_lost = previewed_ || result_.weights.size() == 0;
  if (summed_ && (*summed_ > step || (is_lost && (*summed_ == step || posteriors_depend_on_earlier()))))
    rewind(step);
  // In the order of the steps, so that the sums are those of data that came in that order, to the bit.
  auto it = summed_ ? steps.upper_bound(*summed_) : steps.begin();
  for (const auto end = std::next(last); it != end; ++it) {
    const bool before_last = std::next(it) == last && !it->second.log_evidence;
    if (!every && it != last && !before_last) {
      sums_.add(it->second);
      summed_ = it->first;
      supervision_.lose_posterior();
      followed_ = false;
      continue;
    }
    try {
      assimilate(it->first);
    } catch (...) {
      restart();  // discard the partial update
      throw;
    }
  }
  return result_;
}

const UpdateResult& SequentialUpdate::preview(std::size_t step) {
  if (posteriors_depend_on_earlier()) return posterior_at(step);
  apply_changes();
  const auto last = store_.find(step);
  const likelihood::FormSums followed = sums_;
  auto it = store_.steps().begin();
  if (summed_ && *summed_ < step && store_.steps().at(*summed_).log_evidence) {
    it = store_.steps().upper_bound(*summed_);
  } else {
    restart_sums();
  }
  try {
    for (; it != std::next(last); ++it) {
      sums_.add(it->second);
      const bool before_last = std::next(it) == last && !it->second.log_evidence;
      if (before_last || it == last) solve(it->first);
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
  return store_.steps().empty() ? result_ : posterior_without_monitor(store_.last());
}

/// All earlier steps are in the sums, and `supervision_` knows them.
void SequentialUpdate::assimilate(std::size_t step) {
  const auto start = monotonic_now();
  likelihood::StoredStep& stored = store_.steps().at(step);
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
  auto& steps = store_.steps();
  for (auto it = steps.find(from); it != steps.end() && it->first <= to; ++it) assimilate(it->first);
}

/// The posterior of the sums as that of `step`.
void SequentialUpdate::solve(std::size_t step) {
  const auto here = store_.steps().find(step);
  likelihood::StoredStep& stored = here->second;
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
  result_.log_evidence_increment =
      result_.log_evidence - (here == store_.steps().begin() ? 0.0 : *std::prev(here)->second.log_evidence);
  stored.log_evidence = result_.log_evidence;
}

/// The data before `step`, all in the sums, grow old. Costs a posterior: the evidence of the data to come is
/// that under the wider one, whose constant no reweighting of points gives well.
void SequentialUpdate::forget(std::size_t step) {
  const double power = changes_.power_before(step);
  if (changes_.before(step)) supervision_.restart_sums();
  if (!summed_ || power == 1) return;
  sums_.forgotten = *store_.steps().at(*summed_).log_evidence;  // log Z(S), and what was forgotten before
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
  const std::size_t from = supervision_.begin_correction(store_.before(step, alarm.steps - 1)->first, step);
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
  const auto first = store_.before(step, alarm.steps - 1);
  const std::size_t onset = first->first;
  if (first == store_.steps().begin() || changes_.before(onset)) return false;
  std::vector<std::size_t> found = changes_.found();
  found.push_back(onset);
  std::size_t from = store_.steps().begin()->first;
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
  auto& steps = store_.steps();
  auto it = steps.begin();
  sums_before_.forget_after(step);
  if (const auto* milestone = sums_before_.last_up_to(step)) {
    sums_ = milestone->second;
    it = steps.lower_bound(milestone->first);
    if (it != steps.begin()) summed_ = std::prev(it)->first;
  }
  for (const auto end = steps.lower_bound(step); it != end; ++it) {
    sums_.add(it->second);
    summed_ = it->first;
    if (solver_.is_sequential()) solve(it->first);
  }
}

/// The sums before `step` again, which are remembered.
void SequentialUpdate::restore_sums(std::size_t step) {
  sums_ = changes_.restore(step);
  summed_.reset();
  auto& steps = store_.steps();
  if (const auto next = steps.lower_bound(step); next != steps.begin()) summed_ = std::prev(next)->first;
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
  supervision_.restart();
  summed_.reset();
  followed_ = true;
  previewed_ = false;
  redone_at_.reset();
}

}  // namespace knothe::assimilation
