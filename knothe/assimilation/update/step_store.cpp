#include "knothe/assimilation/update/step_store.hpp"

#include <fmt/format.h>

#include <iterator>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {

void FormSums::add(const StoredStep& step) {
  if (levels.empty()) levels.assign(step.levels.size(), form);
  for (std::size_t k = 0; k < levels.size(); ++k)
    levels[k].add(step.levels.empty() ? step.form : step.levels[k]);
  form.add(step.assimilated());
}

StepStore::StepStore(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
                     const Eigen::VectorXd& centre)
    : projector_(std::move(model), std::move(noise), centre) {}

void StepStore::add(std::size_t step, std::size_t time_index,
                    const Eigen::Ref<const Eigen::VectorXd>& values) {
  if (steps_.contains(step)) {
    throw UsageError(fmt::format("step {} is assimilated already: take it out before putting it back", step));
  }
  const bool in_order = steps_.empty() || last() < step;
  StoredStep stored;
  stored.time_index = time_index;
  stored.time = projector_.model().time[time_index];
  if (values_ || projector_.depends_on_order()) stored.values = values;
  // Throws for data that cannot be; nothing has changed then.
  project(step, values, stored);
  steps_[step] = std::move(stored);
  forget_evidence_from(step);
  if (!in_order) project_again();
}

void StepStore::put(std::size_t step, std::size_t time_index, StepForm form, Eigen::VectorXd values,
                    std::optional<MovedForm> moved) {
  StoredStep stored;
  stored.moved = std::move(moved);
  stored.values = std::move(values);
  stored.form = std::move(form);
  stored.time_index = time_index;
  stored.time = projector_.model().time[time_index];
  steps_[step] = std::move(stored);
  forget_evidence_from(step);
}

void StepStore::remove(std::size_t step) {
  if (steps_.erase(step) == 0)
    throw UsageError(fmt::format("step {} is not assimilated: there is nothing to take out", step));
  forget_evidence_from(step);
  project_again();
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

void StepStore::project(std::size_t step, const Eigen::Ref<const Eigen::VectorXd>& values,
                        StoredStep& stored) {
  projector_.project(step, stored.time_index, values, stored.form,
                     makes_moved_forms() ? &stored.moved.emplace() : nullptr);
}

/// Where steps share an error the form of each depends on those before it: all are made again, in order.
void StepStore::project_again() {
  if (!projector_.depends_on_order()) return;
  projector_.restart();
  for (auto& [step, stored] : steps_) project(step, stored.values, stored);
}

void StepStore::forget_evidence_from(std::size_t step) {
  for (auto it = steps_.lower_bound(step); it != steps_.end(); ++it) it->second.log_evidence.reset();
}

}  // namespace knothe::assimilation
