#include "knothe/service/site/journal_posterior.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

namespace knothe::service {

using assimilation::StepForm;

namespace {

/// The sum of a step's data, in the order of their keys. Where one came between others it is summed anew,
/// once, when it is asked for: a replay of n data in any order costs n additions, not n²/2.
template <class Step>
StepForm sum_of(const Step& step, Eigen::Index r) {
  if (step.sum.quadratic.size() > 0) return step.sum;
  StepForm sum = StepForm::zero(r);
  for (const auto& [key, c] : step.data) {
    sum.add({c.quadratic ? *c.quadratic : step.complete_quadratic, c.linear, c.constant, c.log_normaliser,
             c.used, c.missing});
  }
  return sum;
}

}  // namespace

JournalPosterior::JournalPosterior(const project::Project& project, const project::UpdateSetup& setup)
    : update_(setup.observed, setup.measurements.noise, setup.priors, setup.options),
      projector_(setup.observed, setup.measurements.noise, update_.centre()),
      forecaster_(project::make_forecaster(project, setup)),
      keeps_values_(setup.options.bias_correction != assimilation::BiasCorrectionMode::off) {}

void JournalPosterior::add(const Datum& datum) {
  const auto index = static_cast<std::size_t>(datum.step);
  if (const auto it = steps_.find(index); it != steps_.end() && it->second.data.contains(datum.key)) return;
  const std::vector<double> sent = datum.effective_values();
  const Eigen::VectorXd values =
      Eigen::Map<const Eigen::VectorXd>(sent.data(), static_cast<Eigen::Index>(sent.size()));
  std::optional<assimilation::MovedForm> moved;
  const StepForm form = project(index, values, moved);
  const bool last_step = steps_.empty() || steps_.rbegin()->first <= index;
  Step& step = steps_[index];
  const bool last = step.data.empty() || step.data.rbegin()->first < datum.key;
  keep(step, datum.key, form, values);
  step.moved = std::move(moved);
  if (last) step.last_values = sent;
  step.received_ms = std::max(step.received_ms, datum.received_ms);
  if (projector_.depends_on_order() && !(last && last_step)) out_of_order_ = true;
  unput_.insert(index);
  for (auto it = steps_.find(index); it != steps_.end(); ++it) stale_.insert(it->first);
}

void JournalPosterior::keep(Step& step, const DatumKey& key, const StepForm& form, Eigen::VectorXd values) {
  Contribution contribution{form.linear, form.constant, form.log_normaliser, form.used, form.missing, nullptr,
                            {}};
  const bool shares = form.missing == 0 && !projector_.depends_on_order();
  if (!shares) {
    contribution.quadratic = std::make_unique<Eigen::MatrixXd>(form.quadratic);
  } else if (step.complete_quadratic.size() == 0) {
    step.complete_quadratic = form.quadratic;
  }
  if (projector_.depends_on_order()) contribution.values = std::move(values);
  const bool last = step.data.empty() || step.data.rbegin()->first < key;
  if (step.data.empty()) step.sum = StepForm::zero(form.linear.size());
  step.data.insert_or_assign(key, std::move(contribution));
  if (!last) {
    step.sum.quadratic.resize(0, 0);  // see sum_of
  } else if (step.sum.quadratic.size() > 0) {
    step.sum.add(form);
  }
}

StepForm JournalPosterior::project(std::size_t index, const Eigen::VectorXd& values,
                                   std::optional<assimilation::MovedForm>& moved) {
  StepForm form;
  projector_.project(index, index, values, form, update_.wants_moved_forms() ? &moved.emplace() : nullptr);
  return form;
}

/// Where data share an error the form of each depends on those before it: all are made again, in order.
void JournalPosterior::project_again() {
  if (!out_of_order_) return;
  out_of_order_ = false;
  projector_.restart();
  for (auto& [index, step] : steps_) {
    const auto data = std::exchange(step.data, {});
    for (const auto& [key, kept] : data) {
      const StepForm form = project(index, kept.values, step.moved);
      keep(step, key, form, kept.values);
    }
    unput_.insert(index);
  }
}

std::optional<std::size_t> JournalPosterior::last_step() const {
  if (steps_.empty()) return std::nullopt;
  return steps_.rbegin()->first;
}

std::size_t JournalPosterior::data_of(std::size_t step) const {
  const auto it = steps_.find(step);
  return it == steps_.end() ? 0 : it->second.data.size();
}

void JournalPosterior::put_changes() {
  project_again();
  for (const std::size_t index : unput_) {
    Step& changed = steps_.at(index);
    changed.sum = sum_of(changed, projector_.central_functions().size());
    // A correction that goes by the values themselves: those of the step's one datum.
    const Eigen::Map<const Eigen::VectorXd> values(changed.last_values.data(),
                                                   static_cast<Eigen::Index>(changed.last_values.size()));
    update_.put(index, index, changed.sum,
                keeps_values_ && changed.data.size() == 1 ? values : Eigen::VectorXd(),
                changed.data.size() == 1 ? std::exchange(changed.moved, std::nullopt) : std::nullopt);
  }
  unput_.clear();
}

JournalPosterior::Conclusion JournalPosterior::conclude(std::size_t step) {
  stale_.erase(step);
  put_changes();
  return with_forecasts(update_.follow(step), true);
}

JournalPosterior::Conclusion JournalPosterior::preview(std::size_t step) {
  put_changes();
  return with_forecasts(update_.preview(step), false);
}

JournalPosterior::Conclusion JournalPosterior::with_forecasts(const assimilation::UpdateResult& result,
                                                              bool followed) {
  const auto start = std::chrono::steady_clock::now();
  auto forecasts = forecaster_.update(update_.posterior().points, update_.posterior().weights);
  const std::chrono::duration<double, std::micro> elapsed = std::chrono::steady_clock::now() - start;
  return {result, update_.posterior(), std::move(forecasts), elapsed.count(), followed};
}

StepForm JournalPosterior::form_up_to(std::size_t step) const {
  StepForm sum = StepForm::zero(projector_.central_functions().size());
  for (auto it = steps_.begin(); it != steps_.end() && it->first <= step; ++it) {
    // Data of a structure that changes grow old; a power of 1 leaves the sum as it is, to the bit.
    if (it != steps_.begin()) sum.raise(update_.changes().power_before(it->first));
    sum.add(sum_of(it->second, sum.linear.size()));
  }
  return sum;
}

std::int64_t JournalPosterior::received_ms(std::size_t step) const {
  const auto it = steps_.find(step);
  return it == steps_.end() ? 0 : it->second.received_ms;
}

std::span<const double> JournalPosterior::last_values(std::size_t step) const {
  const auto it = steps_.find(step);
  return it == steps_.end() ? std::span<const double>() : std::span<const double>(it->second.last_values);
}

}  // namespace knothe::service
