#include "knothe/assimilation/update/step_form.hpp"

namespace knothe::assimilation {

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

void StepForm::raise(double power) {
  quadratic *= power;
  linear *= power;
  constant *= power;
  log_normaliser *= power;
}

}  // namespace knothe::assimilation
