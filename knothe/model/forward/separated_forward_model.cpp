#include "knothe/model/forward/separated_forward_model.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"

namespace knothe::model {
namespace {

void require_steps(const std::vector<std::size_t>& steps, std::size_t count, const std::string& where) {
  for (const std::size_t step : steps)
    if (step >= count)
      throw UsageError(
          fmt::format("{}: there is no step {}: the model has steps 0 to {}", where, step, count - 1));
}

}  // namespace

SeparatedForwardModel::SeparatedForwardModel(const ObservedModel& model,
                                             const std::vector<std::size_t>& steps, std::string where)
    : functions_(model.functions), where_(std::move(where)) {
  require_steps(steps, model.time.size(), where_);
  const Eigen::Index n = model.observations(), count = std::ssize(steps);
  matrix_.resize(n * count, functions_->count());
  offset_.resize(n * count);
  for (Eigen::Index s = 0; s < count; ++s) {
    const std::size_t step = steps[s];
    matrix_.middleRows(s * n, n) = model.space * model.core[step];
    offset_.segment(s * n, n) = model.lift.col(step);
  }
}

void SeparatedForwardModel::restrict_to(const std::vector<Eigen::Index>& outputs) {
  matrix_ = Eigen::MatrixXd(matrix_(outputs, Eigen::all));
  offset_ = Eigen::VectorXd(offset_(outputs));
}

void SeparatedForwardModel::functions_at(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives) {
  check_cancellation("the model was being evaluated");
  batch_.resize(points.cols(), points.rows(), functions_->count(), derivatives);
  functions_->evaluate(points.transpose(), derivatives, batch_);
}

void SeparatedForwardModel::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                     Eigen::Ref<Eigen::MatrixXd> values) {
  functions_at(points, 0);
  values.noalias() = matrix_ * batch_.value.transpose();
  values.colwise() += offset_;
  calls_.evaluations += points.cols();
}

void SeparatedForwardModel::jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                     Eigen::Ref<Eigen::MatrixXd> jacobians) {
  functions_at(points, 1);
  const Eigen::Index m = output_count();
  for (Eigen::Index k = 0; k < points.rows(); ++k)
    jacobians.middleRows(k * m, m).noalias() = matrix_ * batch_.first[k].transpose();
  calls_.jacobians += points.size();
}

void SeparatedForwardModel::hessian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                    const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                                    Eigen::Ref<Eigen::MatrixXd> hessians) {
  functions_at(points, 2);
  const Eigen::Index d = points.rows();
  const Eigen::MatrixXd weights = matrix_.transpose() * sensitivities;  // r × n
  for (Eigen::Index a = 0; a < d; ++a)
    for (Eigen::Index b = 0; b <= a; ++b) {
      const auto& second = batch_.second[a * (a + 1) / 2 + b];
      hessians.row(a * d + b) = second.cwiseProduct(weights.transpose()).rowwise().sum().transpose();
      if (a != b) hessians.row(b * d + a) = hessians.row(a * d + b);
    }
  calls_.hessians += points.size();
}

SeparatedOutputModel::SeparatedOutputModel(SeparatedModel model, std::string output,
                                           std::vector<std::size_t> steps)
    : model_(std::move(model)), output_(std::move(output)), steps_(std::move(steps)) {
  const std::vector<std::string> names = model_.output_names();
  if (std::find(names.begin(), names.end(), output_) == names.end())
    throw UsageError(fmt::format("{}: the model has no output \"{}\"{}; it has {}", model_.where(), output_,
                                 did_you_mean(output_, names),
                                 names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
  require_steps(steps_, model_.step_count(), model_.where());
}

FieldDerivatives SeparatedOutputModel::at(const Eigen::Ref<const Eigen::VectorXd>& point,
                                          int derivatives) const {
  check_cancellation("the model was being evaluated");
  return model_.evaluate_output(output_, std::span(point.data(), point.size()), derivatives);
}

void SeparatedOutputModel::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                    Eigen::Ref<Eigen::MatrixXd> values) {
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const auto found = at(points.col(i), 0);
    for (std::size_t s = 0; s < steps_.size(); ++s) values(s, i) = found.value[steps_[s]];
  }
  calls_.evaluations += points.cols();
}

void SeparatedOutputModel::jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                    Eigen::Ref<Eigen::MatrixXd> jacobians) {
  const std::size_t d = points.rows(), m = steps_.size();
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const auto found = at(points.col(i), 1);
    for (std::size_t s = 0; s < m; ++s)
      for (std::size_t k = 0; k < d; ++k) jacobians(k * m + s, i) = found.gradient[steps_[s] * d + k];
  }
  calls_.jacobians += points.size();
}

void SeparatedOutputModel::hessian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                   const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                                   Eigen::Ref<Eigen::MatrixXd> hessians) {
  const std::size_t d = points.rows();
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const auto found = at(points.col(i), 2);
    hessians.col(i).setZero();
    for (std::size_t s = 0; s < steps_.size(); ++s)
      for (std::size_t ab = 0; ab < d * d; ++ab)
        hessians(ab, i) += sensitivities(s, i) * found.hessian[steps_[s] * d * d + ab];
  }
  calls_.hessians += points.size();
}

}  // namespace knothe::model
