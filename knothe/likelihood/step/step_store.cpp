#include "knothe/likelihood/step/step_store.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {
namespace {

/// A sum that is to be made again has no G.
bool is_summed(const StoredStep& step) {
  return step.form.quadratic.size() > 0;
}

StepForm sum_of(const StoredStep& step) {
  StepForm sum = StepForm::zero(step.data.begin()->second.form.linear.size());
  for (const auto& [key, datum] : step.data) {
    StepForm form = datum.form;
    if (form.quadratic.size() == 0) form.quadratic = step.complete_quadratic;
    sum.add(form);
  }
  return sum;
}

}  // namespace

const Eigen::VectorXd* StoredStep::values() const {
  return data.size() == 1 ? &data.begin()->second.datum->values : nullptr;
}

void FormSums::add(const StoredStep& step) {
  if (levels.empty()) levels.assign(step.levels.size(), form);
  for (std::size_t k = 0; k < levels.size(); ++k)
    levels[k].add(step.levels.empty() ? step.form : step.levels[k]);
  form.add(step.assimilated());
  blocks.add(step.assimilated());
}

void FormSums::raise(double power) {
  form.raise(power);
  blocks = {};
}

StepStore::StepStore(std::shared_ptr<const model::ObservedModel> model, NoiseModel noise,
                     const Eigen::VectorXd& centre)
    : noise_(noise), projector_(std::move(model), std::move(noise), centre) {}

void StepStore::add(DatumPointer datum, std::size_t time_index) {
  const std::size_t index = datum->step;
  const bool is_new = !contains(index);
  StoredStep& step = is_new ? steps_[index] : at(index);
  step.time_index = time_index;
  step.time = projector_.model().time[time_index];
  Projected projected;
  try {
    projected = project(step, *datum);
  } catch (...) {
    restore_noise(index, step);
    if (is_new) steps_.erase(index);
    throw;
  }
  const auto known = index_.begin() + (first_from(index) - index_.cbegin());
  const bool last = std::next(known, is_new ? 0 : 1) == index_.end() &&
                    (step.data.empty() || step.data.rbegin()->first < datum->key);
  if (is_new) index_.insert(known, {index, time_index});
  store(step, std::move(datum), std::move(projected));
  if (projector_.depends_on_order() && !last) out_of_order_ = true;
  mark_changed(index);
}

void StepStore::withdraw(std::size_t index, const DatumKey& key) {
  if (!contains(index) || at(index).data.erase(key) == 0)
    throw UsageError(fmt::format("step {} is not assimilated: there is nothing to withdraw", index));
  StoredStep& step = at(index);
  step.form.quadratic.resize(0, 0);
  step.moved.reset();
  restore_noise(index, step);
  if (step.data.empty()) {
    steps_.erase(index);
    index_.erase(first_from(index));
  }
  if (projector_.depends_on_order()) out_of_order_ = true;
  mark_changed(index);
}

std::optional<std::size_t> StepStore::update_forms() {
  if (out_of_order_) project_again();
  const auto changed = std::exchange(changed_, std::nullopt);
  if (!changed) return changed;
  for (auto it = steps_.lower_bound(*changed); it != steps_.end(); ++it) {
    StoredStep& step = it->second;
    if (!is_summed(step)) step.form = sum_of(step);
    if (step.data.size() > 1) step.moved.reset();
    step.log_evidence.reset();
  }
  for (auto it = index_.begin() + (first_from(*changed) - index_.cbegin()); it != index_.end(); ++it)
    it->log_evidence = Known().log_evidence;
  return changed;
}

StepStore::Index::const_iterator StepStore::first_from(std::size_t step) const {
  return std::lower_bound(index_.begin(), index_.end(), step,
                          [](const Known& known, std::size_t s) { return known.step < s; });
}

std::optional<std::size_t> StepStore::step_from(std::size_t step) const {
  const auto it = first_from(step);
  return it == index_.end() ? std::nullopt : std::optional(it->step);
}

std::optional<std::size_t> StepStore::step_before(std::size_t step) const {
  const auto it = first_from(step);
  return it == index_.begin() ? std::nullopt : std::optional(std::prev(it)->step);
}

std::size_t StepStore::before(std::size_t step, std::ptrdiff_t back) const {
  const auto it = first_from(step);
  return (it - std::min(back, it - index_.begin()))->step;
}

StoredStep& StepStore::at(std::size_t step) {
  if (const auto it = steps_.find(step); it != steps_.end()) return it->second;
  const auto known = first_from(step);
  if (known == index_.end() || known->step != step)
    throw UsageError(fmt::format("step {} is not assimilated: there is no posterior of it", step));
  return steps_.emplace(step, made_again(*known)).first->second;
}

std::optional<double> StepStore::log_evidence(std::size_t step) const {
  if (const auto it = steps_.find(step); it != steps_.end()) return it->second.log_evidence;
  const auto known = first_from(step);
  if (known == index_.end() || known->step != step || std::isnan(known->log_evidence)) return std::nullopt;
  return known->log_evidence;
}

void StepStore::for_each(std::size_t from, std::size_t end,
                         const std::function<void(std::size_t, const StoredStep&)>& visit) {
  for (auto it = first_from(from); it != index_.end() && it->step < end; ++it) {
    const auto resident = steps_.find(it->step);
    if (resident != steps_.end()) {
      visit(it->step, resident->second);
    } else {
      visit(it->step, made_again(*it));
    }
  }
}

void StepStore::keep_in_memory(std::size_t from, std::size_t to) {
  if (!recall_ || index_.empty() || projector_.depends_on_order()) return;
  const std::size_t tail = before(last(), 1);
  std::erase_if(steps_, [&](const auto& entry) {
    const auto& [number, step] = entry;
    const bool is_plain = !step.own_noise && !step.corrected && !step.moved && step.levels.empty();
    if ((number >= from && number <= to) || number >= tail || !is_plain) return false;
    for (const auto& [key, projected] : step.data)
      if (projected.datum->noise) return false;
    Known& known = index_[first_from(number) - index_.cbegin()];
    known.log_evidence = step.log_evidence.value_or(Known().log_evidence);
    return true;
  });
}

/// From its data, as it was before it was let go.
StoredStep StepStore::made_again(const Known& known) {
  StoredStep step;
  step.time_index = known.time_index;
  step.time = projector_.model().time[known.time_index];
  for (DatumPointer& datum : recall_(known.step)) {
    Projected projected = project(step, *datum);
    store(step, std::move(datum), std::move(projected));
  }
  if (!is_summed(step)) step.form = sum_of(step);
  if (!std::isnan(known.log_evidence)) step.log_evidence = known.log_evidence;
  return step;
}

StepStore::Projected StepStore::project(StoredStep& step, const Datum& datum) {
  set_noise(datum.step, step, datum.noise);
  Projected projected;
  const bool moved = moved_forms_ && projector_.depends_on_order();
  projector_.project(datum.step, step.time_index, datum.values, projected.form,
                     moved ? &projected.moved.emplace() : nullptr);
  return projected;
}

void StepStore::set_noise(std::size_t index, StoredStep& step, const std::optional<GaussianNoise>& noise) {
  if (noise || step.own_noise) projector_.set_noise_of(index, noise ? *noise : noise_.at_step(index));
  step.own_noise = noise.has_value();
}

/// The noise of the step's one datum.
void StepStore::restore_noise(std::size_t index, StoredStep& step) {
  set_noise(index, step, step.data.size() == 1 ? step.data.begin()->second.datum->noise : std::nullopt);
}

/// Whether G is that of all complete data of the step.
bool StepStore::shares_quadratic(const ProjectedForm& projected) const {
  return projected.form.missing == 0 && !projected.datum->noise && !projector_.depends_on_order();
}

/// Another datum comes to the step's one, whose G stands in the sum alone.
void StepStore::separate_quadratic(StoredStep& step) {
  ProjectedForm& only = step.data.begin()->second;
  if (only.form.quadratic.size() > 0) return;
  Eigen::MatrixXd& own = shares_quadratic(only) ? step.complete_quadratic : only.form.quadratic;
  if (own.size() == 0) own = step.form.quadratic;
}

void StepStore::store(StoredStep& step, DatumPointer datum, Projected projected) {
  const DatumKey key = datum->key;
  ProjectedForm stored{std::move(datum), std::move(projected.form)};
  step.moved = std::move(projected.moved);
  step.lasting_errors = projector_.lasting_errors();
  if (step.data.size() == 1 && step.data.contains(key)) step.data.clear();  // it takes that one's place
  if (step.data.empty()) {
    step.form = stored.form;
    stored.form.quadratic.resize(0, 0);
    step.data.emplace(key, std::move(stored));
    return;
  }
  if (step.data.size() == 1) separate_quadratic(step);
  // The sum goes on where the datum comes last; otherwise it is made again when it is asked for: a replay of
  // n data in any order costs n additions, not n²/2.
  if (step.data.rbegin()->first < key && is_summed(step)) {
    step.form.add(stored.form);
  } else {
    step.form.quadratic.resize(0, 0);
  }
  if (shares_quadratic(stored)) {
    if (step.complete_quadratic.size() == 0) step.complete_quadratic = std::move(stored.form.quadratic);
    stored.form.quadratic.resize(0, 0);
  }
  step.data.insert_or_assign(key, std::move(stored));
}

/// Where data share an error the form of each depends on those before it: all are made again, in order.
void StepStore::project_again() {
  out_of_order_ = false;
  projector_.restart();
  for (auto& [index, step] : steps_) {
    const auto data = std::exchange(step.data, {});
    for (const auto& [key, projected] : data) store(step, projected.datum, project(step, *projected.datum));
  }
}

void StepStore::mark_changed(std::size_t step) {
  changed_ = std::min(step, changed_.value_or(step));
}

}  // namespace knothe::likelihood
