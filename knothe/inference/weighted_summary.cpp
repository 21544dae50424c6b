#include "knothe/inference/weighted_summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <random>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::inference {

WeightedSummary summarise(const Eigen::Ref<const Eigen::MatrixXd>& points,
                          const Eigen::Ref<const Eigen::VectorXd>& weights) {
  const Eigen::Index n = points.rows(), d = points.cols();
  if (n == 0 || weights.size() != n)
    throw UsageError(fmt::format("summary: {} points with {} weights", n, weights.size()));
  WeightedSummary s;
  s.mean = points.transpose() * weights;
  const Eigen::MatrixXd centred = points.rowwise() - s.mean.transpose();
  s.covariance = centred.transpose() * weights.asDiagonal() * centred;
  s.covariance = (0.5 * (s.covariance + s.covariance.transpose())).eval();
  s.skewness.resize(d), s.kurtosis.resize(d);
  s.quantiles.resize(d, static_cast<Eigen::Index>(k_quantile_levels.size()));
  numerics::WeightedQuantiles quantiles;
  std::vector<double> values(static_cast<std::size_t>(n)), w(weights.begin(), weights.end());
  std::array<double, k_quantile_levels.size()> found{};
  for (Eigen::Index k = 0; k < d; ++k) {
    const auto x = centred.col(k).array();
    const double variance = std::max(s.covariance(k, k), 1e-300);
    s.skewness[k] = (weights.array() * x.cube()).sum() / (variance * std::sqrt(variance));
    s.kurtosis[k] = (weights.array() * x.square().square()).sum() / (variance * variance);
    std::copy(points.col(k).begin(), points.col(k).end(), values.begin());
    quantiles.compute(values, w, k_quantile_levels, found);
    for (std::size_t l = 0; l < found.size(); ++l) s.quantiles(k, static_cast<Eigen::Index>(l)) = found[l];
  }
  return s;
}

Eigen::MatrixXd resample(const Eigen::Ref<const Eigen::MatrixXd>& points,
                         const Eigen::Ref<const Eigen::VectorXd>& weights, Eigen::Index count,
                         std::uint64_t seed) {
  std::vector<Eigen::Index> chosen = numerics::equal_draws(weights, count);
  std::mt19937_64 random(seed);
  // Not std::shuffle, whose order is the library's affair.
  for (std::size_t k = chosen.size(); k > 1; --k) std::swap(chosen[k - 1], chosen[random() % k]);
  return points(chosen, Eigen::all);
}

}  // namespace knothe::inference
