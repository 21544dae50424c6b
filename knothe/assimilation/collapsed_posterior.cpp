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

StepForm StepForm::zero(Eigen::Index r) {
  StepForm form;
  form.quadratic.setZero(r, r);
  form.linear.setZero(r);
  return form;
}

void StepForm::add(const StepForm& other) {
  quadratic += other.quadratic;
  linear += other.linear;
  constant += other.constant;
  log_normaliser += other.log_normaliser;
  used += other.used;
  missing += other.missing;
}

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
  weighted_space_ = noise_.apply(model_->space);
  const Eigen::MatrixXd gram = model_->space.transpose() * weighted_space_;
  quadratic_.resize(n_t);
  for (Eigen::Index t = 0; t < n_t; ++t) {
    const auto& core = model_->core[t];
    predicted_.col(t) = model_->lift.col(t) + model_->space * (core * central_);
    quadratic_[t] = core.transpose() * gram * core;
    quadratic_[t] = 0.5 * (quadratic_[t] + quadratic_[t].transpose().eval());
  }
  residual_.resize(n);
  weighted_.resize(n);
  in_space_.resize(model_->space.cols());
}

void DatumProjector::project(std::size_t time_index, const Eigen::Ref<const Eigen::VectorXd>& values,
                             StepForm& form) {
  assert(time_index < model_->time.size() && values.size() == observation_count());
  residual_ = values - predicted_.col(time_index);
  std::vector<Eigen::Index> kept;
  if (residual_.allFinite()) {
    project_complete(time_index, form);
    require_finite(form, values);
    return;
  }
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (std::isinf(values[i])) throw DataError("a measured value is infinite: give NaN for a missing value");
    if (!std::isnan(values[i])) kept.push_back(i);
  }
  project_incomplete(time_index, kept, form);
  require_finite(form, values);
}

void DatumProjector::project_complete(std::size_t time_index, StepForm& form) {
  noise_.apply(residual_, weighted_);
  in_space_.noalias() = weighted_space_.transpose() * residual_;
  form.quadratic = quadratic_[time_index];
  form.linear.noalias() = model_->core[time_index].transpose() * in_space_;
  form.constant = residual_.dot(weighted_);
  form.log_normaliser = static_cast<double>(residual_.size()) * k_log_2_pi + noise_.log_determinant();
  form.used = residual_.size();
  form.missing = 0;
}

void DatumProjector::project_incomplete(std::size_t time_index, const std::vector<Eigen::Index>& kept,
                                        StepForm& form) {
  const Eigen::Index r = central_.size();
  form = StepForm::zero(r);
  form.used = static_cast<Eigen::Index>(kept.size());
  form.missing = observation_count() - form.used;
  if (kept.empty()) return;
  const NoiseModel noise = noise_.restricted(kept);
  const Eigen::MatrixXd space = model_->space(kept, Eigen::all);
  const Eigen::VectorXd residual = residual_(kept);
  const Eigen::MatrixXd weighted_space = noise.apply(space);
  const auto& core = model_->core[time_index];
  form.quadratic = core.transpose() * (space.transpose() * weighted_space) * core;
  form.quadratic = 0.5 * (form.quadratic + form.quadratic.transpose().eval());
  form.linear = core.transpose() * (weighted_space.transpose() * residual);
  form.constant = residual.dot(noise.apply(residual).col(0));
  form.log_normaliser = static_cast<double>(form.used) * k_log_2_pi + noise.log_determinant();
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
