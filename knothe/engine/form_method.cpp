#include "knothe/engine/form_method.hpp"

#include <utility>

namespace knothe::engine {

using assimilation::Datum;
using assimilation::DatumKey;
using assimilation::NoiseModel;
using assimilation::StepForm;

FormMethod::FormMethod(const MethodSetup& setup)
    : noise_(setup.noise),
      update_(setup.model, setup.noise, setup.priors, setup.update),
      projector_(setup.model, setup.noise, update_.centre()),
      corrects_(setup.update.learn_bias ||
                setup.update.bias_correction != assimilation::BiasCorrectionMode::off) {
  if (setup.corrected_steps) update_.redo((*setup.corrected_steps)[0], (*setup.corrected_steps)[1]);
}

/// The sum of a step's data, in the order of their keys. Where one came between others it is summed anew,
/// once, when it is asked for: a replay of n data in any order costs n additions, not n²/2.
StepForm FormMethod::sum_of(const Step& step) const {
  if (step.sum.quadratic.size() > 0) return step.sum;
  StepForm sum = StepForm::zero(projector_.central_functions().size());
  for (const auto& [key, c] : step.data) {
    StepForm form = c.form;
    if (form.quadratic.size() == 0) form.quadratic = step.complete_quadratic;
    sum.add(form);
  }
  return sum;
}

void FormMethod::add(const Datum& datum) {
  const auto found = steps_.find(datum.step);
  const bool is_new = found == steps_.end();
  Step& step = is_new ? steps_[datum.step] : found->second;
  step.time_index = datum.time_index;
  StepForm form;
  try {
    form = project(datum.step, step, datum.values, datum.noise);
  } catch (...) {
    if (is_new) steps_.erase(datum.step);
    throw;
  }
  const bool last = std::next(steps_.find(datum.step)) == steps_.end() &&
                    (step.data.empty() || step.data.rbegin()->first < datum.key);
  keep(step, datum.key, form, datum.values, datum.noise);
  if (projector_.depends_on_order() && !last) out_of_order_ = true;
  changed_.insert(datum.step);
}

StepForm FormMethod::project(std::size_t index, Step& step, const Eigen::VectorXd& values,
                             const std::optional<NoiseModel>& noise) {
  if (noise || step.own_noise) {
    projector_.set_noise_of(index, noise ? *noise : noise_.at_step(index));
    update_.set_step_noise(index, noise ? *noise : noise_.at_step(index));
    step.own_noise = noise.has_value();
  }
  StepForm form;
  step.moved.reset();
  projector_.project(index, step.time_index, values, form,
                     update_.wants_moved_forms() ? &step.moved.emplace() : nullptr);
  return form;
}

void FormMethod::keep(Step& step, const DatumKey& key, const StepForm& form, const Eigen::VectorXd& values,
                      const std::optional<NoiseModel>& noise) {
  Contribution contribution{form, {}, {}};
  if (form.missing == 0 && !noise && !projector_.depends_on_order()) {
    if (step.complete_quadratic.size() == 0) step.complete_quadratic = form.quadratic;
    contribution.form.quadratic.resize(0, 0);
  }
  if (projector_.depends_on_order() || corrects_) {
    contribution.values = values;
    contribution.noise = noise;
  }
  const bool last = step.data.empty() || step.data.rbegin()->first < key;
  if (step.data.empty()) step.sum = StepForm::zero(form.linear.size());
  step.data.insert_or_assign(key, std::move(contribution));
  if (!last) {
    step.sum.quadratic.resize(0, 0);  // see sum_of
  } else if (step.sum.quadratic.size() > 0) {
    step.sum.add(form);
  }
}

void FormMethod::withdraw(std::size_t index, const DatumKey& key) {
  Step& step = steps_.at(index);
  step.data.erase(key);
  step.sum.quadratic.resize(0, 0);
  step.moved.reset();
  if (projector_.depends_on_order()) out_of_order_ = true;
  if (!step.data.empty()) {
    changed_.insert(index);
    return;
  }
  if (step.own_noise) {
    projector_.set_noise_of(index, noise_.at_step(index));
    update_.set_step_noise(index, noise_.at_step(index));
  }
  steps_.erase(index);
  changed_.erase(index);
  update_.take_out(index);
}

/// Where data share an error the form of each depends on those before it: all are made again, in order.
void FormMethod::project_again() {
  if (!out_of_order_) return;
  out_of_order_ = false;
  projector_.restart();
  for (auto& [index, step] : steps_) {
    const auto data = std::exchange(step.data, {});
    for (const auto& [key, kept] : data)
      keep(step, key, project(index, step, kept.values, kept.noise), kept.values, kept.noise);
    changed_.insert(index);
  }
}

void FormMethod::put_changes() {
  project_again();
  for (const std::size_t index : changed_) {
    Step& step = steps_.at(index);
    step.sum = sum_of(step);
    // A correction goes by the values themselves, and by the moved form: those of the step's one datum.
    const bool one = step.data.size() == 1;
    update_.put(index, step.time_index, step.sum,
                corrects_ && one ? step.data.begin()->second.values : Eigen::VectorXd(),
                one ? std::exchange(step.moved, std::nullopt) : std::nullopt);
  }
  changed_.clear();
}

const assimilation::UpdateResult& FormMethod::conclude(std::size_t step) {
  put_changes();
  return update_.follow(step);
}

const assimilation::UpdateResult& FormMethod::preview(std::size_t step) {
  put_changes();
  return update_.preview(step);
}

std::optional<StepForm> FormMethod::form_up_to(std::size_t step) const {
  StepForm sum = StepForm::zero(projector_.central_functions().size());
  for (auto it = steps_.begin(); it != steps_.end() && it->first <= step; ++it) {
    // Data of a structure that changes grow old; a power of 1 leaves the sum as it is, to the bit.
    if (it != steps_.begin()) sum.raise(update_.power_before(it->first));
    sum.add(sum_of(it->second));
  }
  return sum;
}

}  // namespace knothe::engine
