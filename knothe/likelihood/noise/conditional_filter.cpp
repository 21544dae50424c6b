#include "knothe/likelihood/noise/conditional_filter.hpp"

#include <Eigen/Cholesky>

namespace knothe::likelihood {

Eigen::Index ConditionalFilter::append(const Eigen::VectorXd& variance) {
  const Eigen::Index first = size(), size = first + variance.size();
  mean_.conservativeResizeLike(Eigen::VectorXd::Zero(size));
  slope_.conservativeResizeLike(Eigen::MatrixXd::Zero(size, functions_));
  covariance_.conservativeResizeLike(Eigen::MatrixXd::Zero(size, size));
  covariance_.diagonal().tail(variance.size()) = variance;
  return first;
}

void ConditionalFilter::drop(Eigen::Index size) {
  mean_.conservativeResize(size);
  slope_.conservativeResize(size, functions_);
  covariance_.conservativeResize(size, size);
}

void ConditionalFilter::relax(Eigen::Index count, double rho) {
  mean_.head(count) *= rho;
  slope_.topRows(count) *= rho;
  covariance_.topRows(count) *= rho;
  covariance_.leftCols(count) *= rho;
  covariance_.diagonal().head(count).array() += 1 - rho * rho;
}

void ConditionalFilter::accumulate(Eigen::Index to, const Eigen::MatrixXd& map) {
  const Eigen::Index rows = map.rows(), columns = map.cols();
  mean_.segment(to, rows) += map * mean_.head(columns);
  slope_.middleRows(to, rows) += map * slope_.topRows(columns);
  covariance_.middleRows(to, rows) += (map * covariance_.topRows(columns)).eval();
  covariance_.middleCols(to, rows) += (covariance_.leftCols(columns) * map.transpose()).eval();
}

StepForm ConditionalFilter::condition(const StepForm& form) {
  const Eigen::Index n = functions_ + size();
  return condition(form, Eigen::MatrixXd::Identity(n, functions_),
                   Eigen::MatrixXd::Identity(n, n).rightCols(size()));
}

// With x = mean − slope v + L η, η ~ N(0, I), the misfit is a form in v and η, out of which η is integrated.
StepForm ConditionalFilter::condition(const StepForm& form, const Eigen::MatrixXd& base,
                                      const Eigen::MatrixXd& map) {
  // A covariance without full rank (a state that is known) has a pivoted factor all the same.
  const Eigen::LDLT<Eigen::MatrixXd> factor(covariance_);
  const Eigen::MatrixXd unit = factor.matrixL();
  const Eigen::VectorXd root = factor.vectorD().cwiseMax(0).cwiseSqrt();
  const Eigen::MatrixXd lower = factor.transpositionsP().transpose() * (unit * root.asDiagonal());
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

Eigen::MatrixX2d ConditionalStates::moments(const Eigen::VectorXd& v, const Eigen::MatrixXd& factor) const {
  Eigen::MatrixX2d result(mean.size(), 2);
  const Eigen::VectorXd spread = (slope * factor).rowwise().squaredNorm();
  result << mean - slope * v, (covariance.diagonal() + spread).cwiseMax(0).cwiseSqrt();
  return result;
}

ConditionalStates ConditionalFilter::states(Eigen::Index first, Eigen::Index count) const {
  return {mean_.segment(first, count), slope_.middleRows(first, count),
          covariance_.block(first, first, count, count)};
}

StepForm without_standard_normals(const StepForm& form, Eigen::Index functions) {
  ConditionalFilter filter(functions);
  filter.append(Eigen::VectorXd::Ones(form.linear.size() - functions));
  return filter.condition(form);
}

}  // namespace knothe::likelihood
