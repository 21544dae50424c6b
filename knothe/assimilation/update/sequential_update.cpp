#include "knothe/assimilation/update/sequential_update.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>

#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/assimilation/update/composed_density.hpp"
#include "knothe/assimilation/update/maximum_a_posteriori.hpp"
#include "knothe/assimilation/update/prior_of_model.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"

namespace knothe::assimilation {
namespace {

/// A datum comes every few milliseconds: where the standard way does not reach the tolerance, the importance
/// correction answers for it, not a search among other parametrisations.
transport::MapSolverOptions online(const UpdateOptions& options) {
  transport::MapSolverOptions map = options.map;
  map.fallback = false;
  map.search_modes = options.search_modes;
  // A mixture over the sizes of a discrepancy has tails that no order of a map follows: a low one, and the
  // correction or quadrature.
  const bool mixture = (options.learn_bias || options.bias_correction != BiasCorrectionMode::off) &&
                       options.bias.way == BiasOptions::Way::joint;
  if (mixture) {
    map.max_order = std::min(map.max_order, 2);
    map.long_first_variable = false;
  }
  return map;
}

}  // namespace

SequentialUpdate::SequentialUpdate(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
                                   std::vector<Prior> priors, UpdateOptions options)
    : options_(std::move(options)),
      transform_(truncated_to_box(*model, std::move(priors))),
      projector_(model, std::move(noise), medians(*transform_)),
      target_(model->functions, transform_, projector_.central_functions()),
      solver_(online(options_)),
      supervision_(model, projector_.noise(), transform_, options_.bias_correction,
                   options_.learn_bias || options_.bias_correction != BiasCorrectionMode::off, options_.bias,
                   options_.monitor),
      sum_(StepForm::zero(model->functions->count())) {
  require_compatible(features_of(options_) | features_of(projector_.noise()));
  if (options_.noise_level) {
    target_.infer_noise_level(*options_.noise_level);
  }
  solver_.prepare(transform_->dimension());
  correction_.levels.assign(k_quantile_levels.begin(), k_quantile_levels.end());
  if (options_.form == UpdateOptions::Form::composed) {
    composition_ = std::make_unique<MapComposition>(*model, transform_, projector_.central_functions());
  }
}

SequentialUpdate::~SequentialUpdate() = default;

Eigen::VectorXd SequentialUpdate::centre() const {
  return medians(*transform_);
}

std::vector<Prior> SequentialUpdate::priors() const {
  std::vector<Prior> priors;
  for (Eigen::Index k = 0; k < transform_->dimension(); ++k) priors.push_back(transform_->prior(k));
  return priors;
}

std::vector<std::size_t> SequentialUpdate::steps() const {
  std::vector<std::size_t> steps;
  for (const auto& [step, datum] : data_) steps.push_back(step);
  return steps;
}

const UpdateResult& SequentialUpdate::update(std::size_t step, std::size_t time_index,
                                             const Eigen::Ref<const Eigen::VectorXd>& values) {
  if (data_.contains(step)) {
    throw UsageError(fmt::format("step {} is assimilated already: take it out before putting it back", step));
  }
  const auto start = monotonic_now();
  const bool in_order = data_.empty() || data_.rbegin()->first < step;
  Datum datum;
  datum.time_index = time_index;
  datum.time = projector_.model().time[time_index];
  if (projector_.depends_on_order() || supervision_.learns()) datum.values = values;
  // Throws for data that cannot be; nothing has changed then.
  project(step, values, datum);
  data_[step] = std::move(datum);
  forget_from(step);
  if (!in_order) project_again();
  const double projection = microseconds_since(start);
  conclude(data_.rbegin()->first);
  result_.elapsed_us.projection += projection;
  return result_;
}

const UpdateResult& SequentialUpdate::remove(std::size_t step) {
  if (data_.erase(step) == 0)
    throw UsageError(fmt::format("step {} is not assimilated: there is nothing to take out", step));
  forget_from(step);
  project_again();
  if (data_.empty()) {
    begin_anew();
    return result_;
  }
  return conclude(data_.rbegin()->first);
}

/// Where steps share an error the form of each depends on those before it: all are made again, in order.
void SequentialUpdate::project_again() {
  if (!projector_.depends_on_order()) return;
  projector_.restart();
  for (auto& [step, datum] : data_) project(step, datum.values, datum);
}

void SequentialUpdate::project(std::size_t step, const Eigen::Ref<const Eigen::VectorXd>& values,
                               Datum& datum) {
  projector_.project(step, datum.time_index, values, datum.form,
                     wants_moved_forms() ? &datum.moved.emplace() : nullptr);
}

bool SequentialUpdate::wants_moved_forms() const {
  return projector_.depends_on_order() && supervision_.learns() && supervision_.is_joint();
}

void SequentialUpdate::put(std::size_t step, std::size_t time_index, StepForm form, Eigen::VectorXd values,
                           std::optional<MovedForm> moved) {
  Datum datum;
  datum.moved = std::move(moved);
  datum.values = std::move(values);
  datum.form = std::move(form);
  datum.time_index = time_index;
  datum.time = projector_.model().time[time_index];
  data_[step] = std::move(datum);
  forget_from(step);
}

/// What was computed from this step on holds no longer.
void SequentialUpdate::forget_from(std::size_t step) {
  for (auto it = data_.lower_bound(step); it != data_.end(); ++it) it->second.log_evidence.reset();
  if (summed_ && *summed_ >= step) rewind(step);
}

void SequentialUpdate::begin_anew() {
  result_ = {};
  posterior_ = {};
  changes_.clear();
  aged_.clear();
  if (composition_) restart_composition();
  clear_sums();
  supervision_.restart();
  summed_.reset();
  followed_ = true;
  previewed_ = false;
  redone_at_.reset();
}

void SequentialUpdate::restart_composition() {
  composition_->map = transport::ComposedMap(transform_->dimension());
}

const UpdateResult& SequentialUpdate::conclude(std::size_t step) {
  // Composed maps need every step, and so do a correction and a structure that changes, which follow from all
  // steps before; the collapsed posterior only the last one, and the one before it for the increment of the
  // evidence.
  return conclude(step, composition_ || supervision_.learns() || may_change());
}

const UpdateResult& SequentialUpdate::follow(std::size_t step) {
  if (!followed_) begin_anew();
  return conclude(step, true);
}

const UpdateResult& SequentialUpdate::conclude(std::size_t step, bool every) {
  const auto last = data_.find(step);
  if (last == data_.end())
    throw UsageError(fmt::format("step {} is not assimilated: there is no posterior of it", step));
  // Also where `step` is summed up, but only on the way back from a later one.
  if (summed_ && (*summed_ > step || previewed_ || posterior_.weights.size() == 0)) rewind(step);
  // In the order of the steps, so that the sums are those of data that came in that order, to the bit.
  auto it = summed_ ? data_.upper_bound(*summed_) : data_.begin();
  for (const auto end = std::next(last); it != end; ++it) {
    const bool before_last = std::next(it) == last && !it->second.log_evidence;
    if (!every && it != last && !before_last) {
      add_to_sums(it->second);
      summed_ = it->first;
      supervision_.lose_posterior();
      followed_ = false;
      continue;
    }
    try {
      assimilate(it->first);
    } catch (...) {
      begin_anew();  // a posterior that is half one step's, half another's is nobody's
      throw;
    }
  }
  return result_;
}

void SequentialUpdate::recompute(std::size_t step) {
  const auto here = data_.find(step);
  const Datum& datum = here->second;
  result_ = {};
  result_.step = step;
  result_.time = datum.time;
  result_.used = datum.form.used;
  result_.missing = datum.form.missing;
  shares_.reset();
  set_target();
  if (options_.kind == Method::grid) {
    by_grid();
  } else if (composition_) {
    by_composed_maps(step);
  } else {
    by_collapsed_map();
  }
  const auto start = monotonic_now();
  result_.maximum_a_posteriori = maximum_a_posteriori(target_, *transform_, result_.mean);
  result_.elapsed_us.correction += microseconds_since(start);
  if (options_.noise_level) average_noise_level();
  result_.log_evidence += forgotten_;
  result_.log_evidence_lower_bound += forgotten_;
  result_.log_evidence_increment =
      result_.log_evidence - (here == data_.begin() ? 0.0 : *std::prev(here)->second.log_evidence);
  here->second.log_evidence = result_.log_evidence;
}

}  // namespace knothe::assimilation
