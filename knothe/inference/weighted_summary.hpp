#pragma once
/// @file What is said about a posterior, from weighted points: moments to the fourth order and quantiles.
#include <Eigen/Core>
#include <cstdint>

#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::inference {

using numerics::k_quantile_levels;

/// Of d parameters.
struct WeightedSummary {
  Eigen::VectorXd mean;        ///< d
  Eigen::MatrixXd covariance;  ///< d × d, symmetric to the bit
  Eigen::VectorXd skewness;    ///< d: E (p − mean)³ / std³
  Eigen::VectorXd kurtosis;    ///< d: E (p − mean)⁴ / std⁴; 3 for a Gaussian
  Eigen::MatrixXd quantiles;   ///< d × levels

  [[nodiscard]] Eigen::VectorXd standard_deviations() const {
    return covariance.diagonal().cwiseMax(0).cwiseSqrt();
  }
};

/// `points` n × d; `weights` n, not negative, sum 1. Errors: UsageError for no points or sizes that disagree.
[[nodiscard]] WeightedSummary summarise(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                        const Eigen::Ref<const Eigen::VectorXd>& weights);

/// `count` equally weighted draws from weighted points: `numerics::equal_draws`, then a seeded shuffle, so
/// that any part of them is a sample too. count × d.
[[nodiscard]] Eigen::MatrixXd resample(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                       const Eigen::Ref<const Eigen::VectorXd>& weights, Eigen::Index count,
                                       std::uint64_t seed);

}  // namespace knothe::inference
