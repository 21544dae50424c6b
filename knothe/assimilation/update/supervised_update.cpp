/// @file The part of the sequential update that watches the model: each datum is judged before it is
/// assimilated, and corrected where the model is known to be wrong.
#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"

namespace knothe::assimilation {
std::optional<bool> SequentialUpdate::by_hand(std::size_t step) const {
  for (const auto& [from, to] : by_hand_) {
    if (from <= step && step <= to) return true;
  }
  return std::nullopt;
}

std::vector<std::size_t> SequentialUpdate::corrected_steps() const {
  std::vector<std::size_t> steps;
  for (const auto& [step, datum] : data_) {
    if (datum.corrected) steps.push_back(step);
  }
  return steps;
}

/// The datum's forms as they will be assimilated, from the one without correction.
void SequentialUpdate::correct(std::size_t step, Datum& datum) {
  datum.levels.clear();
  datum.corrected_form.reset();
  datum.corrected = supervision_.corrects(by_hand(step));
  // Only a form was put:
  if (!supervision_.is_joint() && datum.values.size() == 0) datum.corrected = false;
  if (projector_.depends_on_order() && !datum.moved) datum.corrected = false;
  if (!datum.corrected) return;
  if (supervision_.is_joint()) {
    datum.levels =
        supervision_.condition(datum.form, datum.moved ? &*datum.moved : nullptr, datum.time_index);
  } else if (const auto correction = supervision_.extrapolate(datum.time)) {
    projector_.project(step, datum.time_index, datum.values, *correction, datum.corrected_form.emplace());
  } else {
    datum.corrected = false;  // nothing was learnt yet
  }
}

/// All earlier steps are in the sums, and `supervision_` knows them.
void SequentialUpdate::assimilate(std::size_t step) {
  const auto start = monotonic_now();
  Datum& datum = data_.at(step);
  supervision_.save(step);
  if (may_change()) {
    save_before(step);
    forget(step);
  }
  correct(step, datum);
  const Eigen::Index level = datum.levels.empty() ? 0 : supervision_.likeliest();
  const StepForm& used = datum.corrected_form ? *datum.corrected_form
                         : level == 0         ? datum.form
                                              : datum.levels[static_cast<std::size_t>(level - 1)];
  const bool rings =
      supervision_.judge(step, used, datum.corrected ? &datum.form : nullptr, projector_.central_functions());
  if (rings && options_.restart_on_alarm && restart_at_change(step)) return;
  // Where the correction is on already and had nothing to go by, doing it again would change nothing.
  if (rings && !supervision_.corrects(by_hand(step)) &&
      supervision_.mode() == BiasCorrectionMode::automatic) {
    // The drift began some steps ago: they were assimilated with a model that is wrong.
    auto onset = data_.find(step);
    for (int back = supervision_.steps_of_drift() - 1; back > 0 && onset != data_.begin(); --back) --onset;
    // A bias that is unknown together with the parameters may be there before it shows, at no harm: then all
    // that is remembered is done again.
    assimilate_again(supervision_.is_joint() ? supervision_.oldest_saved() : onset->first, step);
    return;
  }
  const double before = microseconds_since(start);
  add_to_sums(datum);
  summed_ = step;
  recompute(step);
  const auto after = monotonic_now();
  if (!level_sums_.empty())
    supervision_.set_shares(shares_ ? *shares_
                                    : target_.component_shares(posterior_.points, posterior_.weights));
  supervision_.learn(datum.time, datum.time_index, datum.values, result_.log_evidence_increment,
                     posterior_.points, posterior_.weights);
  result_.bias_corrected = datum.corrected;
  result_.monitor = supervision_.report();
  result_.notice = supervision_.notice();
  result_.elapsed_us.watch = before + microseconds_since(after);
}

void SequentialUpdate::clear_sums() {
  sum_ = StepForm::zero(projector_.central_functions().size());
  forgotten_ = 0;
  level_sums_.clear();
}

void SequentialUpdate::add_to_sums(const Datum& datum) {
  if (level_sums_.empty()) level_sums_.assign(datum.levels.size(), sum_);
  for (std::size_t k = 0; k < level_sums_.size(); ++k)
    level_sums_[k].add(datum.levels.empty() ? datum.form : datum.levels[k]);
  sum_.add(datum.corrected_form ? *datum.corrected_form : datum.form);
}

/// The target is the posterior of all data in the sums; with several sizes of a discrepancy, equally likely
/// beforehand, a mixture over them.
void SequentialUpdate::set_target() {
  if (level_sums_.empty()) return target_.set_form(sum_);
  std::vector<const StepForm*> forms = {&sum_};
  for (const StepForm& sum : level_sums_) forms.push_back(&sum);
  const std::vector<double> weights(forms.size(), -std::log(static_cast<double>(forms.size())));
  const Eigen::VectorXd& shares = supervision_.shares();
  target_.set_mixture(forms, weights, {shares.data(), static_cast<std::size_t>(shares.size())});
}

void SequentialUpdate::assimilate_again(std::size_t from, std::size_t step) {
  const std::string reason = supervision_.notice();
  redone_at_ = step;
  from = supervision_.restore(from);
  supervision_.correct_until(step);
  go_back_before(from);
  for (auto it = data_.find(from); it != data_.end() && it->first <= step; ++it) {
    assimilate(it->first);
  }
  result_.notice = fmt::format(
      "{}; correction of model bias switched on, and steps {} to {} taken out and put back with the "
      "corrected "
      "model{}{}",
      reason, from, step, result_.notice.empty() ? "" : "; ", result_.notice);
}

/// The state in which `step` comes next.
void SequentialUpdate::go_back_before(std::size_t step) {
  clear_sums();
  if (composition_) restart_composition();
  const auto end = data_.lower_bound(step);
  summed_.reset();
  for (auto it = data_.begin(); it != end; ++it) {
    add_to_sums(it->second);
    summed_ = it->first;
    if (composition_) recompute(it->first);
  }
}

/// Nothing from `step` on is assimilated. Where the state before it is not remembered, or what came later has
/// changed the steps before it, nothing is at all.
void SequentialUpdate::rewind(std::size_t step) {
  const bool remembered = followed_ && supervision_.remembers(step) && !(redone_at_ && *redone_at_ >= step);
  if (!remembered || composition_) {
    begin_anew();
    return;
  }
  const std::size_t found = supervision_.restore(step);
  if (may_change()) {
    restore_sums(found);
  } else {
    go_back_before(step);
  }
  result_ = {};
  posterior_ = {};
  previewed_ = false;
}

const UpdateResult& SequentialUpdate::preview(std::size_t step) {
  if (composition_ || supervision_.learns() || may_change()) return follow(step);
  const auto last = data_.find(step);
  if (last == data_.end())
    throw UsageError(fmt::format("step {} is not assimilated: there is no posterior of it", step));
  const StepForm sum = std::exchange(sum_, StepForm::zero(projector_.central_functions().size()));
  try {
    for (auto it = data_.begin(); it != std::next(last); ++it) {
      add_to_sums(it->second);
      const bool before_last = std::next(it) == last && !it->second.log_evidence;
      if (before_last || it == last) recompute(it->first);
    }
  } catch (...) {
    begin_anew();
    throw;
  }
  sum_ = sum;
  previewed_ = true;
  return result_;
}

const UpdateResult& SequentialUpdate::redo(std::size_t from, std::size_t to) {
  if (from > to)
    throw UsageError(fmt::format("steps {} to {}: the first step to redo comes after the last", from, to));
  if (!supervision_.learns()) {
    throw UsageError(
        "the data are not kept: set learn_bias, or bias_correction, before assimilating what is to be "
        "redone");
  }
  by_hand_.emplace_back(from, to);
  begin_anew();
  return data_.empty() ? result_ : conclude(data_.rbegin()->first);
}

}  // namespace knothe::assimilation
