#include "knothe/assimilation/update/robust_update.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/assimilation/select/data_selection.hpp"
#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {
namespace {

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

}  // namespace

RobustUpdate::RobustUpdate(std::shared_ptr<const model::ObservedModel> model, likelihood::NoiseModel noise,
                           std::vector<posterior::Prior> priors, UpdateOptions options,
                           likelihood::RobustOptions robust)
    : model_(model),
      noise_(noise),
      robust_(robust),
      watch_(noise),
      noise_std_(noise.measurement().standard_deviations()) {
  require_compatible(features_of(noise_) | features_of(robust_.gate, robust_.degrees_of_freedom));
  if (robust_.degrees_of_freedom > 0) {
    student_.emplace(model, noise, std::move(priors), std::move(options), robust_.degrees_of_freedom);
  } else {
    gaussian_.emplace(model, noise, std::move(priors), std::move(options));
  }
  prior_.points = prior_points(student_ ? student_->priors() : gaussian_->transform().priors(), 512);
  prior_.weights = Eigen::VectorXd::Constant(512, 1.0 / 512);
}

/// What the data before say of a datum: of the model, and of the errors that it has beside its own noise. An
/// offset of each sensor counts as not known yet, which makes the gate wider, never narrower.
RobustUpdate::Prediction RobustUpdate::predict(std::size_t step, std::size_t time_index) const {
  const bool knows = last_ && (last_->first == step || changes().power_before(step) > 0);
  const posterior::Posterior& before = knows ? posterior() : prior_;
  const auto& functions = *model_->functions;
  model::FunctionBatch batch;
  batch.resize(before.points.rows(), functions.dimension(), functions.count(), 0);
  functions.evaluate(before.points, 0, batch);
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  numerics::mean_and_covariance(batch.value, before.weights, mean, covariance);
  const auto& core = model_->core[time_index];
  const Eigen::MatrixXd inner = core * covariance * core.transpose();
  Prediction prediction;
  prediction.mean = model_->lift.col(time_index) + model_->space * (core * mean).eval();
  prediction.variance = (model_->space * inner).cwiseProduct(model_->space).rowwise().sum().cwiseMax(0);
  const Eigen::Index displacements = noise_.size() - noise_.scalar_count();
  auto of_displacements = prediction.variance.head(displacements).array();
  of_displacements += noise_.offset_std() * noise_.offset_std();
  of_displacements += (noise_.scale_std() * prediction.mean.head(displacements).array()).square();
  if (const Eigen::MatrixXd* factor = noise_.step_error(step))
    prediction.variance += factor->rowwise().squaredNorm();
  if (const Eigen::MatrixXd* factor = noise_.lasting().factor(step)) {
    const likelihood::ConditionalStates errors = gaussian_->lasting_errors();
    const Eigen::MatrixXd with_w = model_->space * (core * covariance * errors.slope.transpose()).eval();
    const Eigen::MatrixXd own = errors.covariance + errors.slope * covariance * errors.slope.transpose();
    prediction.mean += *factor * (errors.mean - errors.slope * mean);
    prediction.variance += (*factor * own - 2 * with_w).cwiseProduct(*factor).rowwise().sum();
    prediction.variance = prediction.variance.cwiseMax(0);
  }
  return prediction;
}

const UpdateResult& RobustUpdate::update(const likelihood::Datum& datum, std::size_t time_index) {
  const std::size_t step = datum.step;
  if (last_ && std::pair(step, datum.key) <= *last_) {
    throw UsageError(fmt::format(
        "step {} comes after step {}: with gating or a Student-t likelihood steps are taken in order", step,
        last_->first));
  }
  if (student_ && datum.noise && !datum.noise->is_independent())
    throw UsageError("a Student-t likelihood is for sensors whose noise is independent in space: use gating");
  const auto start = monotonic_now();
  noise_std_ = (datum.noise ? *datum.noise : noise_.at_step(step)).standard_deviations();
  const Prediction before = predict(step, time_index);
  check_sensors(before, datum.values);
  likelihood::Datum accepted = datum;  // as it is judged: without what is rejected
  for (const Eigen::Index i : sensors_.rejected) accepted.values[i] = k_nan;
  if (!last_ || last_->first != step) rejected_ = 0;
  assimilate(accepted, time_index);
  last_.emplace(step, datum.key);
  rejected_ += std::ssize(sensors_.rejected);
  result_.rejected = rejected_;
  result_.missing -= rejected_;
  result_.elapsed_us.projection = 0;
  result_.elapsed_us.projection = microseconds_since(start) - result_.elapsed_us.total();
  return result_;
}

void RobustUpdate::check_sensors(const Prediction& before, const Eigen::Ref<const Eigen::VectorXd>& values) {
  watch_.observe(values, before.mean);
  sensors_ = {};
  sensors_.stuck = watch_.stuck();
  sensors_.absent = watch_.absent();
  sensors_.innovation = values - before.mean;
  sensors_.test_ratio =
      sensors_.innovation.cwiseAbs().array() / (noise_std_.array().square() + before.variance.array()).sqrt();
  sensors_.weight = Eigen::VectorXd::Ones(values.size());
  std::vector<Eigen::Index> outside;
  Eigen::Index present = 0;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (std::isnan(values[i])) continue;
    ++present;
    if (robust_.gate > 0 && sensors_.test_ratio[i] > robust_.gate) outside.push_back(i);
  }
  if (2 * std::ssize(outside) <= present) sensors_.rejected = std::move(outside);
  for (const Eigen::Index i : sensors_.stuck) {
    if (std::find(sensors_.rejected.begin(), sensors_.rejected.end(), i) == sensors_.rejected.end())
      sensors_.rejected.push_back(i);
  }
  for (const Eigen::Index i : sensors_.rejected) sensors_.weight[i] = 0;
}

void RobustUpdate::assimilate(const likelihood::Datum& datum, std::size_t time_index) {
  if (student_) {
    result_ = student_->update(datum.step, time_index, datum.values, noise_std_);
    const Eigen::VectorXd& factor = student_->precision_factors();
    sensors_.weight = factor.array().isNaN().select(sensors_.weight, factor);
  } else {
    gaussian_->add(std::make_shared<const likelihood::Datum>(datum), time_index);
    result_ = gaussian_->posterior_without_monitor(datum.step);
  }
}

}  // namespace knothe::assimilation
