#include "knothe/assimilation/sequential_update.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <chrono>
#include <cmath>

#include "knothe/assimilation/composed_density.hpp"
#include "knothe/assimilation/grid_posterior.hpp"
#include "knothe/assimilation/maximum_a_posteriori.hpp"
#include "knothe/assimilation/prior_of_model.hpp"
#include "knothe/assimilation/tensor_quadrature.hpp"
#include "knothe/base/error.hpp"
#include "knothe/transport/trust.hpp"

namespace knothe::assimilation {
namespace {

using Clock = std::chrono::steady_clock;

double microseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::micro>(Clock::now() - start).count();
}

/// Below this effective sample size (fraction) weighted points give way to quadrature, where the parameters
/// are few enough: it costs less than the points that would be needed, and finds the modes that a map may
/// miss.
constexpr double k_quadrature_below = 0.98;

double effective_sample_size(const Eigen::VectorXd& log_weight) {
  const Eigen::ArrayXd weight = (log_weight.array() - log_weight.maxCoeff()).exp();
  return weight.sum() * weight.sum() / (static_cast<double>(weight.size()) * weight.square().sum());
}

/// The decision and, in `remark`, why: the tolerance missed, then what speaks against trust.
void judge(UpdateResult& r, const std::string& reason) {
  const transport::Trust trust =
      transport::judge_trust({r.variance_diagnostic, r.effective_sample_size, r.second_mode_found, ""});
  r.trusted = trust.trusted;
  r.remark = reason + (reason.empty() || trust.reason.empty() ? "" : "; ") + trust.reason;
}

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

/// The maps so far, composed, and the target of the next one.
struct SequentialUpdate::Composition {
  Composition(const reduction::ObservedModel& model, std::shared_ptr<const PriorTransform> transform,
              const Eigen::VectorXd& central)
      : map(transform->dimension()),
        density(CollapsedLogDensity(model.functions, std::move(transform), central)) {}

  transport::ComposedMap map;  ///< M_1 ∘ … ∘ M_i, Eq. 10
  ComposedStepDensity density;
  transport::MapBatch batch;
};

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
  if (options_.noise_level) {
    if (options_.form == UpdateOptions::Form::composed)
      throw UsageError(
          "composed maps take the data one by one, but an unknown noise level links them: use the collapsed "
          "form");
    target_.infer_noise_level(*options_.noise_level);
  }
  solver_.prepare(transform_->dimension());
  correction_.levels.assign(k_quantile_levels.begin(), k_quantile_levels.end());
  if (options_.form == UpdateOptions::Form::composed) {
    composition_ = std::make_unique<Composition>(*model, transform_, projector_.central_functions());
  }
  refuse_what_does_not_go_together();
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
  const auto start = Clock::now();
  const bool in_order = data_.empty() || data_.rbegin()->first < step;
  Datum datum;
  datum.time_index = time_index;
  datum.time = projector_.model().time[time_index];
  if (projector_.depends_on_order() || supervision_.learns()) datum.values = values;
  // Throws for data that cannot be; nothing has changed then.
  projector_.project(step, time_index, values, datum.form);
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
  for (auto& [step, datum] : data_) projector_.project(step, datum.time_index, datum.values, datum.form);
}

void SequentialUpdate::put(std::size_t step, std::size_t time_index, StepForm form, Eigen::VectorXd values) {
  Datum datum;
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
  // Composed maps need every step, and so does a correction, which follows from all steps before it; the
  // collapsed posterior only the last one, and the one before it for the increment of the evidence.
  return conclude(step, composition_ || supervision_.learns());
}

const UpdateResult& SequentialUpdate::follow(std::size_t step) {
  if (!followed_) begin_anew();
  return conclude(step, true);
}

const UpdateResult& SequentialUpdate::conclude(std::size_t step, bool every) {
  const auto last = data_.find(step);
  if (last == data_.end())
    throw UsageError(fmt::format("step {} is not assimilated: there is no posterior of it", step));
  if (summed_ && (*summed_ > step || previewed_)) rewind(step);
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
  set_target();
  if (options_.kind == UpdateOptions::Kind::grid) {
    by_grid();
  } else if (composition_) {
    by_composed_maps(step);
  } else {
    by_collapsed_map();
  }
  const auto start = Clock::now();
  result_.maximum_a_posteriori = maximum_a_posteriori(target_, *transform_, result_.mean);
  result_.elapsed_us.correction += microseconds_since(start);
  if (options_.noise_level) average_noise_level();
  result_.log_evidence_increment =
      result_.log_evidence - (here == data_.begin() ? 0.0 : *std::prev(here)->second.log_evidence);
  here->second.log_evidence = result_.log_evidence;
}

void SequentialUpdate::average_noise_level() {
  sampling::LogDensityBatch batch;
  batch.resize(posterior_.points.rows(), posterior_.points.cols(), 0);
  target_.evaluate_likelihood(posterior_.points, 0, batch);
  double mean = 0;
  for (Eigen::Index i = 0; i < batch.value.size(); ++i)
    mean += posterior_.weights[i] * target_.noise_level()->expected(batch.value[i]);
  result_.noise_level = mean;
}

void SequentialUpdate::by_grid() {
  const auto start = Clock::now();
  const auto p_of_z = [&](Eigen::Index k, double z) {
    return transform_->prior(k).from_standard_normal(z).value;
  };
  const GridPosterior grid = grid_posterior(target_, p_of_z);
  result_.mean = result_.map_mean = grid.mean;
  result_.covariance = result_.map_covariance = grid.covariance;
  result_.log_evidence = result_.log_evidence_lower_bound = grid.log_evidence;
  const Eigen::Index d = transform_->dimension();
  Eigen::MatrixXd quantiles(d, static_cast<Eigen::Index>(k_quantile_levels.size()));
  for (Eigen::Index k = 0; k < d; ++k) {
    for (Eigen::Index j = 0; j < quantiles.cols(); ++j)
      quantiles(k, j) = grid.quantile(k, k_quantile_levels[j]);
  }
  set_quantiles(quantiles);
  GridPoints points = grid_points(target_, grid);
  posterior_.points.resize(points.points.rows(), d);
  transform_->evaluate(points.points, 0, posterior_.points, no_derivatives_, no_derivatives_);
  posterior_.weights = std::move(points.weights);
  result_.trusted = result_.tolerance_reached = grid.resolved;
  if (!grid.resolved)
    result_.remark = "the posterior is too narrow for the grid: use method.kind = \"transport\"";
  result_.elapsed_us.map = microseconds_since(start);
}

void SequentialUpdate::by_collapsed_map() {
  const auto start = Clock::now();
  solver_.solve(target_, map_);
  result_.elapsed_us.map = microseconds_since(start);
  const auto correction_start = Clock::now();
  const double ess = effective_sample_size(map_.verification.log_weight);
  if (ess < k_quadrature_below && transform_->dimension() <= k_most_quadrature_parameters) {
    take(map_);
    result_.effective_sample_size = ess;
    result_.log_evidence_lower_bound = map_.map_log_evidence();
    integrate();
  } else {
    solver_.correct(target_, map_, correction_);
    take(map_);
    result_.effective_sample_size = correction_.ess;
    result_.log_evidence = correction_.log_evidence;
    result_.log_evidence_lower_bound = correction_.map_log_evidence;
    set_moments(correction_.points, correction_.weights);
    set_quantiles(correction_.quantiles);
    judge(result_, map_.reason);
  }
  result_.elapsed_us.correction = microseconds_since(correction_start);
}

void SequentialUpdate::by_composed_maps(std::size_t step) {
  const auto start = Clock::now();
  Composition& composition = *composition_;
  const Datum& datum = data_.at(step);
  composition.density.set(composition.map, datum.corrected_form ? *datum.corrected_form : datum.form);
  solver_.solve(composition.density, map_);
  composition.map.append(map_.pre_map);
  composition.map.append(map_.map);
  const bool last_reached = map_.tolerance_reached;
  const std::string last_reason = map_.reason;
  const int last_order = map_.order;

  // The composition as a whole is judged, and corrected, against the whole posterior.
  const auto correction_start = Clock::now();
  composition.batch.resize(map_.verification.reference.rows(), transform_->dimension(), 0);
  composition.map.evaluate(map_.verification.reference, 0, composition.batch);
  const PushedPoints pushed = push_forward(target_, map_.verification.reference, composition.batch);
  if (pushed.effective_sample_size < 0.9) {
    // Errors of a hundred maps add up: begin anew with one map of the whole posterior, which is at hand.
    by_collapsed_map();
    composition.map = transport::ComposedMap(transform_->dimension());
    composition.map.append(map_.pre_map);
    composition.map.append(map_.map);
    result_.remark +=
        fmt::format("{}the composition was begun anew: its effective sample size had come to {:.0f} %",
                    result_.remark.empty() ? "" : "; ", 100 * pushed.effective_sample_size);
    return;
  }
  result_.map_order = last_order;
  result_.tolerance_reached = last_reached;
  result_.second_mode_found = map_.second_mode_found;
  result_.variance_diagnostic = pushed.variance_diagnostic;
  result_.effective_sample_size = pushed.effective_sample_size;
  result_.log_evidence = pushed.log_evidence;
  result_.log_evidence_lower_bound = pushed.log_evidence_lower_bound;
  set_moments(composition.batch.value, pushed.weights);
  set_map_moments(posterior_.points);
  set_quantiles(weighted_quantiles(composition.batch.value, pushed.weights));
  judge(result_, last_reason);
  result_.elapsed_us.map = std::chrono::duration<double, std::micro>(correction_start - start).count();
  result_.elapsed_us.correction = microseconds_since(correction_start);
}

void SequentialUpdate::integrate() {
  const QuadraturePosterior quadrature = tensor_quadrature(target_);
  set_moments(quadrature.points, quadrature.weights);
  set_quantiles(quadrature.quantiles);
  result_.log_evidence = quadrature.log_evidence;
  judge(result_, map_.reason);
  result_.remark += fmt::format("; moments, quantiles and evidence are by quadrature at {} points",
                                quadrature.weights.size());
}

void SequentialUpdate::take(const transport::MapResult& map) {
  map_points_.resize(map.verification.points.rows(), transform_->dimension());
  transform_->evaluate(map.verification.points, 0, map_points_, no_derivatives_, no_derivatives_);
  set_map_moments(map_points_);
  result_.map_order = map.order;
  result_.variance_diagnostic = map.verified_diagnostic;
  result_.tolerance_reached = map.tolerance_reached;
  result_.second_mode_found = map.second_mode_found;
}

void SequentialUpdate::set_map_moments(const Eigen::MatrixXd& p) {
  result_.map_mean = p.colwise().mean();
  const Eigen::MatrixXd centred = p.rowwise() - result_.map_mean.transpose();
  result_.map_covariance.noalias() = centred.transpose() * centred / static_cast<double>(p.rows());
}

void SequentialUpdate::set_moments(const Eigen::MatrixXd& z, const Eigen::VectorXd& weights) {
  posterior_.points.resize(z.rows(), z.cols());
  transform_->evaluate(z, 0, posterior_.points, no_derivatives_, no_derivatives_);
  posterior_.weights = weights;
  const Eigen::MatrixXd& p = posterior_.points;
  result_.mean.noalias() = p.transpose() * weights;
  const Eigen::MatrixXd centred = p.rowwise() - result_.mean.transpose();
  const Eigen::MatrixXd covariance = centred.transpose() * weights.asDiagonal() * centred;
  result_.covariance = 0.5 * (covariance + covariance.transpose());  // symmetric to the bit
}

void SequentialUpdate::set_quantiles(const Eigen::MatrixXd& z_quantiles) {
  // p(z) is monotone, coordinate by coordinate: quantiles go through it.
  result_.quantiles.resize(z_quantiles.rows(), z_quantiles.cols());
  for (Eigen::Index k = 0; k < z_quantiles.rows(); ++k) {
    for (Eigen::Index j = 0; j < z_quantiles.cols(); ++j) {
      result_.quantiles(k, j) = transform_->prior(k).from_standard_normal(z_quantiles(k, j)).value;
    }
  }
}

}  // namespace knothe::assimilation
