#include <cmath>

#include "knothe/transport/map_solver_workspace.hpp"

namespace knothe::transport {

namespace {

/// Normalised weights, effective sample size and evidence from log-weights.
void normalise(const Eigen::VectorXd& log_weight, ImportanceCorrection& c) {
  const double n = static_cast<double>(log_weight.size()), top = log_weight.maxCoeff();
  c.weights = (log_weight.array() - top).exp();
  const double sum = c.weights.sum();
  c.ess = sum * sum / (n * c.weights.squaredNorm());
  c.log_evidence = top + std::log(sum / n);
  c.log_evidence_error = std::sqrt(std::max(0.0, 1 / c.ess - 1) / n);
  c.weights /= sum;
}

void moments(ImportanceCorrection& c) {
  const Eigen::Index d = c.points.cols();
  c.mean.resize(d);
  c.covariance.resize(d, d);
  for (Eigen::Index a = 0; a < d; ++a) c.mean[a] = c.weights.dot(c.points.col(a));
  for (Eigen::Index a = 0; a < d; ++a)
    for (Eigen::Index b = 0; b <= a; ++b)
      c.covariance(a, b) = c.covariance(b, a) =
          (c.weights.array() * (c.points.col(a).array() - c.mean[a]) * (c.points.col(b).array() - c.mean[b]))
              .sum();
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
  const WeightedPoints* used = &result.verification;
  Eigen::Index n = result.verification.points.rows();
  // More points where weights are uneven, and where a high order was needed: such a target is strongly bent,
  // and its outer quantiles want more than the moments do. The Sobol sequence of the same seed goes on: the
  // first points stay the same.
  const auto wanted = [&] {
    return n <= result.verification.points.rows() ? c.ess < work.options.wanted_ess || result.order > 4
                                                  : c.ess < 0.99;
  };
  while (wanted() && 4 * n <= work.options.max_points) {
    n *= 4;
    work.weigh(target, result.pre_map, result.order, result.map.coefficients(), n, work.more_points);
    used = &work.more_points;
    normalise(used->log_weight, c);
  }
  c.points = used->points;
  moments(c);
  const Eigen::Index d = c.points.cols(), levels = static_cast<Eigen::Index>(c.levels.size());
  c.quantiles.resize(d, levels);
  work.scratch.resize(levels);
  for (Eigen::Index a = 0; a < d; ++a) {
    work.quantiles.compute({c.points.col(a).data(), static_cast<std::size_t>(n)},
                           {c.weights.data(), static_cast<std::size_t>(n)}, c.levels,
                           {work.scratch.data(), c.levels.size()});
    c.quantiles.row(a) = work.scratch.transpose();
  }
  c.map_log_evidence = result.map_log_evidence();
  c.density_evaluations = target.evaluations();
  c.trusted = result.verified_diagnostic <= 0.05 && c.ess >= 0.9 && !result.second_mode_found;
}

}  // namespace knothe::transport
