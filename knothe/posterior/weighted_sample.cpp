#include "knothe/posterior/weighted_sample.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior {

namespace {

void require_weights(const WeightedSample& sample) {
  if (sample.points.rows() == 0 || sample.points.rows() != sample.weights.size())
    throw UsageError(fmt::format("weighted sample: {} points and {} weights; there must be as many, and some",
                                 sample.points.rows(), sample.weights.size()));
  if (!(sample.weights.sum() > 0) || !(sample.weights.minCoeff() >= 0))
    throw UsageError("weighted sample: weights must be non-negative, with a positive sum");
}

}  // namespace

void WeightedSample::state_evidence(double log_evidence_of_weights) {
  effective_size = 1 / weights.squaredNorm();
  log_evidence = log_evidence_of_weights;
  log_evidence_error = std::sqrt(std::max(0.0, 1 / effective_size - 1.0 / weights.size()));
  has_evidence = true;
}

void ImportanceResult::state_errors(const Eigen::MatrixXd& variables, double tail) {
  state_errors(standard_errors(variables, sample.weights), tail);
}

void ImportanceResult::state_errors(const MomentErrors& errors, double tail) {
  constexpr double k_finite_fourth_moment = 0.25, k_raised = 2;
  tail_shape = tail;
  mean_error = 4 * errors.mean;
  deviation_error = 4 * errors.deviation * (1 + k_raised * std::max(0.0, tail - k_finite_fourth_moment));
  converged = mean_error <= k_mean_tolerance && deviation_error <= k_deviation_tolerance;
}

double tail_shape_of(const Eigen::MatrixXd& variables, const Eigen::VectorXd& weights) {
  constexpr double k_tail = 2e-3;
  constexpr std::ptrdiff_t k_min_points = 20;
  double shape = 0;
  std::vector<std::pair<double, double>> all(weights.size());  // distance from the mean, weight
  for (Eigen::Index k = 0; k < variables.cols(); ++k) {
    const double mean = variables.col(k).dot(weights);
    for (const double side : {1.0, -1.0}) {
      for (std::size_t i = 0; i < all.size(); ++i) all[i] = {side * (variables(i, k) - mean), weights[i]};
      // Few of them are the tail: the outermost are put in order, more and more of them.
      double mass = 0;
      auto last = all.begin(), sorted = all.begin();
      while (last != all.end() && mass < k_tail) {
        if (last == sorted) {
          const auto more = std::max<std::ptrdiff_t>(64, 2 * (sorted - all.begin()));
          sorted += std::min(more, all.end() - sorted);
          std::partial_sort(last, sorted, all.end(), std::greater<>());
        }
        mass += (last++)->second;
      }
      if (last - all.begin() < k_min_points || last == all.end()) continue;
      if (last == sorted) std::nth_element(last, last, all.end(), std::greater<>());
      const double end = last->first;
      if (!(end > 0)) continue;
      double sum = 0;
      for (auto i = all.begin(); i != last; ++i) sum += i->second * std::log(i->first / end);
      shape = std::max(shape, sum / mass);
    }
  }
  return shape;
}

bool ImportanceResult::is_done(double share) const {
  return converged && is_within(share);
}

Eigen::VectorXd mean_of(const WeightedSample& sample) {
  require_weights(sample);
  return numerics::moments_of(sample.points, sample.weights).mean;
}

Eigen::MatrixXd covariance_of(const WeightedSample& sample) {
  require_weights(sample);
  return numerics::moments_of(sample.points, sample.weights).covariance;
}

MomentErrors standard_errors(const Eigen::MatrixXd& variables, const Eigen::VectorXd& weights) {
  MomentErrors squared;
  for (Eigen::Index k = 0; k < variables.cols(); ++k) {
    const auto x = variables.col(k).array();
    const double mean = x.matrix().dot(weights), variance = (weights.array() * (x - mean).square()).sum();
    if (!(variance > 0)) continue;
    squared.mean = std::max(squared.mean, (weights.array() * (x - mean)).square().sum() / variance);
    squared.deviation = std::max(
        squared.deviation, 0.25 * (weights.array() * ((x - mean).square() / variance - 1)).square().sum());
  }
  return {std::sqrt(squared.mean), std::sqrt(squared.deviation)};
}

void thin(Eigen::MatrixXd& points, Eigen::VectorXd& weights, Eigen::Index count, std::uint64_t seed) {
  const Eigen::Index n = weights.size();
  if (n <= count) return;
  // c with Σ min(1, w/c) = count: the k heaviest are above it, the others share what is left.
  std::vector<double> sorted(weights.begin(), weights.end());
  std::sort(sorted.begin(), sorted.end(), std::greater<>());
  double rest = weights.sum(), limit = 0;
  for (Eigen::Index k = 0; k < count; ++k) {
    limit = rest / (count - k);
    const double heaviest = sorted[k];
    if (heaviest <= limit) break;
    rest -= heaviest;
  }
  std::vector<Eigen::Index> kept;
  double cumulative = RandomNumbers(seed).uniform() * limit;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (weights[i] > limit) {
      kept.push_back(i);
      continue;
    }
    cumulative += weights[i];
    if (cumulative < limit) continue;
    cumulative -= limit;
    weights[i] = limit;
    kept.push_back(i);
  }
  points = points(kept, Eigen::all).eval();
  weights = weights(kept).eval();
  weights /= weights.sum();
}

void sort_along_curve(Eigen::MatrixXd& points, Eigen::VectorXd& weights) {
  const Eigen::Index n = points.rows(), d = points.cols(), bits = std::min<Eigen::Index>(64 / d, 16);
  const Eigen::RowVectorXd mean = weights.transpose() * points;
  const Eigen::RowVectorXd spread =
      (weights.transpose() * (points.rowwise() - mean).cwiseAbs2()).cwiseSqrt().cwiseMax(1e-300);
  std::vector<std::pair<std::uint64_t, Eigen::Index>> keys(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    std::uint64_t key = 0;
    for (Eigen::Index k = 0; k < d; ++k) {
      const double t = (points(i, k) - mean[k]) / spread[k];
      const double place = 0.5 * (1 + t / (1 + std::abs(t)));  // in [0, 1]
      const auto cell = static_cast<std::uint64_t>(std::min(place, 0.9999999) * std::exp2(bits));
      for (Eigen::Index b = 0; b < bits; ++b) key |= (cell >> b & 1U) << (b * d + k);
    }
    keys[i] = {key, i};
  }
  std::sort(keys.begin(), keys.end());
  std::vector<Eigen::Index> order;
  order.reserve(keys.size());
  for (const auto& [key, i] : keys) order.push_back(i);
  points = points(order, Eigen::all).eval();
  weights = weights(order).eval();
}

}  // namespace knothe::posterior
