#include "knothe/library/assimilation.hpp"

#include <fmt/format.h>

#include "knothe/base/text.hpp"
#include "knothe/library/engine_of_values.hpp"
#include "knothe/library/plain.hpp"

namespace knothe {

using library::noise_of, library::plain, library::vector_of;

namespace {

Verdict verdict_of(const assimilation::Verdict& verdict) {
  const auto level = [](assimilation::VerdictLevel l) { return static_cast<Verdict::Level>(l); };
  Verdict result{level(verdict.level), {}};
  for (const assimilation::VerdictReason& reason : verdict.reasons)
    result.reasons.push_back({to_text(reason.part), level(reason.level), reason.message});
  return result;
}

}  // namespace

struct Assimilation::Implementation {
  assimilation::Engine engine;

  explicit Implementation(assimilation::EngineSetup setup) : engine(std::move(setup)) {}

  /// The posterior of all data.
  [[nodiscard]] Posterior posterior() {
    const auto last = engine.last_step();
    if (!last) return {};
    const assimilation::UpdateResult result = engine.posterior_at(*last).update;
    Posterior p = plain(result);
    p.verdict = verdict_of(result.verdict);
    return p;
  }
  void require_step(std::size_t step) const {
    const std::size_t steps = engine.model().time.size();
    if (step >= steps)
      throw UsageError(fmt::format("step {}: the model has the steps 0 to {}", step, steps - 1));
  }
};

Assimilation::Assimilation(const std::string& model_file, const Sensors& sensors, const Noise& noise,
                           const std::vector<Prior>& priors, const AssimilationOptions& options)
    : implementation_(std::make_unique<Implementation>(
          library::engine_setup(model_file, sensors, noise, priors, options))) {}
Assimilation::~Assimilation() = default;
Assimilation::Assimilation(Assimilation&&) noexcept = default;
Assimilation& Assimilation::operator=(Assimilation&&) noexcept = default;

std::vector<double> Assimilation::times() const {
  return implementation_->engine.model().time;
}
std::vector<std::size_t> Assimilation::steps() const {
  return implementation_->engine.data().step_numbers();
}

std::vector<double> Assimilation::predict(std::span<const double> p, std::size_t step) const {
  implementation_->require_step(step);
  const std::size_t dimension = implementation_->engine.model().parameters.size();
  if (p.size() != dimension)
    throw UsageError(fmt::format("prediction at {} parameters: the model has {}", p.size(), dimension));
  return plain(implementation_->engine.model().predict(vector_of(p), step));
}

Posterior Assimilation::assimilate(const Datum& datum) {
  implementation_->require_step(datum.step);
  const std::size_t sensors = implementation_->engine.model().observations();
  if (datum.values.size() != sensors)
    throw UsageError(fmt::format("datum of step {}: {} for {}; NaN stands for one that is missing",
                                 datum.step, counted(datum.values.size(), "value"),
                                 counted(sensors, "sensor")));
  if (implementation_->engine.data().count(datum.step) > 0)
    throw UsageError(
        fmt::format("step {} is assimilated already: withdraw it before adding another", datum.step));
  likelihood::Datum added{{}, datum.step, datum.step, vector_of(datum.values), std::nullopt};
  if (!datum.noise.empty()) added.noise = noise_of(datum.noise, sensors);
  implementation_->engine.add(added);
  return implementation_->posterior();
}

Posterior Assimilation::withdraw(std::size_t step) {
  if (!implementation_->engine.withdraw(step, {}))
    throw UsageError(fmt::format("step {} is not assimilated: there is nothing to withdraw", step));
  return implementation_->posterior();
}

}  // namespace knothe
