#include "knothe/inference/gaussian_noise.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::inference {

GaussianNoise GaussianNoise::independent(const Eigen::VectorXd& std) {
  GaussianNoise noise;
  for (Eigen::Index i = 0; i < std.size(); ++i)
    if (!(std[i] > 0) || !std::isfinite(std[i]))
      throw UsageError(
          fmt::format("noise: standard deviation {} of observation {} is not positive", std[i], i));
  noise.size_ = std.size();
  noise.inverse_std_ = std.cwiseInverse();
  noise.log_determinant_ = 2 * std.array().log().sum();
  return noise;
}

GaussianNoise GaussianNoise::correlated(const Eigen::MatrixXd& covariance) {
  if (covariance.rows() != covariance.cols())
    throw UsageError(
        fmt::format("noise: the covariance is {} × {}, not square", covariance.rows(), covariance.cols()));
  const Eigen::VectorXd scale = covariance.diagonal().cwiseAbs().cwiseSqrt();
  if (!((covariance - covariance.transpose()).cwiseAbs().array() <=
        1e-10 * (scale * scale.transpose()).array())
           .all())
    throw UsageError("noise: the covariance is not symmetric");
  const Eigen::LLT<Eigen::MatrixXd> cholesky(covariance);
  GaussianNoise noise;
  noise.size_ = covariance.rows();
  noise.lower_ = cholesky.matrixL();
  if (cholesky.info() != Eigen::Success || !(noise.lower_.diagonal().array() > 1e-7 * scale.array()).all())
    throw UsageError("noise: the covariance is singular or indefinite; it must be positive definite");
  noise.log_determinant_ = 2 * noise.lower_.diagonal().array().log().sum();
  return noise;
}

void GaussianNoise::whiten(Eigen::Ref<Eigen::MatrixXd> x) const {
  if (lower_.size() == 0)
    x.array().colwise() *= inverse_std_.array();
  else
    lower_.triangularView<Eigen::Lower>().solveInPlace(x);
}

void GaussianNoise::whiten_transposed(Eigen::Ref<Eigen::MatrixXd> x) const {
  if (lower_.size() == 0)
    x.array().colwise() *= inverse_std_.array();
  else
    lower_.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
}

Eigen::VectorXd GaussianNoise::standard_deviations() const {
  if (lower_.size() == 0) return inverse_std_.cwiseInverse();
  return lower_.rowwise().norm();
}

}  // namespace knothe::inference
