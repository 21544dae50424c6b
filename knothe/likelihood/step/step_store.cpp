#include "knothe/likelihood/step/step_store.hpp"

#include <fmt/format.h>

#include <algorithm>
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
  const auto [it, is_new] = steps_.try_emplace(index);
  StoredStep& step = it->second;
  step.time_index = time_index;
  step.time = projector_.model().time[time_index];
  Projected projected;
  try {
    projected = project(step, *datum);
  } catch (...) {
    restore_noise(index, step);
    if (is_new) steps_.erase(it);
    throw;
  }
  const bool last =
      std::next(it) == steps_.end() && (step.data.empty() || step.data.rbegin()->first < datum->key);
  store(step, std::move(datum), std::move(projected));
  if (projector_.depends_on_order() && !last) out_of_order_ = true;
  mark_changed(index);
}

void StepStore::withdraw(std::size_t index, const DatumKey& key) {
  const auto it = steps_.find(index);
  if (it == steps_.end() || it->second.data.erase(key) == 0)
    throw UsageError(fmt::format("step {} is not assimilated: there is nothing to withdraw", index));
  StoredStep& step = it->second;
  step.form.quadratic.resize(0, 0);
  step.moved.reset();
  restore_noise(index, step);
  if (step.data.empty()) steps_.erase(it);
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
  return changed;
}

StepStore::Steps::iterator StepStore::find(std::size_t step) {
  const auto it = steps_.find(step);
  if (it == steps_.end())
    throw UsageError(fmt::format("step {} is not assimilated: there is no posterior of it", step));
  return it;
}

StepStore::Steps::iterator StepStore::before(std::size_t step, int back) {
  auto it = steps_.find(step);
  for (; back > 0 && it != steps_.begin(); --back) --it;
  return it;
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
