#include "knothe/model/forward/forward_model.hpp"

#include "knothe/base/error.hpp"

namespace knothe::model {
namespace {

[[noreturn]] void lacks(const ForwardModel& model, const char* what) {
  throw UsageError(model.where() + ": the model has no " + what + "; it was asked for all the same");
}

}  // namespace

void ForwardModel::gradient(const Eigen::Ref<const Eigen::MatrixXd>& /*points*/,
                            const Eigen::Ref<const Eigen::MatrixXd>& /*sensitivities*/,
                            Eigen::Ref<Eigen::MatrixXd> /*gradients*/) {
  lacks(*this, "gradient");
}

void ForwardModel::jacobian(const Eigen::Ref<const Eigen::MatrixXd>& /*points*/,
                            Eigen::Ref<Eigen::MatrixXd> /*jacobians*/) {
  lacks(*this, "Jacobian");
}

void ForwardModel::hessian(const Eigen::Ref<const Eigen::MatrixXd>& /*points*/,
                           const Eigen::Ref<const Eigen::MatrixXd>& /*sensitivities*/,
                           Eigen::Ref<Eigen::MatrixXd> /*hessians*/) {
  lacks(*this, "Hessian");
}

}  // namespace knothe::model
