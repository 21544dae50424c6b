#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/solve/map_solver_workspace.hpp"

namespace knothe::posterior {

namespace {

/// Normalised weights, effective sample size and evidence from log-weights.
void normalise(const Eigen::VectorXd& log_weight, ImportanceCorrection& c) {
  const double n = log_weight.size(), top = log_weight.maxCoeff();
  c.weights = (log_weight.array() - top).exp();
  const double sum = c.weights.sum();
  c.ess = sum * sum / (n * c.weights.squaredNorm());
  c.log_evidence = top + std::log(sum / n);
  c.log_evidence_error = std::sqrt(std::max(0.0, 1 / c.ess - 1) / n);
  c.weights /= sum;
}

}  // namespace

ImportanceCorrection MapSolver::correct(LogDensity& target, const MapResult& result) {
  ImportanceCorrection correction;
  correct(target, result, correction);
  return correction;
}

void MapSolver::correct(LogDensity& user_target, const MapResult& result, ImportanceCorrection& c) {
  Workspace& work = *work_;
  CheckedDensity target(user_target);
  normalise(result.verification.log_weight, c);
  const MappedPoints* used = &result.verification;
  Index n = result.verification.points.rows();
  // More points where weights are uneven, and where a high order was needed and did not suffice: such a
  // target is strongly bent, its outer quantiles want more points than the moments do, and a map too thin in
  // some tail shows only by rare, heavy weights. Hence half of the further points are spread wider than the
  // reference (a defensive mixture, Hesterberg 1995), which bounds the weights there. The effective sample
  // size stays that of the reference alone: it tells about the map.
  double ess = c.ess;
  if ((ess < work.options.wanted_ess || (result.order > 4 && !result.tolerance_reached)) &&
      4 * n <= work.options.max_points) {
    n *= ess < 0.98 && 16 * n <= work.options.max_points ? 16 : ess < work.options.wanted_ess ? 4 : 2;
    MapShape& shape = work.shapes.of(result.map);
    work.weigh(target, result.pre_map, shape, result.map.coefficients(), n, work.more_points, true);
    used = &work.more_points;
    normalise(used->log_weight, c);
    // Weights against the reference alone, on its own half of the points: mixture weight × mixture density /
    // ρ.
    const Index half = n / 2;
    const auto& x = used->reference;
    const auto& tables = work.shapes.verification_tables(shape, n, true);
    work.scratch = used->log_weight.head(half) + tables.log_reference.head(half) -
                   standard_normal_log_density(x.topRows(half));
    ess = numerics::effective_share(work.scratch);
  }
  c.ess = ess;
  c.points = used->points;
  numerics::mean_and_covariance(c.points, c.weights, c.mean, c.covariance);
  numerics::weighted_quantiles(c.points, c.weights, work.quantiles, c.quantiles);
  c.map_log_evidence = result.map_log_evidence();
  c.density_evaluations = target.evaluations();
  c.trust =
      trust_of(MapFigures{result.verified_diagnostic, c.ess, result.second_mode_found, result.missed.reason});
}

}  // namespace knothe::posterior
