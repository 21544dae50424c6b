#include "knothe/assimilation/update/datum_projector.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
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
  const Eigen::Index unknowns = central_.size() + (noise_.scale_std() > 0 ? 1 : 0);
  joint_ = StepForm::zero(unknowns);
  if (noise_.scale_std() > 0 &&
      (noise_.has_step_errors() || noise_.offset_std() > 0 || noise_.scalar_count() > 0 ||
       (noise_.is_independent() && noise_.shared_reference() > 0))) {
    throw UsageError(
        "a scale that is not known exactly (relative_scale_std, dic.scale_std) is for displacements from "
        "pictures: it does not go together with offsets of sensors, forces and gauges, or a clock's std");
  }
  residual_.resize(n);
  weighted_.resize(n);
  in_space_.resize(model_->space.cols());
  if (noise_.has_step_errors() && (noise_.shared_reference() > 0 || noise_.offset_std() > 0)) {
    throw UsageError(
        "a clock with an error of its own (its std) does not go together with noise that steps share "
        "(shared_reference, method.offset_std): give the clock no std, or the noise nothing shared");
  }
  if (noise_.is_independent() && (noise_.shared_reference() > 0 || noise_.offset_std() > 0)) {
    // Both are errors of a sensor that stay: their variances add up.
    const double k = noise_.shared_reference(), offset = noise_.offset_std();
    Eigen::ArrayXd variance = Eigen::ArrayXd::Constant(n, offset * offset);
    if (k > 0) variance += ((k + 1) * noise_.inverse_variance()).array().inverse();
    variance.tail(noise_.scalar_count()) = 0;  // these have no such error: infinitely well known
    constant_ = std::make_unique<ConstantSensorError>(variance.inverse().matrix(), central_.size());
  } else {
    if (noise_.shared_reference() > 0) {
      shared_ = std::make_unique<SharedReferenceError>(noise_, unknowns);
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
  joint_ = StepForm::zero(joint_.linear.size());
}

void DatumProjector::take_measured(std::size_t step, const Eigen::Ref<const Eigen::VectorXd>& values) {
  const NoiseModel& noise = noise_.at_step(step);
  kept_.clear();
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (std::isinf(values[i])) throw DataError("a measured value is infinite: give NaN for a missing value");
    if (!std::isnan(values[i]) && noise.is_measured(i)) kept_.push_back(i);
  }
}

void DatumProjector::project(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values, StepForm& form,
                             MovedForm* moved) {
  assert(time_index < model_->time.size() && values.size() == observation_count());
  residual_ = values - predicted_.col(time_index);
  take_measured(step, values);
  if (kept_.empty()) {
    form = StepForm::zero(central_.size());
    if (moved != nullptr) *moved = {};
  } else if (noise_.scale_std() > 0) {
    assert(moved == nullptr);
    project_scaled(step, time_index, values, form);
  } else if (constant_) {
    project_constant(step, time_index, form, moved);
    require_finite(form, values);
  } else if (shared_) {
    const NoiseGroup& group = group_of(step);
    const Eigen::VectorXd residual = residual_(kept_);
    form = shared_->condition(group, model_->core[time_index], residual);
    require_finite(form, values);
    if (moved != nullptr) *moved = shared_->condition_moved(group, model_->core[time_index], residual);
    shared_->take(group, model_->core[time_index], residual);
  } else {
    if (static_cast<Eigen::Index>(kept_.size()) == values.size() && !noise_.has_step(step)) {
      project_complete(time_index, form);
    } else {
      project_incomplete(step, time_index, form);
    }
    if (const Eigen::MatrixXd* factor = noise_.step_error(step))
      take_step_error(group_of(step), (*factor)(kept_, Eigen::all), model_->core[time_index], form);
    require_finite(form, values);
  }
  form.used = static_cast<Eigen::Index>(kept_.size());
  form.missing = observation_count() - form.used;
  if (moved != nullptr) {
    moved->form.used = form.used;
    moved->form.missing = form.missing;
  }
}

/// (R + F Fᵀ)⁻¹ = R⁻¹ − R⁻¹F (I + FᵀR⁻¹F)⁻¹ FᵀR⁻¹, Woodbury, on the form made with R; det(R + F Fᵀ) = det R
/// det(I + FᵀR⁻¹F).
void DatumProjector::take_step_error(const NoiseGroup& group, const Eigen::MatrixXd& factor,
                                     const Eigen::MatrixXd& core, StepForm& form) {
  const Eigen::MatrixXd weighted = group.noise.apply(factor);
  Eigen::MatrixXd inner = factor.transpose() * weighted;
  inner.diagonal().array() += 1;
  const Eigen::LLT<Eigen::MatrixXd> cholesky(inner);
  const Eigen::MatrixXd in_factor =
      cholesky.matrixL().solve((group.weighted_space.transpose() * factor).transpose() * core);
  const Eigen::VectorXd of_residual = cholesky.matrixL().solve(weighted.transpose() * residual_(kept_));
  form.quadratic.noalias() -= in_factor.transpose() * in_factor;
  form.quadratic = 0.5 * (form.quadratic + form.quadratic.transpose().eval());
  form.linear.noalias() -= in_factor.transpose() * of_residual;
  form.constant -= of_residual.squaredNorm();
  form.log_normaliser += 2 * cholesky.matrixLLT().diagonal().array().log().sum();
}

void DatumProjector::project(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values,
                             const BiasCorrection& correction, StepForm& form) {
  assert(time_index < model_->time.size() && values.size() == observation_count() && !depends_on_order());
  residual_ = values - predicted_.col(time_index) - correction.mean;
  take_measured(step, values);
  form = StepForm::zero(central_.size());
  form.used = static_cast<Eigen::Index>(kept_.size());
  form.missing = observation_count() - form.used;
  if (kept_.empty()) return;
  // Divided by the scale S, the noise is R again. All columns that R⁻¹ is applied to, in one pass:
  // S⁻¹ [(OU), F, r].
  const NoiseModel& noise = group_of(step).noise;
  const reduction::RowMatrix& rows = space_rows();
  const Eigen::MatrixXd* step_error = noise_.step_error(step);
  const Eigen::Index modes = rows.cols(), bias_columns = correction.factor.cols();
  const Eigen::Index factors = bias_columns + (step_error != nullptr ? step_error->cols() : 0);
  const Eigen::Index width = (modes + factors + 1 + 7) / 8 * 8;  // full lanes
  columns_.resize(form.used, width);
  const Eigen::VectorXd scale = correction.scale(kept_);
  for (Eigen::Index row = 0; row < form.used; ++row) {
    const Eigen::Index dof = kept_[static_cast<std::size_t>(row)];
    const double down = 1 / scale[row];
    auto out = columns_.row(row);
    out.head(modes) = down * rows.row(row);
    out.segment(modes, bias_columns) = down * correction.factor.row(dof);
    if (step_error != nullptr)
      out.segment(modes + bias_columns, step_error->cols()) = down * step_error->row(dof);
    out[modes + factors] = down * residual_[dof];
    out.tail(width - modes - factors - 1).setZero();
  }
  noise.apply(columns_, weighted_columns_);
  Eigen::MatrixXd products = columns_.transpose() * weighted_columns_;
  products = 0.5 * (products + products.transpose().eval());
  Eigen::MatrixXd gram = products.topLeftCorner(modes, modes);
  Eigen::VectorXd in_space = products.col(modes + factors).head(modes);
  form.constant = products(modes + factors, modes + factors);
  form.log_normaliser =
      static_cast<double>(form.used) * k_log_2_pi + noise.log_determinant() + 2 * scale.array().log().sum();
  if (factors > 0) {
    // Woodbury, as in take_step_error.
    Eigen::MatrixXd inner = products.block(modes, modes, factors, factors);
    inner.diagonal().array() += 1;
    const Eigen::MatrixXd lower = Eigen::LLT<Eigen::MatrixXd>(inner).matrixL();
    Eigen::MatrixXd in_factor = products.block(modes, 0, factors, modes);
    Eigen::VectorXd of_residual = products.col(modes + factors).segment(modes, factors);
    lower.triangularView<Eigen::Lower>().solveInPlace(in_factor);
    lower.triangularView<Eigen::Lower>().solveInPlace(of_residual);
    gram.noalias() -= in_factor.transpose() * in_factor;
    in_space.noalias() -= in_factor.transpose() * of_residual;
    form.constant -= of_residual.squaredNorm();
    form.log_normaliser += 2 * lower.diagonal().array().log().sum();
  }
  const auto& core = model_->core[time_index];
  form.quadratic = core.transpose() * gram * core;
  form.quadratic = 0.5 * (form.quadratic + form.quadratic.transpose().eval());
  form.linear = core.transpose() * in_space;
  require_finite(form, values);
}

/// (OU) of the dofs kept, a row for each.
const reduction::RowMatrix& DatumProjector::space_rows() {
  if (space_kept_ != kept_) {
    space_rows_ = model_->space(kept_, Eigen::all);
    space_kept_ = kept_;
  }
  return space_rows_;
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

void DatumProjector::project_constant(std::size_t step, std::size_t time_index, StepForm& form,
                                      MovedForm* moved) {
  const double k = noise_.shared_reference(), own_share = k > 0 ? (k + 1) / k : 1;
  Eigen::VectorXd own = Eigen::VectorXd::Zero(observation_count());
  for (const Eigen::Index i : kept_) own[i] = own_share * noise_.at_step(step).inverse_variance()[i];
  const Eigen::MatrixXd design = model_->space * model_->core[time_index];
  form = constant_->condition(own, design, residual_);
  if (moved != nullptr)
    *moved = constant_->condition_moved(own, model_->space, model_->core[time_index], residual_);
  if (std::isfinite(form.constant)) constant_->take(own, design, residual_);
}

/// A measured displacement is too large by 1 + ε, all of them by the same: the joint form of v and ε, which
/// is linearised about the model's prediction y₀ at the centre (about the measured values, their noise would
/// bias it): d − y₀ = (OU) C v − ε y₀ + noise with the sign of ε turned.
void DatumProjector::project_scaled(std::size_t step, std::size_t time_index,
                                    const Eigen::Ref<const Eigen::VectorXd>& values, StepForm& form) {
  const NoiseGroup& group = group_of(step);
  const auto& core = model_->core[time_index];
  const Eigen::VectorXd residual = residual_(kept_), extra = predicted_.col(time_index)(kept_);
  StepForm joint;
  if (shared_) {
    joint = shared_->condition(group, core, residual, &extra);
  } else {
    group.project(core, residual, 1, joint, &extra);
  }
  require_finite(joint, values);
  if (shared_) shared_->take(group, core, residual, &extra);
  form = without_scale(joint_);
  joint_.add(joint);
  StepForm after = without_scale(joint_);
  after.subtract(form);
  form = std::move(after);
}

/// ε integrated out: −2 log L is quadratic in it too, with 1/s² of its prior.
StepForm DatumProjector::without_scale(const StepForm& joint) const {
  const Eigen::Index r = central_.size();
  const double prior = 1 / (noise_.scale_std() * noise_.scale_std()), a = joint.quadratic(r, r) + prior;
  const Eigen::VectorXd coupling = joint.quadratic.col(r).head(r);
  StepForm form;
  form.quadratic = joint.quadratic.topLeftCorner(r, r) - coupling * coupling.transpose() / a;
  form.linear = joint.linear.head(r) - coupling * (joint.linear[r] / a);
  form.constant = joint.constant - joint.linear[r] * joint.linear[r] / a;
  form.log_normaliser = joint.log_normaliser + std::log(a / prior);
  return form;
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

}  // namespace knothe::assimilation
