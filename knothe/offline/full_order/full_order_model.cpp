#include "knothe/offline/full_order/full_order_model.hpp"

#include <fmt/format.h>

#include <cmath>
#include <ctime>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/gradient_stepping.hpp"
#include "knothe/offline/full_order/load_stepping.hpp"

namespace knothe::offline {

void SolverOptions::validate() const {
  const auto refuse = [](const std::string& why) { throw ProjectError("full-order model: " + why); };
  if (steps < 1 || steps > 1'000'000) refuse(fmt::format("steps is {}; it must be from 1 to 1000000", steps));
  if (!(displacement > 0) || !std::isfinite(displacement))
    refuse(fmt::format("displacement is {} m; it must be positive", displacement));
  if (!(tolerance > 0) || !(tolerance <= acceptance))
    refuse(fmt::format("tolerance is {}; it must be positive and not above acceptance, {}", tolerance,
                       acceptance));
  if (!(acceptance < 1)) refuse(fmt::format("acceptance is {}; it must be less than 1", acceptance));
  if (newton_iterations < 1 || cuts < 0 || secant_iterations < 0)
    refuse(fmt::format(
        "newton_iterations, cuts and secant_iterations are {}, {} and {}; they must be at least 1, 0 and 0",
        newton_iterations, cuts, secant_iterations));
  if (!(activation > 0 && activation <= 1))
    refuse(fmt::format("activation is {}; it must be above 0 and at most 1", activation));
  regularisation.validate();
}

int FullOrderResult::newton_iterations() const {
  int sum = 0;
  for (const auto& step : steps) sum += step.newton_iterations;
  return sum;
}

int FullOrderResult::secant_iterations() const {
  int sum = 0;
  for (const auto& step : steps) sum += step.secant_iterations;
  return sum;
}

std::vector<int> FullOrderResult::steps_without_equilibrium() const {
  std::vector<int> numbers;
  for (Index i = 0; i < std::ssize(steps); ++i)
    if (!steps[i].equilibrium) numbers.push_back(i);
  return numbers;
}

struct FullOrderModel::Implementation {
  std::shared_ptr<const Structure> structure;
  SolverOptions options;
  std::unique_ptr<Flexibility> flexibility;
  std::vector<double> ratios;  ///< r of each cell (crack band)
};

FullOrderModel::FullOrderModel(std::shared_ptr<const Structure> structure, SolverOptions options)
    : implementation_(std::make_unique<Implementation>()) {
  options.validate();
  implementation_->structure = std::move(structure);
  implementation_->options = options;
  implementation_->ratios = band_ratios(implementation_->structure->mesh(),
                                        implementation_->structure->elements(), options.regularisation);
  if (options.condensation == Condensation::exact &&
      options.regularisation.kind != DamageRegularisation::gradient)
    implementation_->flexibility = std::make_unique<Flexibility>(*implementation_->structure);
}

FullOrderModel::~FullOrderModel() = default;
FullOrderModel::FullOrderModel(FullOrderModel&&) noexcept = default;
FullOrderModel& FullOrderModel::operator=(FullOrderModel&&) noexcept = default;

const Structure& FullOrderModel::structure() const {
  return *implementation_->structure;
}

const SolverOptions& FullOrderModel::options() const {
  return implementation_->options;
}

namespace {

/// All steps of a loading (LoadStepping, GradientStepping).
template <class Loading>
FullOrderResult follow(Loading loading, const Structure& structure, const SolverOptions& options,
                       const std::function<void(int)>& on_step) {
  const std::clock_t start = std::clock();
  FullOrderResult result;
  result.displacement.reserve(static_cast<std::size_t>(options.steps) * structure.dof_count());
  for (int step = 0; step < options.steps; ++step) {
    check_cancellation(
        fmt::format("step {} of {} of a full-order run; nothing of this run is kept", step, options.steps));
    result.steps.push_back(loading.advance(options.displacement * (step + 1) / options.steps));
    const auto displacement = loading.displacement();
    result.displacement.insert(result.displacement.end(), displacement.begin(), displacement.end());
    if (on_step) on_step(step);
  }
  result.cell_damage = loading.cell_damage();
  result.crack_length = crack_length(structure.mesh(), structure.elements(), result.cell_damage);
  result.cpu_seconds = 1.0 * (std::clock() - start) / CLOCKS_PER_SEC;
  return result;
}

}  // namespace

FullOrderResult FullOrderModel::run(const DamageParameters& parameters,
                                    const std::function<void(int)>& on_step) {
  parameters.validate();
  const auto& [structure, options, flexibility, ratios] = *implementation_;
  if (options.regularisation.kind == DamageRegularisation::gradient)
    return follow(GradientStepping(*structure, options, parameters), *structure, options, on_step);
  check_band(structure->mesh(), options.regularisation, ratios, parameters);
  const auto system =
      flexibility ? make_condensed_system(*structure, *flexibility) : make_uncondensed_system(*structure);
  return follow(LoadStepping(*structure, *system, options, parameters, ratios), *structure, options, on_step);
}

}  // namespace knothe::offline
