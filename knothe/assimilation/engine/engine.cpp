#include "knothe/assimilation/engine/engine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"

namespace knothe::assimilation {

using likelihood::Datum;
using likelihood::DatumKey;

Engine::Engine(EngineSetup setup)
    : setup_(std::move(setup)),
      priors_(likelihood::truncated_to_box(*setup_.model, setup_.priors)->priors()),
      centre_(likelihood::medians(posterior::PriorTransform(priors_))),
      method_(make_method(setup_)),
      watch_(setup_.noise),
      assessor_(setup_.model, setup_.noise, priors_, setup_.sensors, setup_.robust,
                std::exchange(setup_.known_errors, {}), setup_.update.monitor, setup_.axes) {
  for (const CandidateModel& candidate : setup_.candidates)
    candidates_.push_back(make_method(candidate.problem));
  if (setup_.archive.empty()) return;
  data_->set_archive(setup_.archive);
  const auto recall = [data = data_](std::size_t step) { return data->at(step); };
  method_->set_recall(recall, setup_.kept_in_memory);
  for (const auto& candidate : candidates_) candidate->set_recall(recall, setup_.kept_in_memory);
}

Engine Engine::with_setup(EngineSetup setup) const {
  setup.update = setup_.update;
  setup.corrected_steps = setup_.corrected_steps;
  Engine other(std::move(setup));
  if (const auto last = data_->last_step())
    data_->for_each(std::nullopt, *last, [&](const likelihood::DatumPointer& datum) { other.add(datum); });
  return other;
}

StepResult Engine::assimilate(const Datum& datum) {
  add(datum);
  return posterior_at(datum.step);
}

void Engine::require_fits(const Datum& datum) const {
  if (datum.values.size() != setup_.model->observations())
    throw UsageError(fmt::format("step {}: {} for {}", datum.step, counted(datum.values.size(), "value"),
                                 counted(setup_.model->observations(), "sensor")));
  if (datum.time_index >= setup_.model->time.size())
    throw UsageError(fmt::format("step {}: the model has {} times, there is no time {}", datum.step,
                                 setup_.model->time.size(), datum.time_index));
  for (const CandidateModel& candidate : setup_.candidates)
    if (candidate.time_indices.at(datum.time_index) >= candidate.problem.model->time.size())
      throw DataError(fmt::format("step {}: the model {} has no time {}", datum.step, candidate.name,
                                  setup_.model->time[datum.time_index]));
}

void Engine::add(const Datum& datum) {
  add(std::make_shared<const Datum>(datum));
}

void Engine::add(const likelihood::DatumPointer& kept) {
  const Datum& datum = *kept;
  require_fits(datum);
  if (!data_->add(kept)) return;
  std::vector<PosteriorMethod*> added;  // who has it, if a later one refuses it
  const auto add_to = [&](PosteriorMethod& method, std::size_t time_index) {
    method.add(kept, time_index);
    added.push_back(&method);
  };
  try {
    add_to(*method_, datum.time_index);
    for (std::size_t k = 0; k < candidates_.size(); ++k)
      add_to(*candidates_[k], setup_.candidates[k].time_indices.at(datum.time_index));
  } catch (...) {
    for (PosteriorMethod* method : added) method->withdraw(datum.step, datum.key);
    data_->withdraw(datum.step, datum.key);
    throw;
  }
  mark_changed(datum.step);
  release_memory();
}

bool Engine::withdraw(std::size_t step, const DatumKey& key) {
  if (!data_->contains(step, key)) return false;
  method_->withdraw(step, key);
  for (const auto& candidate : candidates_) candidate->withdraw(step, key);
  data_->withdraw(step, key);
  if (data_->count(step) == 0) stale_.erase(step);
  mark_changed(step);
  return true;
}

/// Only data near the step whose turn it is are in memory.
void Engine::release_memory() {
  const std::size_t kept = setup_.kept_in_memory;
  if (!data_->has_archive() || data_->in_memory() < std::max(4 * kept, release_from_)) return;
  const std::size_t at = stale_.empty() ? *data_->last_step() : *stale_.begin();
  data_->keep_in_memory(at - std::min(at, kept), at + kept);
  release_from_ = 2 * data_->in_memory();
}

void Engine::mark_changed(std::size_t step) {
  for (auto at = data_->step_from(step); at; at = data_->step_from(*at + 1)) stale_.insert(*at);
  setup_.scores.forget_from(step);
  assessor_.forget_from(step);
  while (!examined_.empty() && examined_.back()->step >= step) examined_.pop_back();
  if (!watched_ || *watched_ < step) return;
  watch_before_.forget_after(step);
  const auto* milestone = watch_before_.last_up_to(step);
  watch_ = milestone != nullptr ? milestone->second : likelihood::SensorWatch(setup_.noise);
  watched_.reset();
  if (milestone != nullptr && milestone->first > 0) watched_ = milestone->first - 1;
}

StepResult Engine::posterior_at(std::size_t step) {
  stale_.erase(step);
  release_memory();
  const likelihood::DatumPointer last = data_->last(step);
  auto scores = setup_.scores.score(step, last->time_index, last->values);
  StepResult result = result_of(method_->posterior_at(step));
  result.scores = std::move(scores);
  if (method_->sensors() != nullptr) result.sensors = *method_->sensors();
  if (setup_.watches_sensors) watch_sensors(step, result);
  if (!candidates_.empty()) compare_models(step, result);
  if (const auto* update = method_->update(); update != nullptr && result.update.bias_corrected)
    result.bias = update->bias();
  setup_.scores.add_posterior(step, result.update.time, result.update.points, result.update.weights);
  assess(step, result);
  if (setup_.decider) decide(result);
  return result;
}

StepResult Engine::preview(std::size_t step) {
  StepResult result = result_of(method_->preview(step));
  result.followed = false;
  assess(step, result);
  return result;
}

StepResult Engine::result_of(const UpdateResult& update) {
  StepResult result;
  result.update = update;
  result.computed_at = std::chrono::system_clock::now();
  result.model_version = setup_.model_version;
  if (!setup_.forecaster) return result;
  const auto start = monotonic_now();
  result.forecasts = setup_.forecaster->update(result.update.points, result.update.weights);
  mark_past(result.forecasts, result.update.time);
  result.forecast_us = microseconds_since(start);
  return result;
}

std::vector<NamedForecast> Engine::published_forecasts(const StepResult& result) {
  if (!setup_.forecaster) return {};
  return setup_.forecaster->published(result.update.points, result.update.weights);
}

void Engine::watch_sensors(std::size_t step, StepResult& result) {
  const std::size_t first = watched_ ? *watched_ + 1 : 0;
  for (auto at = data_->step_from(first); at && *at <= step; at = data_->step_from(*at + 1)) {
    if (watch_before_.wants(*at)) watch_before_.save(*at, watch_);
    const likelihood::DatumPointer last = data_->last(*at);
    watch_.observe(last->values, setup_.model->predict(centre_, last->time_index));
  }
  watched_ = step;
  result.stuck = watch_.stuck();
  result.absent = watch_.absent();
}

/// The last data up to `step`, as many as the verdict examines and some more, in the order of the steps.
std::span<const likelihood::DatumPointer> Engine::recent_data(std::size_t step) {
  const std::size_t first = data_->step_of_last(VerdictOptions().examined, step);
  while (!examined_.empty() && examined_.back()->step > step) examined_.pop_back();
  if (examined_.empty() || examined_.front()->step > first || examined_.back()->step < first) {
    examined_ = data_->between(first == 0 ? std::nullopt : std::optional(first - 1), step);
    return examined_;
  }
  for (likelihood::DatumPointer& datum : data_->between(examined_.back()->step, step))
    examined_.push_back(std::move(datum));
  if (examined_.size() > 4 * VerdictOptions().examined)
    std::erase_if(examined_, [&](const likelihood::DatumPointer& datum) { return datum->step < first; });
  return examined_;
}

/// Says whether the result may be used.
void Engine::assess(std::size_t step, StepResult& result) {
  const auto start = monotonic_now();
  std::size_t first = 0;  // of the data that still count
  const SequentialUpdate* update = result.followed ? method_->update() : nullptr;
  std::optional<likelihood::PosteriorFunctions> made;
  if (update == nullptr)
    made = likelihood::posterior_functions(*setup_.model->functions, result.update.points,
                                           result.update.weights);
  AssessedPosterior posterior{result.update, made ? *made : update->functions(), nullptr, nullptr, false,
                              result.stuck};
  posterior.latest = method_->form_of(step);
  if (const auto* any = method_->update())
    result.lasting_errors =
        estimated_errors(setup_.noise.lasting(), any->lasting_errors(), posterior.functions);
  posterior.lasting_errors = result.lasting_errors;
  posterior.corrected = update != nullptr && !update->corrected_steps().empty();
  if (method_->changes().possible()) {
    std::vector<std::size_t> steps = data_->step_numbers();
    while (steps.back() > step) steps.pop_back();
    first = steps[method_->changes().count_forgotten(steps)];
    assessor_.forget_from(0);
  } else if (update != nullptr) {
    posterior.all_data = &update->sums();
  }
  result.update.verdict = assessor_.assess(posterior, {recent_data(step), *data_, first, step});
  result.update.elapsed_us.verdict = microseconds_since(start);
}

/// What to do next; where that cannot be told, the answer stays and the specimen is held.
void Engine::decide(StepResult& result) {
  const auto start = monotonic_now();
  const auto hold = [&](const std::string& why) {
    const double now = result.update.time;
    result.decision = {.action = Action::hold, .time = now, .furthest = now, .message = why};
  };
  const auto likeliest =
      std::max_element(result.models.begin(), result.models.end(),
                       [](const auto& a, const auto& b) { return a.probability < b.probability; });
  if (likeliest != result.models.begin()) {
    hold(fmt::format("the model {} is more probable than {}, whose forecasts decide", likeliest->name,
                     setup_.name));
  } else {
    try {
      const auto form = method_->form_up_to(result.update.step);
      result.decision = setup_.decider->decide(result.update, form ? form->quadratic : Eigen::MatrixXd());
    } catch (const NumericalError& error) {
      hold(error.what());
    }
  }
  result.decision_us = microseconds_since(start);
}

void Engine::compare_models(std::size_t step, StepResult& result) {
  std::vector<std::string> names = {setup_.name};
  std::vector<double> evidences = {result.update.log_evidence};
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    names.push_back(setup_.candidates[k].name);
    evidences.push_back(candidates_[k]->posterior_at(step).log_evidence);
  }
  result.models = assimilation::compare_models(names, evidences);
}

Datum Engine::last_datum(std::size_t step) const {
  const likelihood::DatumPointer last = data_->last(step);
  if (!last) throw UsageError(fmt::format("step {} has no data", step));
  Datum datum = *last;
  if (!datum.noise) datum.noise = setup_.noise.at_step(step);
  return datum;
}

std::optional<likelihood::StepForm> Engine::form_up_to(std::size_t step) {
  return method_->form_up_to(step);
}

}  // namespace knothe::assimilation
