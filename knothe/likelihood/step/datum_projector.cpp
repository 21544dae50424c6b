#include "knothe/likelihood/step/datum_projector.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cassert>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {
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

DatumProjector::DatumProjector(std::shared_ptr<const model::ObservedModel> model, NoiseModel noise,
                               const Eigen::VectorXd& centre)
    : model_(std::move(model)), noise_(std::move(noise)) {
  const auto& functions = *model_->functions;
  const Eigen::Index n = model_->space.rows();
  const auto n_t = std::ssize(model_->time);
  assert(noise_.size() == n && centre.size() == functions.dimension());
  model::FunctionBatch batch;
  batch.resize(1, functions.dimension(), functions.count(), 0);
  functions.evaluate(centre.transpose(), 0, batch);
  central_ = batch.value.row(0);
  predicted_.resize(n, n_t);
  complete_.noise = noise_.measurement();
  for (Eigen::Index i = 0; i < n; ++i) complete_.kept.push_back(i);
  complete_.space = model_->space;
  complete_.weighted_space = noise_.measurement().apply(model_->space);
  complete_.gram = model_->space.transpose() * complete_.weighted_space;
  for (Eigen::Index t = 0; t < n_t; ++t)
    predicted_.col(t) = model_->lift.col(t) + model_->space * (model_->core[t] * central_);
  residual_.resize(n);
  weighted_.resize(n);
  in_space_.resize(model_->space.cols());
  if (NuisanceFilter::is_in(noise_)) nuisances_ = std::make_unique<NuisanceFilter>(model_, noise_);
}

void DatumProjector::set_noise_of(std::size_t step, GaussianNoise noise) {
  noise_ = noise_.with_step(step, std::move(noise));
  if (nuisances_) nuisances_->set_noise(noise_);
  recent_ = {};
}

void DatumProjector::restart() {
  if (nuisances_) nuisances_->restart();
}

void DatumProjector::find_measured(std::size_t step, const Eigen::Ref<const Eigen::VectorXd>& values) {
  const GaussianNoise& noise = noise_.at_step(step);
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
  find_measured(step, values);
  if (kept_.empty()) {
    form = StepForm::zero(central_.size());
    if (moved != nullptr) *moved = {};
  } else if (nuisances_) {
    const Eigen::VectorXd residual = residual_(kept_);
    Eigen::VectorXd predicted;
    if (noise_.scale_std() > 0) predicted = predicted_.col(time_index)(kept_);
    const Eigen::MatrixXd* lasting = noise_.lasting().factor(step);
    form = nuisances_->condition(group_of(step), model_->core[time_index], residual, predicted, lasting,
                                 noise_.step_error(step), moved);
  } else if (std::ssize(kept_) == values.size() && !has_own_noise(noise_, step)) {
    project_complete(time_index, form);
  } else {
    group_of(step).project(model_->core[time_index], residual_(kept_), 1, {}, form);
  }
  require_finite(form, values);
  form.used = std::ssize(kept_);
  form.missing = observation_count() - form.used;
  if (moved != nullptr) {
    moved->form.used = form.used;
    moved->form.missing = form.missing;
  }
}

void DatumProjector::project(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values,
                             const BiasCorrection& correction, StepForm& form) {
  assert(time_index < model_->time.size() && values.size() == observation_count() && !depends_on_order());
  residual_ = values - predicted_.col(time_index) - correction.mean;
  find_measured(step, values);
  form = StepForm::zero(central_.size());
  form.used = std::ssize(kept_);
  form.missing = observation_count() - form.used;
  if (kept_.empty()) return;
  // Divided by the scale S, the noise is R again. All columns that R⁻¹ is applied to, in one pass:
  // S⁻¹ [(OU), F, r].
  const GaussianNoise& noise = group_of(step).noise;
  const model::RowMatrix& rows = space_rows();
  const Eigen::MatrixXd* step_error = noise_.step_error(step);
  const Eigen::Index modes = rows.cols(), bias_columns = correction.factor.cols();
  const Eigen::Index factors = bias_columns + (step_error != nullptr ? step_error->cols() : 0);
  const Eigen::Index width = (modes + factors + 1 + 7) / 8 * 8;  // full lanes
  columns_.resize(form.used, width);
  const Eigen::VectorXd scale = correction.scale(kept_);
  for (Eigen::Index row = 0; row < form.used; ++row) {
    const Eigen::Index dof = kept_[row];
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
  // In the space modes and the factors, which are integrated out.
  StepForm wide{products.topLeftCorner(modes + factors, modes + factors),
                products.col(modes + factors).head(modes + factors),
                products(modes + factors, modes + factors)};
  wide.log_normaliser = form.used * k_log_2_pi + noise.log_determinant() + 2 * scale.array().log().sum();
  if (factors > 0) wide = without_standard_normals(wide, modes);
  const auto& core = model_->core[time_index];
  form.quadratic = core.transpose() * wide.quadratic * core;
  form.quadratic = 0.5 * (form.quadratic + form.quadratic.transpose().eval());
  form.linear = core.transpose() * wide.linear;
  form.constant = wide.constant;
  form.log_normaliser = wide.log_normaliser;
  require_finite(form, values);
}

/// (OU) of the dofs kept, a row for each.
const model::RowMatrix& DatumProjector::space_rows() {
  if (space_kept_ != kept_) {
    space_rows_ = model_->space(kept_, Eigen::all);
    space_kept_ = kept_;
  }
  return space_rows_;
}

void DatumProjector::project_complete(std::size_t time_index, StepForm& form) {
  noise_.measurement().apply(residual_, weighted_);
  in_space_.noalias() = complete_.weighted_space.transpose() * residual_;
  form.quadratic = complete_quadratic(time_index);
  form.linear.noalias() = model_->core[time_index].transpose() * in_space_;
  form.constant = residual_.dot(weighted_);
  form.log_normaliser = residual_.size() * k_log_2_pi + noise_.measurement().log_determinant();
}

/// Made when it is first asked for: a model may have a million times.
const Eigen::MatrixXd& DatumProjector::complete_quadratic(std::size_t time_index) {
  constexpr std::size_t k_kept = 1024;
  const auto found = quadratic_.find(time_index);
  if (found != quadratic_.end()) return found->second;
  if (quadratic_.size() >= k_kept) quadratic_.clear();
  const auto& core = model_->core[time_index];
  Eigen::MatrixXd& quadratic = quadratic_[time_index];
  quadratic = core.transpose() * complete_.gram * core;
  return quadratic = 0.5 * (quadratic + quadratic.transpose().eval());
}

const NoiseGroup& DatumProjector::group_of(std::size_t step) {
  const bool of_one_step = has_own_noise(noise_, step);
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

}  // namespace knothe::likelihood
