#include "knothe/transport/diagnose/moments.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::transport {

Moments moments_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                   const Eigen::Ref<const Eigen::VectorXd>& weights) {
  const Eigen::Index n = points.rows(), d = points.cols();
  if (n < 1 || weights.size() != n)
    throw UsageError(
        fmt::format("moments: {} points and {} weights; at least one point is needed, and one weight each", n,
                    weights.size()));
  const double sum = weights.sum();
  if (!(weights.minCoeff() >= 0) || !(sum > 0) || !std::isfinite(sum))
    throw UsageError("moments: the weights must be finite and not negative, and not all zero");
  const Eigen::VectorXd w = weights / sum;
  Moments m;
  m.mean = points.transpose() * w;
  const Eigen::MatrixXd centred = points.rowwise() - m.mean.transpose();
  m.covariance.noalias() = centred.transpose() * w.asDiagonal() * centred;
  m.covariance = (0.5 * (m.covariance + m.covariance.transpose())).eval();
  m.skewness.setZero(d);
  m.kurtosis.setConstant(d, 3);
  for (Eigen::Index k = 0; k < d; ++k) {
    const double std = std::sqrt(m.covariance(k, k));
    if (!(std > 0)) continue;
    const Eigen::ArrayXd u = centred.col(k).array() / std;
    m.skewness[k] = (w.array() * u.cube()).sum();
    m.kurtosis[k] = (w.array() * u.square().square()).sum();
  }
  return m;
}

}  // namespace knothe::transport
