#include "knothe/likelihood/noise/nuisance_filter.hpp"

#include <cassert>
#include <cmath>

namespace knothe::likelihood {

NuisanceFilter::NuisanceFilter(std::shared_ptr<const model::ObservedModel> model, const NoiseModel& noise)
    : scale_std_(noise.scale_std()),
      lasting_count_(lasting_count(noise)),
      first_scalar_(noise.size() - noise.scalar_count()),
      states_(model->functions->count()) {
  if (SharedError::is_in(noise)) shared_ = std::make_unique<SharedError>(std::move(model), noise);
  restart();
}

void NuisanceFilter::restart() {
  if (shared_) shared_->restart();
  states_.drop(0);
  if (scale_std_ > 0) states_.append(Eigen::VectorXd::Constant(1, scale_std_ * scale_std_));
  if (lasting_count_ > 0) states_.append(Eigen::VectorXd::Ones(lasting_count_));
  kept_ = states_.size();
}

void NuisanceFilter::set_noise(const NoiseModel& noise) {
  if (shared_) shared_->set_noise(noise);
}

StepForm NuisanceFilter::condition(const NoiseGroup& group, const Eigen::MatrixXd& core,
                                   const Eigen::VectorXd& residual, const Eigen::VectorXd& predicted,
                                   const Eigen::MatrixXd* lasting, const Eigen::MatrixXd* step_error,
                                   MovedForm* moved) {
  states_.drop(kept_);  // those of a datum that was refused
  if (step_error != nullptr) states_.append(Eigen::VectorXd::Ones(step_error->cols()));
  ProjectedDatum datum{group, core, residual, Eigen::MatrixXd::Zero(residual.size(), states_.size())};
  if (scale_std_ > 0) {
    datum.extra.col(0) = predicted;
    for (std::size_t j = group.kept.size(); j-- > 0 && group.kept[j] >= first_scalar_;) datum.extra(j, 0) = 0;
  }
  if (lasting != nullptr)
    datum.extra.middleCols(scale_std_ > 0 ? 1 : 0, lasting_count_) = (*lasting)(group.kept, Eigen::all);
  if (step_error != nullptr)
    datum.extra.rightCols(step_error->cols()) = (*step_error)(group.kept, Eigen::all);
  StepForm form;
  if (shared_) {
    form = shared_->condition(datum, moved);
  } else {
    group.project(core, residual, 1, datum.extra, form);
  }
  assert(moved == nullptr || states_.size() == 0);
  if (states_.size() == 0 || !std::isfinite(form.constant) || !form.linear.allFinite()) return form;
  form = states_.condition(form);
  if (shared_) {
    kept_ = states_.size();
  } else {
    states_.drop(kept_);
  }
  assert(form.linear.size() == core.cols());
  return form;
}

}  // namespace knothe::likelihood
