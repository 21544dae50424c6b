#include "knothe/transport/diagnose/map_evidence.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/sampling/checked_density.hpp"
#include "knothe/transport/map/pull_back.hpp"

namespace knothe::transport {

namespace {

/// log π̄(T(x)) + log|det ∇T(x)| − log ρ(x).
WeightedPoints weigh(const ComposedMap& map, sampling::CheckedDensity& target, Eigen::MatrixXd reference) {
  WeightedPoints result;
  MapTrace trace;
  trace.evaluate(map, reference, false);
  if (!trace.value().allFinite())
    throw NumericalError("transport map: the image of a point is not finite; scale the parameters");
  sampling::LogDensityBatch batch;
  target.evaluate(trace.value(), 0, batch);
  result.log_weight = batch.value + trace.log_determinant() - standard_normal_log_density(reference);
  result.points = trace.value();
  result.reference = std::move(reference);
  return result;
}

void require(const ComposedMap& map, const sampling::LogDensity& target, Eigen::Index points) {
  if (map.dimension() != target.dimension())
    throw UsageError(
        fmt::format("a map in {} variables for a density in {}: give the density it was made for",
                    map.dimension(), target.dimension()));
  if (points < 16) throw UsageError(fmt::format("weighting {} points: at least 16 are needed", points));
}

}  // namespace

Eigen::VectorXd normalised_weights(const Eigen::VectorXd& log_weight, double* ess) {
  const double top = log_weight.maxCoeff();
  if (!std::isfinite(top))
    throw NumericalError(
        "importance weights: the density is zero at every image of the map; the map misses its support");
  Eigen::VectorXd w = (log_weight.array() - top).exp();
  const double sum = w.sum();
  if (ess) *ess = sum * sum / (static_cast<double>(w.size()) * w.squaredNorm());
  w /= sum;
  return w;
}

WeightedPoints weighted_points(const ComposedMap& map, sampling::LogDensity& target, Eigen::Index n,
                               std::uint64_t seed) {
  require(map, target, n);
  sampling::CheckedDensity checked(target);
  Eigen::MatrixXd reference = numerics::sobol_normal_points(n, map.dimension(), seed);
  if (n > map.dimension()) numerics::match_standard_moments(reference);
  return weigh(map, checked, std::move(reference));
}

EvidenceEstimate estimate_evidence(const ComposedMap& map, sampling::LogDensity& target,
                                   const EvidenceOptions& options) {
  require(map, target, options.points);
  if (options.replicates < 2)
    throw UsageError(
        fmt::format("evidence: {} replicates; an error bar needs at least 2", options.replicates));
  sampling::CheckedDensity checked(target);
  const Eigen::Index n = options.points, m = options.replicates;
  Eigen::VectorXd log_weight(n * m);
  for (Eigen::Index r = 0; r < m; ++r)  // odd multiples of a large number: seeds far apart, never 0
    log_weight.segment(r * n, n) =
        weigh(map, checked,
              numerics::sobol_normal_points(
                  n, map.dimension(),
                  options.seed + 0x9e3779b97f4a7c15ULL * static_cast<std::uint64_t>(2 * r + 1)))
            .log_weight;
  const double top = log_weight.maxCoeff();
  EvidenceEstimate e;
  (void)normalised_weights(log_weight, &e.ess);
  const Eigen::ArrayXd clipped = log_weight.array().max(top - 1000),
                       weight = (log_weight.array() - top).exp();
  Eigen::ArrayXd objective(m), evidence(m);
  for (Eigen::Index r = 0; r < m; ++r) {
    objective[r] = clipped.segment(r * n, n).mean();
    evidence[r] = weight.segment(r * n, n).mean();
  }
  const auto standard_error = [m](const Eigen::ArrayXd& x) {
    return std::sqrt((x - x.mean()).square().sum() / static_cast<double>(m * (m - 1)));
  };
  e.map_log_evidence = objective.mean();
  e.map_log_evidence_error = standard_error(objective);
  e.log_evidence = top + std::log(evidence.mean());
  e.log_evidence_error = standard_error(evidence) / evidence.mean();
  e.diagnostic = 0.5 * (clipped - clipped.mean()).square().mean();
  e.density_evaluations = checked.evaluations();
  return e;
}

}  // namespace knothe::transport
