#include "knothe/likelihood/step/step_form.hpp"

#include <utility>

namespace knothe::likelihood {

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
  discounted += other.discounted;
}

void StepForm::raise(double power) {
  quadratic *= power;
  linear *= power;
  constant *= power;
  log_normaliser *= power;
  discounted += (1 - power) * (used - discounted);
}

void FormBlocks::add(const StepForm& form) {
  if (!forms_.empty() && steps_in_last_ < steps_per_block_) {
    forms_.back().add(form);
    ++steps_in_last_;
    return;
  }
  if (forms_.size() == k_max_blocks) {
    for (std::size_t k = 0; k < k_max_blocks / 2; ++k) {
      if (k > 0) forms_[k] = std::move(forms_[2 * k]);
      forms_[k].add(forms_[2 * k + 1]);
    }
    forms_.resize(k_max_blocks / 2);
    steps_per_block_ *= 2;
  }
  forms_.push_back(form);
  steps_in_last_ = 1;
}

}  // namespace knothe::likelihood
