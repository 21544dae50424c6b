#include "knothe/service/site/verifier.hpp"

#include <sys/resource.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/model/simulator/kept_solutions.hpp"
#include "knothe/project/refinement.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {
namespace {

constexpr int k_nice = 10;                     // of the thread, and of the solvers that it starts
constexpr std::size_t k_results_at_once = 64;  // what waits to be shown: memory is finite

std::unique_ptr<assimilation::Engine> engine_of(const ServedModel& model, const likelihood::DataSet& data) {
  auto engine = std::make_unique<assimilation::Engine>(model.engine_setup());
  if (const auto last = data.last_step())
    data.for_each(std::nullopt, *last, [&](const likelihood::DatumPointer& datum) {
      apply_changes({{datum, true}}, *engine);
    });
  return engine;
}

}  // namespace

void apply_changes(const std::vector<DataChange>& changes, assimilation::Engine& engine) {
  for (const auto& [datum, comes] : changes) {
    try {
      comes ? engine.add(datum) : (void)engine.withdraw(datum->step, datum->key);
    } catch (const Error& error) {
      log_event("error", "a datum cannot be assimilated",
                {{"source", datum->key.source},
                 {"session", datum->key.session},
                 {"seq", datum->key.seq},
                 {"step", datum->step},
                 {"reason", error.what()}});
    }
  }
}

Verifier::Verifier(const project::Project& project, std::string journal, Listener listener)
    : project_(project), journal_(std::move(journal)), listener_(std::move(listener)) {
  (void)project::full_order_simulator(project_);
  thread_ = std::thread([this] { run(); });
}

void Verifier::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  stop_.request_stop();
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

bool Verifier::stopping() const {
  return stop_.stop_requested() || cancellation_requested();
}

bool Verifier::is_busy() const {
  const std::lock_guard lock(mutex_);
  return busy_;
}

bool Verifier::has_news() const {
  const std::lock_guard lock(mutex_);
  return !results_.empty() || handover_;
}

void Verifier::ask(Question question) {
  {
    const std::lock_guard lock(mutex_);
    question_ = std::move(question);
    changes_.clear();
    busy_ = true;
  }
  changed_.notify_all();
}

void Verifier::note(DataChange change) {
  const std::lock_guard lock(mutex_);
  if (busy_) changes_.push_back(std::move(change));
}

std::optional<Verifier::Result> Verifier::next_result() {
  std::optional<Result> result;
  {
    const std::lock_guard lock(mutex_);
    if (results_.empty()) return result;
    result = std::move(results_.front());
    results_.pop_front();
  }
  changed_.notify_all();
  return result;
}

std::optional<Verifier::Handover> Verifier::handover() {
  const std::lock_guard lock(mutex_);
  if (!handover_ || !results_.empty()) return std::nullopt;
  handover_->changes = std::exchange(changes_, {});
  busy_ = false;
  return std::exchange(handover_, std::nullopt);
}

void Verifier::discard(std::unique_ptr<assimilation::Engine> engine) {
  {
    const std::lock_guard lock(mutex_);
    discarded_ = std::move(engine);
  }
  changed_.notify_all();
}

void Verifier::run() {
  // Of this thread alone, in Linux; what it starts has it too.
  (void)::setpriority(PRIO_PROCESS, 0, k_nice);
  while (true) {
    std::unique_ptr<assimilation::Engine> discarded;
    std::optional<Question> question;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return stopping_ || question_ || discarded_; });
      if (stopping_) return;
      discarded = std::move(discarded_);
      question = std::exchange(question_, std::nullopt);
    }
    if (!question) continue;
    try {
      answer(*question);
    } catch (const std::exception& error) {
      if (!stopping())
        log_event("error", "the request to the full-order model failed",
                  {{"site", project_.serve.site}, {"reason", error.what()}});
    }
    {
      const std::lock_guard lock(mutex_);
      if (!handover_) busy_ = false;
    }
    listener_.wake();
  }
}

void Verifier::answer(const Question& question) {
  const Verification& before = question.model->verification;
  const auto model = refine(question);
  const Verification& now = model->verification;
  if (stopping()) return;
  const bool is_other = now.version != before.version || now.trouble != before.trouble;
  if (!is_other && !question.thorough) return;
  if (!now.trouble.empty())
    log_event("warning", "the model is not verified",
              {{"site", project_.serve.site}, {"step", question.step}, {"reason", now.trouble}});
  // First on disk, then in use: after a restart it is what was shown.
  if (listener_.store(now) && is_other) hand_over(engine_of(*model, question.data), model);
}

/// Asks the full-order model at the posterior of the question's step: the model that is to be used.
std::shared_ptr<const ServedModel> Verifier::refine(const Question& question) {
  Verification v = question.model->verification;
  const std::string folder = refinement_folder(journal_, v.base);
  v.thorough = question.thorough;
  v.time = question.model->setup.problem.model->time.at(question.step);
  v.trouble.clear();
  try {
    auto engine = engine_of(*question.model, question.data);
    assimilation::StepResult result = engine->posterior_at(question.step);
    auto simulator = project::full_order_simulator(project_, folder, stop_.get_token());
    project::RefinementStart start{model::kept_solutions(*simulator, folder), v.runs, v.version, true, true};
    start.used = std::min(start.used, start.solutions.size());
    project::Refinement refinement(project_, question.model->setup, std::move(simulator), folder,
                                   std::move(start));
    const bool is_refined = refinement.refine_if_needed(engine, result, question.thorough);
    v.trouble = refinement.trouble();
    // Where all runs allowed were made before, nothing is new.
    if (!is_refined && v.trouble.empty() && v.runs >= static_cast<std::size_t>(project_.method.verify_runs))
      v.trouble = question.model->verification.trouble;
    if (is_refined) {
      v.version = refinement.version();
      v.runs = refinement.runs();
      v.moved_std = refinement.whole_move().mean;
      v.model = to_hex(sha256_of_file(refinement.file()));
      project::Project project = project_;
      project.model = refinement.file();
      return std::make_shared<const ServedModel>(
          ServedModel{std::move(project), *refinement.setup(), std::move(v)});
    }
  } catch (const std::exception& error) {  // whatever it is, the answer without it is kept
    v.trouble = project::not_verified(error.what());
  }
  // The same trouble as before: what is shown stays, and is the same after a restart.
  const Verification& before = question.model->verification;
  if (!v.trouble.empty() && v.trouble == before.trouble) v.time = before.time;
  return std::make_shared<const ServedModel>(
      ServedModel{question.model->project, question.model->setup, std::move(v)});
}

/// Assimilates what has come meanwhile, and shows every step as this model sees it, until nothing is left
/// that would cost the updating thread time.
void Verifier::hand_over(std::unique_ptr<assimilation::Engine> engine,
                         const std::shared_ptr<const ServedModel>& model) {
  while (true) {
    std::vector<DataChange> changes;
    {
      const std::lock_guard lock(mutex_);
      changes.swap(changes_);
    }
    apply_changes(changes, *engine);
    if (engine->stale().empty()) break;
    if (stopping()) return;
    const std::size_t step = *engine->stale().begin();
    try {
      assimilation::StepResult result = engine->posterior_at(step);
      model->amend(result);
      show({std::move(result), model});
    } catch (const Error& error) {
      if (stopping()) return;
      log_event("error", "an update failed",
                {{"site", project_.serve.site}, {"step", step}, {"reason", error.what()}});
    }
  }
  {
    const std::lock_guard lock(mutex_);
    handover_ = {std::move(engine), model, {}};
  }
  listener_.wake();
}

void Verifier::show(Result result) {
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return stopping_ || results_.size() < k_results_at_once; });
    results_.push_back(std::move(result));
  }
  listener_.wake();
}

}  // namespace knothe::service
