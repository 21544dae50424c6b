#include "knothe/posterior/map/samples/sample_map.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/optimise/trust_region.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/map/samples/map_distribution.hpp"
#include "knothe/posterior/map/samples/sample_objective.hpp"

namespace knothe::posterior {

namespace {

constexpr double k_regularisation = 1e-6;  ///< λ: keeps terms that the samples do not support near zero
constexpr int k_max_iterations = 100;      ///< of Newton's method, per component and fit

void require(const Eigen::Ref<const Eigen::MatrixXd>& samples, const SampleMapOptions& o) {
  const Index n = samples.rows(), d = samples.cols();
  if (n < 2 || d < 1) throw UsageError(fmt::format("map from samples: {} samples of {} coordinates", n, d));
  if (o.max_order < 1 || o.max_order > k_max_order)
    throw UsageError(fmt::format("map from samples: orders 1 to {} asked for; they must lie in 1 … {}",
                                 o.max_order, k_max_order));
  if (o.folds < 0 || o.folds == 1 || o.folds > n)
    throw UsageError(fmt::format(
        "map from samples: {} folds; 0 (none) or 2 to the number of samples are possible", o.folds));
  for (Index k = 0; k < d; ++k)
    for (Index i = 0; i < n; ++i)
      if (!std::isfinite(samples(i, k)))
        throw DataError(fmt::format("map from samples: sample {}, coordinate {} is {}; remove or correct it",
                                    i, k, samples(i, k)));
}

/// x ↦ L⁻¹ (x − mean).
AffineMap standardise(const Eigen::Ref<const Eigen::MatrixXd>& samples, const Eigen::VectorXd& weights) {
  const numerics::Moments moments = numerics::moments_of(samples, weights);
  const Index d = samples.cols();
  const Eigen::VectorXd std = moments.covariance.diagonal().cwiseSqrt();
  for (Index k = 0; k < d; ++k)
    if (!(std[k] > 1e-14 * std::abs(moments.mean[k])))
      throw DataError(
          fmt::format("map from samples: coordinate {} has no spread, it is {} in all samples; leave it out",
                      k, moments.mean[k]));
  const Eigen::MatrixXd correlation =
      std.cwiseInverse().asDiagonal() * moments.covariance * std.cwiseInverse().asDiagonal();
  const Eigen::LLT<Eigen::MatrixXd> factor(correlation);
  if (factor.info() != Eigen::Success || factor.matrixL().toDenseMatrix().diagonal().minCoeff() < 1e-7)
    throw DataError(
        "map from samples: the covariance of the samples is singular; leave out coordinates that follow "
        "from others, or give more samples");
  const Eigen::MatrixXd lower = std.asDiagonal() * factor.matrixL().toDenseMatrix();
  AffineMap map{Eigen::VectorXd::Zero(d),
                lower.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd::Identity(d, d))};
  map.shift = -map.lower * moments.mean;
  return map;
}

/// Fits of one component, of increasing order.
class ComponentFit {
 public:
  ComponentFit(Index k, const Eigen::MatrixXd& y, const Eigen::VectorXd& weights,
               const SampleMapOptions& options, const std::vector<int>& fold)
      : k_(k), y_(y), weights_(weights), options_(options), fold_(fold) {}

  void run(const std::vector<TriangularMap>& families) {
    double best = std::numeric_limits<double>::infinity();
    int worse = 0;
    for (int order = options_.folds > 0 ? 1 : options_.max_order; order <= options_.max_order && worse < 2;
         ++order) {
      const TriangularMap& family = families[order];
      const Index count = family.component(k_).constant_count() + family.component(k_).monotone_count();
      const double samples = y_.rows();
      if (count > (options_.folds > 1 ? 1 - 1.0 / options_.folds : 1.0) * samples) {
        if (std::isinf(best))
          throw DataError(
              fmt::format("map from samples: component {} of order {} has {} coefficients, but there are "
                          "{:.0f} samples; lower the order or give more samples",
                          k_, order, count, samples));
        break;
      }
      SampleObjective objective(family, k_, y_, k_regularisation);
      if (options_.folds == 0) {
        finish(objective, order);
        return;
      }
      const double loss = weights_.dot(cross_validate(objective));
      worse = loss < best ? 0 : worse + 1;
      if (loss >= best) continue;
      best = loss;
      chosen = order;
    }
    SampleObjective objective(families[chosen], k_, y_, k_regularisation);
    finish(objective, chosen);
  }

  int chosen = 0;
  Eigen::VectorXd coefficients;  ///< a_c, a_e
  numerics::MinimiserSummary summary;

 private:
  numerics::MinimiserSummary fit(SampleObjective& objective, Eigen::VectorXd& a) {
    a = objective.affine_start();
    numerics::TrustRegionOptions newton;
    newton.max_iterations = k_max_iterations;
    newton.decrease_tolerance = 1e-10;
    newton.gradient_tolerance = 1e-9;
    return numerics::NewtonTrustRegion().minimise(objective, newton, a);
  }

  /// The loss at each sample, of the fit that did not see it.
  Eigen::VectorXd cross_validate(SampleObjective& objective) {
    Eigen::VectorXd result(weights_.size()), a;
    for (int f = 0; f < options_.folds; ++f) {
      check_cancellation("the map of samples is not finished");
      Eigen::VectorXd training = weights_;
      for (Index i = 0; i < training.size(); ++i)
        if (fold_[i] == f) training[i] = 0;
      objective.set_weights(training / training.sum());
      (void)fit(objective, a);
      const Eigen::VectorXd losses = objective.losses(a);
      for (Index i = 0; i < losses.size(); ++i)
        if (fold_[i] == f) result[i] = losses[i];
    }
    return result;
  }

  void finish(SampleObjective& objective, int order) {
    objective.set_weights(weights_);
    summary = fit(objective, coefficients);
    chosen = order;
  }

  Index k_;
  const Eigen::MatrixXd& y_;
  const Eigen::VectorXd& weights_;
  const SampleMapOptions& options_;
  const std::vector<int>& fold_;
};

std::vector<int> shuffled_folds(Index n, int folds, std::uint64_t seed) {
  std::vector<int> fold(n, 0);
  if (folds == 0) return fold;
  const Eigen::VectorXd key = numerics::monte_carlo_points(n, 1, seed);
  std::vector<Index> order(fold.size());
  std::iota(order.begin(), order.end(), Index{0});
  std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return key[a] < key[b]; });
  for (Index r = 0; r < std::ssize(order); ++r) fold[order[r]] = r % folds;
  return fold;
}

}  // namespace

SampleMap map_from_samples(const Eigen::Ref<const Eigen::MatrixXd>& samples,
                           const SampleMapOptions& options) {
  require(samples, options);
  const Index n = samples.rows(), d = samples.cols();
  const Eigen::VectorXd w = Eigen::VectorXd::Constant(n, 1.0 / n);
  std::vector<TriangularMap> families(options.max_order + 1);
  for (int order = 1; order <= options.max_order; ++order)
    families[order] = TriangularMap(total_order_map(d, order, {Rectifier::softplus, {}}));
  const AffineMap affine = standardise(samples, w);
  MapBatch standardised;
  affine.evaluate(samples, 0, standardised);
  const std::vector<int> fold = shuffled_folds(n, options.folds, options.seed);

  SampleMap result;
  result.converged = true;
  MapSpecification specification;
  specification.parametrisation = families.back().parametrisation();
  Eigen::VectorXd coefficients(0);
  for (Index k = 0; k < d; ++k) {
    ComponentFit fit(k, standardised.value, w, options, fold);
    fit.run(families);
    specification.components.push_back(families[fit.chosen].specification().components[k]);
    coefficients.conservativeResize(coefficients.size() + fit.coefficients.size());
    coefficients.tail(fit.coefficients.size()) = fit.coefficients;
    result.orders.push_back(fit.chosen);
    if (!fit.summary.converged() && fit.summary.gradient_norm > 1e-4) {
      result.converged = false;
      result.reason +=
          fmt::format("{}component {}: the minimiser stopped with {}", result.reason.empty() ? "" : "; ", k,
                      numerics::describe(fit.summary.termination));
    }
  }
  TriangularMap map(std::move(specification));
  map.set_coefficients(coefficients);
  result.map = ComposedMap(d);
  result.map.append(std::move(map));
  result.map.append(affine);
  return result;
}

Eigen::VectorXd SampleMap::log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  MapBatch batch;
  map.evaluate(z, 0, batch);
  return standard_normal_log_density(batch.value) + batch.log_determinant;
}

Eigen::MatrixXd SampleMap::conditional_reference(const Eigen::VectorXd& given, Index n,
                                                 std::uint64_t seed) const {
  const Index m = given.size(), d = dimension();
  if (m == 0) return numerics::monte_carlo_normal_points(n, d, seed);
  if (m > d || !given.allFinite())
    throw UsageError(
        fmt::format("conditional samples: {} values given, finite ones for the first of {} coordinates are "
                    "needed",
                    m, d));
  const Eigen::RowVectorXd leading = MapDistribution(map).leading(m).map().evaluate(given.transpose());
  Eigen::MatrixXd reference(n, d);
  reference.leftCols(m) = leading.replicate(n, 1);
  reference.rightCols(d - m) = numerics::monte_carlo_normal_points(n, d - m, seed);
  return reference;
}

}  // namespace knothe::posterior
