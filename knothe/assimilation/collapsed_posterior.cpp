#include "knothe/assimilation/collapsed_posterior.hpp"

#include <fmt/format.h>

#include <cassert>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

const double k_log_2_pi = std::log(2 * std::numbers::pi);

/// Refuses a datum whose misfit overflows: a value in the wrong unit, or a noise far too small.
void require_finite(const StepForm& form, const Eigen::Ref<const Eigen::VectorXd>& values) {
  if (std::isfinite(form.constant) && form.linear.allFinite()) return;
  Eigen::Index largest = 0;
  double most = -1;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (std::abs(values[i]) > most) most = std::abs(values[largest = i]);
  }
  throw DataError(fmt::format(
      "the misfit of a datum overflows: the largest measured value is {} (observation {}); values and "
      "noise are in metres",
      values[largest], largest));
}

}  // namespace

DatumProjector::DatumProjector(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
                               const Eigen::VectorXd& centre)
    : model_(std::move(model)), noise_(std::move(noise)) {
  const auto& functions = *model_->functions;
  const Eigen::Index n = model_->space.rows();
  const auto n_t = static_cast<Eigen::Index>(model_->time.size());
  assert(noise_.size() == n && centre.size() == functions.dimension());
  reduction::FunctionBatch batch;
  batch.resize(1, functions.dimension(), functions.count(), 0);
  functions.evaluate(centre.transpose(), 0, batch);
  central_ = batch.value.row(0);
  predicted_.resize(n, n_t);
  complete_.noise = noise_;
  for (Eigen::Index i = 0; i < n; ++i) complete_.kept.push_back(i);
  complete_.weighted_space = noise_.apply(model_->space);
  complete_.gram = model_->space.transpose() * complete_.weighted_space;
  quadratic_.resize(n_t);
  for (Eigen::Index t = 0; t < n_t; ++t) {
    const auto& core = model_->core[t];
    predicted_.col(t) = model_->lift.col(t) + model_->space * (core * central_);
    quadratic_[t] = core.transpose() * complete_.gram * core;
    quadratic_[t] = 0.5 * (quadratic_[t] + quadratic_[t].transpose().eval());
  }
  residual_.resize(n);
  weighted_.resize(n);
  in_space_.resize(model_->space.cols());
  if (noise_.is_independent() && (noise_.shared_reference() > 0 || noise_.offset_std() > 0)) {
    // Both are errors of a sensor that stay: their variances add up.
    const double k = noise_.shared_reference(), offset = noise_.offset_std();
    Eigen::ArrayXd variance = Eigen::ArrayXd::Constant(n, offset * offset);
    if (k > 0) variance += ((k + 1) * noise_.inverse_variance()).array().inverse();
    constant_ = std::make_unique<ConstantSensorError>(variance.inverse().matrix(), central_.size());
  } else {
    if (noise_.shared_reference() > 0) {
      shared_ = std::make_unique<SharedReferenceError>(noise_, central_.size());
    }
  }
}

void DatumProjector::set_noise_of(std::size_t step, NoiseModel noise) {
  noise_ = noise_.with_step(step, std::move(noise));
  if (shared_) shared_->set_noise(noise_);
  recent_ = {};
}

void DatumProjector::restart() {
  if (shared_) shared_->restart();
  if (constant_) constant_->restart();
}

void DatumProjector::project(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values, StepForm& form) {
  assert(time_index < model_->time.size() && values.size() == observation_count());
  residual_ = values - predicted_.col(time_index);
  const NoiseModel& noise = noise_.at_step(step);
  kept_.clear();
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (std::isinf(values[i])) throw DataError("a measured value is infinite: give NaN for a missing value");
    if (!std::isnan(values[i]) && noise.is_measured(i)) kept_.push_back(i);
  }
  if (kept_.empty()) {
    form = StepForm::zero(central_.size());
  } else if (constant_) {
    project_constant(step, time_index, form);
    require_finite(form, values);
  } else if (shared_) {
    const NoiseGroup& group = group_of(step);
    const Eigen::VectorXd residual = residual_(kept_);
    form = shared_->condition(group, model_->core[time_index], residual);
    require_finite(form, values);
    shared_->take(group, model_->core[time_index], residual);
  } else {
    if (static_cast<Eigen::Index>(kept_.size()) == values.size() && !noise_.has_step(step)) {
      project_complete(time_index, form);
    } else {
      project_incomplete(step, time_index, form);
    }
    require_finite(form, values);
  }
  form.used = static_cast<Eigen::Index>(kept_.size());
  form.missing = observation_count() - form.used;
}

void DatumProjector::project_complete(std::size_t time_index, StepForm& form) {
  noise_.apply(residual_, weighted_);
  in_space_.noalias() = complete_.weighted_space.transpose() * residual_;
  form.quadratic = quadratic_[time_index];
  form.linear.noalias() = model_->core[time_index].transpose() * in_space_;
  form.constant = residual_.dot(weighted_);
  form.log_normaliser = static_cast<double>(residual_.size()) * k_log_2_pi + noise_.log_determinant();
}

void DatumProjector::project_incomplete(std::size_t step, std::size_t time_index, StepForm& form) {
  group_of(step).project(model_->core[time_index], residual_(kept_), 1, form);
}

void DatumProjector::project_constant(std::size_t step, std::size_t time_index, StepForm& form) {
  const double k = noise_.shared_reference(), own_share = k > 0 ? (k + 1) / k : 1;
  Eigen::VectorXd own = Eigen::VectorXd::Zero(observation_count());
  for (const Eigen::Index i : kept_) own[i] = own_share * noise_.at_step(step).inverse_variance()[i];
  const Eigen::MatrixXd design = model_->space * model_->core[time_index];
  form = constant_->condition(own, design, residual_);
  if (std::isfinite(form.constant)) constant_->take(own, design, residual_);
}

const NoiseGroup& DatumProjector::group_of(std::size_t step) {
  const bool of_one_step = noise_.has_step(step);
  if (!of_one_step && kept_.size() == complete_.kept.size()) return complete_;
  if (recent_.of_one_step == of_one_step && recent_.kept == kept_ && (!of_one_step || recent_.step == step))
    return recent_;
  recent_ = {};
  recent_.of_one_step = of_one_step;
  recent_.step = of_one_step ? step : 0;
  recent_.kept = kept_;
  recent_.noise = noise_.at_step(step).restricted(kept_);
  recent_.space = model_->space(kept_, Eigen::all);
  recent_.weighted_space = recent_.noise.apply(recent_.space);
  recent_.gram = recent_.space.transpose() * recent_.weighted_space;
  return recent_;
}

CollapsedLogDensity::CollapsedLogDensity(std::shared_ptr<const reduction::ParameterFunctions> functions,
                                         std::shared_ptr<const PriorTransform> transform,
                                         Eigen::VectorXd central_functions)
    : functions_(std::move(functions)),
      transform_(std::move(transform)),
      central_(std::move(central_functions)),
      magnitude_(functions_->magnitude(central_)),
      likelihood_(functions_->make_quadratic_form()) {
  assert(functions_->dimension() == transform_->dimension() && functions_->count() == central_.size());
  set_form(StepForm::zero(central_.size()));
}

void CollapsedLogDensity::set_form(const StepForm& form) {
  factor_.compute(form.quadratic, form.linear, magnitude_);
  // −2 log L = |Lᵀv − y|² − 2 (h − L y)·v + constants, v = w − w₀.
  combination_ = factor_.lower().transpose();
  shift_ = -factor_.solution();
  shift_.noalias() -= combination_ * central_;
  const double constant = -0.5 * (form.constant + form.log_normaliser) +
                          0.5 * factor_.solution().squaredNorm() - factor_.remainder().dot(central_);
  likelihood_->set(combination_, shift_, factor_.remainder(), constant);
  if (noise_level_) noise_level_->set(form);
}

CollapsedLogDensity::Workspace& CollapsedLogDensity::workspace(Eigen::Index n) {
  const auto [it, is_new] = workspaces_.try_emplace(n);
  Workspace& w = it->second;
  if (is_new) {
    const Eigen::Index d = dimension();
    w.p.resize(n, d);
    w.first.resize(n, d);
    w.second.resize(n, d);
  }
  return w;
}

void CollapsedLogDensity::evaluate_likelihood(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                                              sampling::LogDensityBatch& out) {
  likelihood_->evaluate(p, derivatives, out.value, out.gradient, out.hessian);
  if (noise_level_) noise_level_->marginalise(derivatives, out);
}

void CollapsedLogDensity::evaluate_standardised_likelihood(const Eigen::Ref<const Eigen::MatrixXd>& z,
                                                           int derivatives, sampling::LogDensityBatch& out) {
  const Eigen::Index d = dimension();
  Workspace& w = workspace(z.rows());
  transform_->evaluate(z, derivatives, w.p, w.first, w.second);
  evaluate_likelihood(w.p, derivatives, out);
  if (derivatives >= 2) {
    for (Eigen::Index a = 0; a < d; ++a) {
      for (Eigen::Index b = 0; b <= a; ++b) {
        auto entry = out.hessian.col(sampling::packed_index(a, b)).array();
        entry *= w.first.col(a).array() * w.first.col(b).array();
        if (a == b) entry += out.gradient.col(a).array() * w.second.col(a).array();
      }
    }
  }
  if (derivatives >= 1) out.gradient.array() *= w.first.array();
}

void CollapsedLogDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                                   sampling::LogDensityBatch& out) {
  evaluate_standardised_likelihood(z, derivatives, out);
  add_standard_normal(z, derivatives, out);
}

void add_standard_normal(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                         sampling::LogDensityBatch& out) {
  const Eigen::Index d = z.cols();
  out.value.array() -= 0.5 * static_cast<double>(d) * k_log_2_pi;
  for (Eigen::Index a = 0; a < d; ++a) {
    out.value.array() -= 0.5 * z.col(a).array().square();
    if (derivatives >= 2) out.hessian.col(sampling::packed_index(a, a)).array() -= 1;
  }
  if (derivatives >= 1) out.gradient -= z;
}

}  // namespace knothe::assimilation
