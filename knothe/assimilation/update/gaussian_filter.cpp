#include "knothe/assimilation/update/gaussian_filter.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>

#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"

namespace knothe::assimilation {
namespace {

double log_det(const Eigen::LLT<Eigen::MatrixXd>& factor) {
  return 2 * factor.matrixLLT().diagonal().array().log().sum();
}

}  // namespace

Eigen::MatrixXd standardised_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed) {
  Eigen::MatrixXd points = numerics::sobol_normal_points(n, d, seed);
  points.rowwise() -= points.colwise().mean().eval();
  const Eigen::MatrixXd covariance = points.transpose() * points / n;
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  return factor.matrixL().solve(points.transpose()).transpose();
}

GaussianFilter::GaussianFilter(posterior::Method kind,
                               std::shared_ptr<const model::ParameterFunctions> functions,
                               std::shared_ptr<const posterior::PriorTransform> transform,
                               Eigen::VectorXd central, Eigen::Index members, std::uint64_t seed)
    : kind_(kind),
      functions_(std::move(functions)),
      transform_(std::move(transform)),
      central_(std::move(central)),
      mean_(Eigen::VectorXd::Zero(transform_->dimension())),
      covariance_(transform_->covariance()) {
  if (kind_ == posterior::Method::ensemble_kalman)
    members_ =
        standardised_points(members, mean_.size(), seed) * Eigen::MatrixXd(covariance_.llt().matrixU());
}

double GaussianFilter::update(const likelihood::StepForm& form) {
  if (kind_ == posterior::Method::extended_kalman) return update_extended(form);
  const Eigen::Index d = mean_.size();
  if (kind_ == posterior::Method::ensemble_kalman) {
    return update_by_points(form, members_,
                            Eigen::VectorXd::Constant(members_.rows(), 1.0 / members_.rows()));
  }
  const double kappa = std::max(3.0 - d, 0.0), spread = d + kappa;
  const Eigen::MatrixXd root = Eigen::LLT<Eigen::MatrixXd>(covariance_).matrixL();
  Eigen::MatrixXd points = mean_.transpose().replicate(2 * d + 1, 1);
  Eigen::VectorXd weights = Eigen::VectorXd::Constant(2 * d + 1, 0.5 / spread);
  weights[0] = kappa / spread;
  for (Eigen::Index k = 0; k < d; ++k) {
    points.row(1 + k) += std::sqrt(spread) * root.col(k).transpose();
    points.row(1 + d + k) -= std::sqrt(spread) * root.col(k).transpose();
  }
  return update_by_points(form, points, weights);
}

// The prior is N(0, P₀): with the information P⁻¹ the data have added P⁻¹ − P₀⁻¹ and P⁻¹ m.
void GaussianFilter::raise(double power) {
  const Eigen::Index d = mean_.size();
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(d, d);
  const Eigen::LLT<Eigen::MatrixXd> before(covariance_);
  const Eigen::MatrixXd information =
      (1 - power) * transform_->covariance().llt().solve(identity) + power * before.solve(identity);
  const Eigen::VectorXd mean = information.llt().solve(power * before.solve(mean_));
  covariance_ = information.llt().solve(identity);
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
  if (members_.rows() > 0) {
    const Eigen::MatrixXd whitened =
        before.matrixL().solve((members_.rowwise() - mean_.transpose()).transpose());
    members_ = (covariance_.llt().matrixL() * whitened).transpose().rowwise() + mean.transpose();
  }
  mean_ = mean;
}

double GaussianFilter::update_extended(const likelihood::StepForm& form) {
  const Eigen::Index d = mean_.size(), r = central_.size();
  Eigen::MatrixXd p(1, d), first(1, d), unused;
  transform_->evaluate(mean_.transpose(), 1, p, first, unused);
  model::FunctionBatch batch;
  batch.resize(1, d, r, 1);
  functions_->evaluate(p, 1, batch);
  const Eigen::VectorXd v = batch.value.row(0).transpose() - central_;
  Eigen::MatrixXd slope(r, d);  // ∂w/∂z
  for (Eigen::Index a = 0; a < d; ++a) slope.col(a) = first(0, a) * batch.first[a].row(0).transpose();
  const Eigen::VectorXd gv = form.quadratic * v, b = slope.transpose() * (form.linear - gv);
  const Eigen::LLT<Eigen::MatrixXd> before(covariance_);
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(d, d);
  const Eigen::LLT<Eigen::MatrixXd> after(before.solve(identity) +
                                          slope.transpose() * form.quadratic * slope);
  covariance_ = after.solve(identity);
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
  const Eigen::VectorXd step = covariance_ * b;
  mean_ += step;
  const double misfit = v.dot(gv) - 2 * form.linear.dot(v) + form.constant;
  return -0.5 * (form.log_normaliser + misfit) + 0.5 * b.dot(step) - 0.5 * (log_det(after) + log_det(before));
}

// With weighted deviations D (d × n) of z and L (r × n) of w, P_zw = D Lᵀ and P_ww = L Lᵀ; the gain applied
// to the innovation is D (I + A)⁻¹ b with A = Lᵀ G L, b = Lᵀ (g − G v̄), by the push-through identity.
double GaussianFilter::update_by_points(const likelihood::StepForm& form, const Eigen::MatrixXd& points,
                                        const Eigen::VectorXd& weights) {
  const Eigen::Index n = points.rows();
  const Eigen::VectorXd roots = weights.cwiseSqrt();
  const Eigen::MatrixXd w = functions_at(points);
  const Eigen::VectorXd z_mean = points.transpose() * weights, w_mean = w.transpose() * weights;
  const Eigen::MatrixXd deviations = (points.rowwise() - z_mean.transpose()).transpose() * roots.asDiagonal();
  const Eigen::MatrixXd l = (w.rowwise() - w_mean.transpose()).transpose() * roots.asDiagonal();
  const Eigen::VectorXd v = w_mean - central_, gv = form.quadratic * v;
  const Eigen::VectorXd b = l.transpose() * (form.linear - gv);
  Eigen::MatrixXd a = l.transpose() * form.quadratic * l;
  a = 0.5 * (a + a.transpose()).eval();
  const Eigen::LLT<Eigen::MatrixXd> factor(Eigen::MatrixXd::Identity(n, n) + a);
  const Eigen::VectorXd solved = factor.solve(b);
  mean_ = z_mean + deviations * solved;
  if (kind_ == posterior::Method::ensemble_kalman) {
    const numerics::SymmetricEigen eigen(a);
    const Eigen::VectorXd shrink = (1 + eigen.eigenvalues().cwiseMax(0).array()).rsqrt();
    const Eigen::MatrixXd contracted =
        deviations * eigen.eigenvectors() * shrink.asDiagonal() * eigen.eigenvectors().transpose();
    members_ = (contracted * std::sqrt(n)).transpose().rowwise() + mean_.transpose();
    covariance_ = contracted * contracted.transpose();
  } else {
    covariance_ = deviations * factor.solve(deviations.transpose());
  }
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
  const double misfit = v.dot(gv) - 2 * form.linear.dot(v) + form.constant;
  return -0.5 * (form.log_normaliser + misfit) + 0.5 * b.dot(solved) - 0.5 * log_det(factor);
}

Eigen::MatrixXd GaussianFilter::functions_at(const Eigen::MatrixXd& z) const {
  Eigen::MatrixXd p(z.rows(), z.cols()), unused;
  transform_->evaluate(z, 0, p, unused, unused);
  model::FunctionBatch batch;
  batch.resize(z.rows(), z.cols(), central_.size(), 0);
  functions_->evaluate(p, 0, batch);
  return batch.value;
}

}  // namespace knothe::assimilation
