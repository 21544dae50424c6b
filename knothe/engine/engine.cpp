#include "knothe/engine/engine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <utility>

#include "knothe/assimilation/update/prior_of_model.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/base/text.hpp"

namespace knothe::engine {

using assimilation::Datum;
using assimilation::DatumKey;

Engine::Engine(EngineSetup setup)
    : setup_(std::move(setup)),
      priors_(assimilation::truncated_to_box(*setup_.model, setup_.priors)->priors()),
      centre_(assimilation::medians(assimilation::PriorTransform(priors_))),
      method_(make_method(setup_)),
      watch_(setup_.noise),
      assessor_(setup_.model, setup_.noise, priors_, setup_.sensors, setup_.robust,
                std::exchange(setup_.known_errors, {}), setup_.update.monitor) {
  for (const CandidateModel& candidate : setup_.candidates)
    candidates_.push_back(make_method(candidate.setup));
}

Engine Engine::with_setup(EngineSetup setup) const {
  setup.update = setup_.update;
  setup.corrected_steps = setup_.corrected_steps;
  Engine other(std::move(setup));
  for (const Datum& datum : data()) other.add(datum);
  return other;
}

StepResult Engine::assimilate(const Datum& datum) {
  add(datum);
  return conclude(datum.step);
}

void Engine::require_fits(const Datum& datum) const {
  if (datum.values.size() != setup_.model->observations())
    throw UsageError(fmt::format("step {}: {} for {}", datum.step,
                                 counted(static_cast<std::size_t>(datum.values.size()), "value"),
                                 counted(static_cast<std::size_t>(setup_.model->observations()), "sensor")));
  if (datum.time_index >= setup_.model->time.size())
    throw UsageError(fmt::format("step {}: the model has {} times, there is no time {}", datum.step,
                                 setup_.model->time.size(), datum.time_index));
  for (const CandidateModel& candidate : setup_.candidates)
    if (candidate.time_indices.at(datum.time_index) >= candidate.setup.model->time.size())
      throw DataError(fmt::format("step {}: the model {} has no time {}", datum.step, candidate.name,
                                  setup_.model->time[datum.time_index]));
  const auto found = steps_.find(datum.step);
  if (found != steps_.end() && found->second.time_index != datum.time_index)
    throw UsageError(fmt::format("step {}: its data are of model time {}, not {}", datum.step,
                                 found->second.time_index, datum.time_index));
}

void Engine::add(const Datum& datum) {
  require_fits(datum);
  const auto found = steps_.find(datum.step);
  if (found != steps_.end() && found->second.data.contains(datum.key)) return;
  method_->add(datum);
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    Datum seen = datum;
    seen.time_index = setup_.candidates[k].time_indices.at(datum.time_index);
    candidates_[k]->add(seen);
  }
  Step& step = steps_[datum.step];
  step.time_index = datum.time_index;
  step.data.emplace(datum.key, Step::Kept{datum.values, datum.noise});
  mark_changed(datum.step);
}

bool Engine::withdraw(std::size_t step, const DatumKey& key) {
  const auto found = steps_.find(step);
  if (found == steps_.end() || !found->second.data.erase(key)) return false;
  method_->withdraw(step, key);
  for (const auto& candidate : candidates_) candidate->withdraw(step, key);
  if (found->second.data.empty()) {
    steps_.erase(found);
    stale_.erase(step);
  }
  mark_changed(step);
  return true;
}

void Engine::mark_changed(std::size_t step) {
  for (auto it = steps_.lower_bound(step); it != steps_.end(); ++it) stale_.insert(it->first);
  setup_.scores.forget_from(step);
  assessor_.forget_from(step);
  while (!examined_.empty() && examined_.back().step >= step) examined_.pop_back();
  if (!watched_ || *watched_ < step) return;
  watch_ = assimilation::SensorWatch(setup_.noise);
  watched_.reset();
}

StepResult Engine::conclude(std::size_t step) {
  stale_.erase(step);
  const Step& here = steps_.at(step);
  auto scores = setup_.scores.look(step, here.time_index, here.last_values());
  StepResult result = result_of(method_->conclude(step));
  result.scores = std::move(scores);
  if (method_->sensors() != nullptr) result.sensors = *method_->sensors();
  if (setup_.watches_sensors) watch_sensors(step, result);
  if (!candidates_.empty()) compare_models(step, result);
  if (const auto* update = method_->update(); update != nullptr && result.update.bias_corrected) {
    result.bias_functions = update->discrepancy();
    if (const auto* learnt = update->bias())
      if (auto bias = learnt->latest()) result.bias_sensors = std::move(*bias);
  }
  setup_.scores.keep(step, result.update.time, result.update.points, result.update.weights);
  assess(step, result);
  return result;
}

StepResult Engine::preview(std::size_t step) {
  StepResult result = result_of(method_->preview(step));
  result.followed = false;
  assess(step, result);
  return result;
}

StepResult Engine::result_of(const assimilation::UpdateResult& update) {
  StepResult result;
  result.update = update;
  result.computed_at = std::chrono::system_clock::now();
  result.model_version = setup_.model_version;
  if (!setup_.forecaster) return result;
  const auto start = monotonic_now();
  result.forecasts = setup_.forecaster->update(result.update.points, result.update.weights);
  forecast::mark_past(result.forecasts, result.update.time);
  result.forecast_us = microseconds_since(start);
  return result;
}

std::vector<forecast::NamedForecast> Engine::published_forecasts(const StepResult& result) {
  if (!setup_.forecaster) return {};
  return setup_.forecaster->published(result.update.points, result.update.weights);
}

void Engine::watch_sensors(std::size_t step, StepResult& result) {
  for (auto it = watched_ ? steps_.upper_bound(*watched_) : steps_.begin();
       it != steps_.end() && it->first <= step; ++it)
    watch_.look(it->second.last_values(), setup_.model->predict(centre_, it->second.time_index));
  watched_ = step;
  result.stuck = watch_.stuck();
  result.absent = watch_.absent();
}

/// All data up to `step`, in the order of the steps.
std::span<const assimilation::ExaminedDatum> Engine::data_up_to(std::size_t step) {
  while (!examined_.empty() && examined_.back().step > step) examined_.pop_back();
  auto it = examined_.empty() ? steps_.begin() : steps_.upper_bound(examined_.back().step);
  for (; it != steps_.end() && it->first <= step; ++it)
    for (const auto& [key, kept] : it->second.data)
      examined_.push_back(
          {it->first, it->second.time_index, &kept.values, kept.noise ? &*kept.noise : nullptr});
  return examined_;
}

/// Says whether the result may be used.
void Engine::assess(std::size_t step, StepResult& result) {
  const auto start = monotonic_now();
  auto data = data_up_to(step);
  const assimilation::SequentialUpdate* update = result.followed ? method_->update() : nullptr;
  std::optional<assimilation::PosteriorFunctions> made;
  if (update == nullptr)
    made = assimilation::posterior_functions(*setup_.model->functions, result.update.points,
                                             result.update.weights);
  assimilation::AssessedPosterior posterior{
      result.update, made ? *made : update->functions(), nullptr, nullptr, false, result.stuck};
  posterior.latest = method_->form_of(step);
  posterior.corrected = update != nullptr && update->is_corrected();
  if (update != nullptr && update->changes().possible()) {
    std::vector<std::size_t> steps;
    for (const assimilation::ExaminedDatum& datum : data) steps.push_back(datum.step);
    data = data.subspan(update->changes().count_forgotten(steps));
    assessor_.forget_from(0);
  } else if (update != nullptr) {
    posterior.all_data = &update->sums();
  }
  result.update.verdict = assessor_.assess(posterior, data);
  result.update.elapsed_us.verdict = microseconds_since(start);
}

void Engine::compare_models(std::size_t step, StepResult& result) {
  std::vector<std::string> names = {setup_.name};
  std::vector<double> evidences = {result.update.log_evidence};
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    names.push_back(setup_.candidates[k].name);
    evidences.push_back(candidates_[k]->conclude(step).log_evidence);
  }
  result.models = assimilation::compare_models(names, evidences);
}

std::vector<Datum> Engine::data() const {
  std::vector<Datum> all;
  for (const auto& [number, step] : steps_)
    for (const auto& [key, kept] : step.data)
      all.push_back({key, number, step.time_index, kept.values, kept.noise});
  return all;
}

std::vector<std::size_t> Engine::steps() const {
  std::vector<std::size_t> steps;
  for (const auto& [step, data] : steps_) steps.push_back(step);
  return steps;
}

std::optional<std::size_t> Engine::last_step() const {
  if (steps_.empty()) return std::nullopt;
  return steps_.rbegin()->first;
}

std::size_t Engine::data_count(std::size_t step) const {
  const auto it = steps_.find(step);
  return it == steps_.end() ? 0 : it->second.data.size();
}

Datum Engine::last_datum(std::size_t step) const {
  const auto found = steps_.find(step);
  if (found == steps_.end()) throw UsageError(fmt::format("step {} has no data", step));
  const auto& [key, kept] = *found->second.data.rbegin();
  return {key, step, found->second.time_index, kept.values,
          kept.noise ? *kept.noise : setup_.noise.at_step(step)};
}

Eigen::VectorXd Engine::last_values(std::size_t step) const {
  const auto it = steps_.find(step);
  return it == steps_.end() ? Eigen::VectorXd() : it->second.last_values();
}

std::optional<assimilation::StepForm> Engine::form_up_to(std::size_t step) {
  return method_->form_up_to(step);
}

}  // namespace knothe::engine
