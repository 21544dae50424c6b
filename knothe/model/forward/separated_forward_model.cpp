#include "knothe/model/forward/separated_forward_model.hpp"

#include <fmt/format.h>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/model/reduced/outputs.hpp"

namespace knothe::model {

ObservedModel observe_output(const SeparatedModel& model, const std::string& name) {
  const ModelContents& contents = model.contents();
  const auto times = std::ssize(contents.time);
  ObservedModel observed;
  observed.functions = std::make_shared<JointFunctions>(functions_of(contents, output_of(model, name)));
  observed.parameters = model.parameter_names();
  observed.time = contents.time;
  observed.space = Eigen::MatrixXd::Ones(1, 1);
  observed.lift = Eigen::MatrixXd::Zero(1, times);
  for (Eigen::Index t = 0; t < times; ++t) observed.core.emplace_back(Eigen::RowVectorXd::Unit(times, t));
  return observed;
}

SeparatedForwardModel::SeparatedForwardModel(const ObservedModel& model,
                                             const std::vector<std::size_t>& steps, std::string where)
    : functions_(model.functions), where_(std::move(where)) {
  for (const std::size_t step : steps)
    if (step >= model.time.size())
      throw UsageError(fmt::format("{}: there is no step {}: the model has steps 0 to {}", where_, step,
                                   model.time.size() - 1));
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

}  // namespace knothe::model
