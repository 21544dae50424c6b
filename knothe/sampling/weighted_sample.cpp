#include "knothe/sampling/weighted_sample.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::sampling {

namespace {

void require_weights(const WeightedSample& sample) {
  if (sample.points.rows() == 0 || sample.points.rows() != sample.weights.size())
    throw UsageError(fmt::format("weighted sample: {} points and {} weights; there must be as many, and some",
                                 sample.points.rows(), sample.weights.size()));
  if (!(sample.weights.sum() > 0) || !(sample.weights.minCoeff() >= 0))
    throw UsageError("weighted sample: weights must be non-negative, with a positive sum");
}

}  // namespace

Eigen::VectorXd mean_of(const WeightedSample& sample) {
  require_weights(sample);
  return numerics::moments_of(sample.points, sample.weights).mean;
}

Eigen::MatrixXd covariance_of(const WeightedSample& sample) {
  require_weights(sample);
  return numerics::moments_of(sample.points, sample.weights).covariance;
}

}  // namespace knothe::sampling
