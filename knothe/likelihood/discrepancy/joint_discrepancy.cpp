#include "knothe/likelihood/discrepancy/joint_discrepancy.hpp"

#include <cassert>
#include <cmath>

namespace knothe::likelihood {

JointDiscrepancy::JointDiscrepancy(const Eigen::MatrixXd& factor, double size, double memory)
    : factor_(size * factor), rho_(std::exp(-1 / memory)), filter_(factor.rows()) {
  assert(size > 0 && memory > 0);
  restart();
}

void JointDiscrepancy::restart() {
  filter_.drop(0);
  filter_.append(Eigen::VectorXd::Ones(factor_.cols()));
}

StepForm JointDiscrepancy::condition(const StepForm& form) {
  const Eigen::Index q = factor_.cols(), r = factor_.rows();
  if (q == 0) return form;
  assert(filter_.size() == q);
  filter_.relax(q, rho_);
  return filter_.condition(form, Eigen::MatrixXd::Identity(r, r), factor_);
}

StepForm JointDiscrepancy::condition(const MovedForm& moved, const Eigen::MatrixXd& core) {
  const Eigen::Index q = factor_.cols(), r = factor_.rows(), s = core.rows(), known = s * moved.groups;
  filter_.relax(q, rho_);
  if (moved.form.used == 0) {  // nothing was measured: the datum is in none of the sums
    StepForm nothing = StepForm::zero(r);
    nothing.missing = moved.form.missing;
    return nothing;
  }
  // Sums of groups whose data had no discrepancy are 0 exactly.
  const auto grow = [&](Eigen::Index sums) {
    if (filter_.size() < q + sums) filter_.append(Eigen::VectorXd::Zero(q + sums - filter_.size()));
  };
  grow(known);
  assert(moved.form.linear.size() == r + s + known && filter_.size() == q + known);
  Eigen::MatrixXd base = Eigen::MatrixXd::Identity(r + s + known, r);
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(r + s + known, q + known);
  const Eigen::MatrixXd moves = core * factor_;
  map.block(r, 0, s, q) = moves;
  map.bottomRightCorner(known, known).setIdentity();
  StepForm given = filter_.condition(moved.form, base, map);
  grow(s * (moved.group + 1));  // it may be the first of its group
  // The datum is one of those before the next: z + u.
  filter_.accumulate(q + s * moved.group, moves);
  return given;
}

}  // namespace knothe::likelihood
