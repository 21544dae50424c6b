#include "knothe/assimilation/bias/joint_discrepancy.hpp"

#include <Eigen/Cholesky>
#include <cassert>
#include <cmath>

namespace knothe::assimilation {

JointDiscrepancy::JointDiscrepancy(const Eigen::MatrixXd& factor, double size, double memory)
    : factor_(size * factor), rho_(std::exp(-1 / memory)) {
  assert(size > 0 && memory > 0);
  restart();
}

void JointDiscrepancy::restart() {
  const Eigen::Index q = factor_.cols(), r = factor_.rows();
  mean_.setZero(q);
  slope_.setZero(q, r);
  covariance_.setIdentity(q, q);
}

void JointDiscrepancy::predict() {
  const Eigen::Index q = factor_.cols();
  mean_.head(q) *= rho_;
  slope_.topRows(q) *= rho_;
  covariance_.topRows(q) *= rho_;
  covariance_.leftCols(q) *= rho_;
  covariance_.diagonal().head(q).array() += 1 - rho_ * rho_;
}

void JointDiscrepancy::grow(Eigen::Index size) {
  if (mean_.size() >= size) return;
  mean_.conservativeResizeLike(Eigen::VectorXd::Zero(size));
  slope_.conservativeResizeLike(Eigen::MatrixXd::Zero(size, slope_.cols()));
  covariance_.conservativeResizeLike(Eigen::MatrixXd::Zero(size, size));
}

StepForm JointDiscrepancy::condition(const StepForm& form) {
  const Eigen::Index q = factor_.cols(), r = factor_.rows();
  if (q == 0) return form;
  assert(mean_.size() == q);
  predict();
  return take(form, Eigen::MatrixXd::Identity(r, r), factor_,
              Eigen::LLT<Eigen::MatrixXd>(covariance_).matrixL());
}

StepForm JointDiscrepancy::condition(const MovedForm& moved, const Eigen::MatrixXd& core) {
  const Eigen::Index q = factor_.cols(), r = factor_.rows(), s = core.rows(), known = s * moved.groups;
  predict();
  if (moved.form.used == 0) {  // nothing was measured: the datum is in none of the sums
    StepForm nothing = StepForm::zero(r);
    nothing.missing = moved.form.missing;
    return nothing;
  }
  grow(q + known);  // groups of data that had no discrepancy
  assert(moved.form.linear.size() == r + s + known && mean_.size() == q + known);
  Eigen::MatrixXd base = Eigen::MatrixXd::Zero(r + s + known, r);
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(r + s + known, q + known);
  base.topRows(r).setIdentity();
  const Eigen::MatrixXd moves = core * factor_;
  map.block(r, 0, s, q) = moves;
  map.bottomRightCorner(known, known).setIdentity();
  // z is known where ξ was: a covariance without full rank.
  const Eigen::LDLT<Eigen::MatrixXd> factor(covariance_);
  const Eigen::MatrixXd unit = factor.matrixL();
  const Eigen::VectorXd root = factor.vectorD().cwiseMax(0).cwiseSqrt();
  const Eigen::MatrixXd lower = factor.transpositionsP().transpose() * (unit * root.asDiagonal());
  StepForm given = take(moved.form, base, map, lower);
  grow(q + s * (moved.group + 1));  // it may be the first of its group
  // The datum is one of those before the next: z + u.
  const Eigen::Index at = q + s * moved.group;
  mean_.segment(at, s) += moves * mean_.head(q);
  slope_.middleRows(at, s) += moves * slope_.topRows(q);
  covariance_.middleRows(at, s) += (moves * covariance_.topRows(q)).eval();
  covariance_.middleCols(at, s) += (covariance_.leftCols(q) * moves.transpose()).eval();
  return given;
}

/// The form is one of base v + map x, with x = mean − slope v + lower η, η ~ N(0, I): in v once η is
/// integrated out. State and its covariance given the datum.
StepForm JointDiscrepancy::take(const StepForm& form, const Eigen::MatrixXd& base, const Eigen::MatrixXd& map,
                                const Eigen::MatrixXd& lower) {
  const Eigen::MatrixXd moving = map * lower;
  const Eigen::MatrixXd fixed = base - map * slope_;
  const Eigen::VectorXd offset = map * mean_;
  // The misfit at η is m(v) + 2 (a + A v)ᵀη + ηᵀ S η − ηᵀη; with the prior of η, S = I + DᵀGD.
  const Eigen::MatrixXd weighted = form.quadratic * moving;
  Eigen::MatrixXd inner = moving.transpose() * weighted;
  inner.diagonal().array() += 1;
  const Eigen::LLT<Eigen::MatrixXd> cholesky(inner);
  const Eigen::MatrixXd curved = form.quadratic * fixed;
  const Eigen::VectorXd at_zero = form.quadratic * offset - form.linear;
  const Eigen::MatrixXd coupling = weighted.transpose() * fixed;
  const Eigen::VectorXd pull = moving.transpose() * at_zero;
  const Eigen::MatrixXd solved_coupling = cholesky.solve(coupling);
  const Eigen::VectorXd solved_pull = cholesky.solve(pull);

  StepForm given = form;
  given.quadratic = fixed.transpose() * curved - coupling.transpose() * solved_coupling;
  given.quadratic = 0.5 * (given.quadratic + given.quadratic.transpose().eval());
  given.linear = coupling.transpose() * solved_pull - fixed.transpose() * at_zero;
  given.constant = form.constant + offset.dot(at_zero - form.linear) - pull.dot(solved_pull);
  given.log_normaliser += 2 * cholesky.matrixLLT().diagonal().array().log().sum();

  // Update: η | v, d ~ N(−S⁻¹(a + A v), S⁻¹).
  mean_ -= lower * solved_pull;
  slope_ += lower * solved_coupling;
  covariance_ = lower * cholesky.solve(Eigen::MatrixXd(lower.transpose()));
  covariance_ = 0.5 * (covariance_ + covariance_.transpose().eval());
  return given;
}

}  // namespace knothe::assimilation
