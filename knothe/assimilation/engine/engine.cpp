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
}

Engine Engine::with_setup(EngineSetup setup) const {
  setup.update = setup_.update;
  setup.corrected_steps = setup_.corrected_steps;
  Engine other(std::move(setup));
  for (const likelihood::DatumPointer& datum : data_.all()) other.add(datum);
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
  if (!data_.add(kept)) return;
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
    data_.withdraw(datum.step, datum.key);
    throw;
  }
  mark_changed(datum.step);
}

bool Engine::withdraw(std::size_t step, const DatumKey& key) {
  if (!data_.withdraw(step, key)) return false;
  method_->withdraw(step, key);
  for (const auto& candidate : candidates_) candidate->withdraw(step, key);
  if (data_.count(step) == 0) stale_.erase(step);
  mark_changed(step);
  return true;
}

void Engine::mark_changed(std::size_t step) {
  for (auto it = data_.steps().lower_bound(step); it != data_.steps().end(); ++it) stale_.insert(it->first);
  setup_.scores.forget_from(step);
  assessor_.forget_from(step);
  while (!examined_.empty() && examined_.back()->step >= step) examined_.pop_back();
  if (!watched_ || *watched_ < step) return;
  watch_ = likelihood::SensorWatch(setup_.noise);
  watched_.reset();
}

StepResult Engine::posterior_at(std::size_t step) {
  stale_.erase(step);
  const likelihood::DatumPointer last = data_.last(step);
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
  const auto& steps = data_.steps();
  for (auto it = watched_ ? steps.upper_bound(*watched_) : steps.begin();
       it != steps.end() && it->first <= step; ++it) {
    const likelihood::Datum& last = *it->second.rbegin()->second;
    watch_.observe(last.values, setup_.model->predict(centre_, last.time_index));
  }
  watched_ = step;
  result.stuck = watch_.stuck();
  result.absent = watch_.absent();
}

/// All data up to `step`, in the order of the steps.
std::span<const likelihood::DatumPointer> Engine::data_up_to(std::size_t step) {
  while (!examined_.empty() && examined_.back()->step > step) examined_.pop_back();
  const auto seen = examined_.empty() ? std::nullopt : std::optional(examined_.back()->step);
  for (likelihood::DatumPointer& datum : data_.between(seen, step)) examined_.push_back(std::move(datum));
  return examined_;
}

/// Says whether the result may be used.
void Engine::assess(std::size_t step, StepResult& result) {
  const auto start = monotonic_now();
  auto data = data_up_to(step);
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
  posterior.corrected = update != nullptr && update->is_corrected();
  if (method_->changes().possible()) {
    std::vector<std::size_t> steps;
    for (const likelihood::DatumPointer& datum : data) steps.push_back(datum->step);
    data = data.subspan(method_->changes().count_forgotten(steps));
    assessor_.forget_from(0);
  } else if (update != nullptr) {
    posterior.all_data = &update->sums();
  }
  result.update.verdict = assessor_.assess(posterior, data);
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
  const likelihood::DatumPointer last = data_.last(step);
  if (!last) throw UsageError(fmt::format("step {} has no data", step));
  Datum datum = *last;
  if (!datum.noise) datum.noise = setup_.noise.at_step(step);
  return datum;
}

std::optional<likelihood::StepForm> Engine::form_up_to(std::size_t step) {
  return method_->form_up_to(step);
}

}  // namespace knothe::assimilation
