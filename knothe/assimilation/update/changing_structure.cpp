/// @file The part of the sequential update that lets data grow old: a forgetting factor, and changes of the
/// structure, known or found by the monitor.
///
/// With S the sum of the forms so far and λ the power, the posterior before a datum becomes ∝ π₀ L_S^λ. The
/// evidence of a datum is that under this wider posterior, p(d_i | d before) = Z(λS + form)/Z(λS), so that
///   log p(d₀ … d_i) = log Z(sum) + forgotten,   forgotten += log Z(S) − log Z(λS).
#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "knothe/assimilation/update/sequential_update.hpp"

namespace knothe::assimilation {

bool SequentialUpdate::may_change() const {
  return options_.forgetting < 1 || !options_.change_points.empty() || options_.restart_on_alarm;
}

bool SequentialUpdate::changes_before(std::size_t step) const {
  const auto is_in = [&](const std::vector<std::size_t>& steps) {
    return std::find(steps.begin(), steps.end(), step) != steps.end();
  };
  return is_in(options_.change_points) || is_in(changes_);
}

double SequentialUpdate::power_before(std::size_t step) const {
  return changes_before(step) ? options_.change_retention : options_.forgetting;
}

/// What a step is put back from: the sums are no longer those of the forms that are kept.
void SequentialUpdate::save_before(std::size_t step) {
  aged_.insert_or_assign(step, Aged{sum_, forgotten_, changes_});
  aged_.erase(aged_.begin(), aged_.lower_bound(supervision_.oldest_saved()));
}

/// The sums before `step` again, which are remembered.
void SequentialUpdate::restore_sums(std::size_t step) {
  const auto it = aged_.find(step);
  sum_ = it->second.sum;
  forgotten_ = it->second.forgotten;
  changes_ = it->second.changes;
  aged_.erase(it, aged_.end());
  summed_.reset();
  if (const auto next = data_.lower_bound(step); next != data_.begin()) summed_ = std::prev(next)->first;
}

/// The data before `step`, all in the sums, grow old. Costs a posterior: the evidence of the data to come is
/// that under the wider one, whose constant no reweighting of points gives well.
void SequentialUpdate::forget(std::size_t step) {
  const double power = power_before(step);
  if (changes_before(step)) supervision_.restart_sums();
  if (!summed_ || power == 1) return;
  forgotten_ = *data_.at(*summed_).log_evidence;  // log Z(S), and what was forgotten before
  sum_.raise(power);
  if (power == 0) {
    supervision_.forget_posterior();
    return;
  }
  set_target();
  if (options_.kind == Method::grid) {
    by_grid();
  } else {
    by_collapsed_map();
  }
  forgotten_ -= result_.log_evidence;
  supervision_.set_posterior(posterior_.points, posterior_.weights);
}

/// The alarm at `step` is taken for a change where the drift began: the data from there on are assimilated
/// again with it. False where that is known already, or where there is nothing before it to be forgotten.
bool SequentialUpdate::restart_at_change(std::size_t step) {
  auto first = data_.find(step);
  for (int back = supervision_.steps_of_drift() - 1; back > 0 && first != data_.begin(); --back) --first;
  const std::size_t onset = first->first;
  if (first == data_.begin() || changes_before(onset)) return false;
  const std::string reason = supervision_.notice();
  std::vector<std::size_t> changes = changes_;
  changes.push_back(onset);
  std::size_t from = data_.begin()->first;
  if (supervision_.remembers(onset)) {
    from = supervision_.restore(onset);
    restore_sums(from);
  } else {
    begin_anew();
  }
  changes_ = std::move(changes);
  redone_at_ = step;
  for (auto it = data_.find(from); it != data_.end() && it->first <= step; ++it) assimilate(it->first);
  result_.notice = fmt::format(
      "{}; taken for a change of the structure at step {}: the data before it count {}{}{}", reason, onset,
      options_.change_retention > 0 ? fmt::format("with the power {:g}", options_.change_retention)
                                    : "no more, the posterior began anew from the prior",
      result_.notice.empty() ? "" : "; ", result_.notice);
  return true;
}

}  // namespace knothe::assimilation
