#include "knothe/assimilation/joint_discrepancy.hpp"

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

StepForm JointDiscrepancy::condition(const StepForm& form) {
  const Eigen::Index q = factor_.cols(), r = factor_.rows();
  if (q == 0) return form;
  // Prediction.
  mean_ *= rho_;
  slope_ *= rho_;
  covariance_ *= rho_ * rho_;
  covariance_.diagonal().array() += 1 - rho_ * rho_;
  // ξ = mean − slope v + L η, so that w − w₀ + κFξ = T v + u + D η.
  const Eigen::MatrixXd lower = Eigen::LLT<Eigen::MatrixXd>(covariance_).matrixL();
  const Eigen::MatrixXd moving = factor_ * lower;
  const Eigen::MatrixXd fixed = Eigen::MatrixXd::Identity(r, r) - factor_ * slope_;
  const Eigen::VectorXd offset = factor_ * mean_;
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
