#include "knothe/transport/extras/metropolis_correction.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/sampling/chain_statistics.hpp"
#include "knothe/sampling/checked_density.hpp"
#include "knothe/transport/map/pull_back.hpp"

namespace knothe::transport {

namespace {

void require(const ComposedMap& map, const sampling::LogDensity& target,
             const MetropolisCorrectionOptions& o) {
  if (map.dimension() != target.dimension())
    throw UsageError(
        fmt::format("Metropolis correction: a map in {} variables for a density in {}: give the density it "
                    "was made for",
                    map.dimension(), target.dimension()));
  if (o.chains < 1 || o.samples < 4 * o.chains || o.warm_up < 0 || o.batch < 1)
    throw UsageError(
        fmt::format("Metropolis correction: {} samples of {} chains, warm-up {}, batches of {}; at least one "
                    "chain, four samples a chain and batches of one are needed",
                    o.samples, o.chains, o.warm_up, o.batch));
}

/// log w of all proposals, x (n × d), with z.
Eigen::VectorXd weigh(const ComposedMap& map, sampling::LogDensity& target, const Eigen::MatrixXd& x,
                      const MetropolisCorrectionOptions& options, MetropolisCorrectionResult& result,
                      Eigen::MatrixXd& z) {
  sampling::CheckedDensity checked(target);
  sampling::LogDensityBatch batch;
  MapTrace trace;
  Eigen::VectorXd log_weight(x.rows());
  z.resize(x.rows(), x.cols());
  for (Eigen::Index begin = 0; begin < x.rows(); begin += options.batch) {
    const Eigen::Index count = std::min(options.batch, x.rows() - begin);
    trace.evaluate(map, x.middleRows(begin, count), false);
    if (!trace.value().allFinite())
      throw NumericalError("Metropolis correction: a proposal is not finite; scale the parameters");
    checked.evaluate(trace.value(), 0, batch);
    z.middleRows(begin, count) = trace.value();
    log_weight.segment(begin, count) =
        batch.value + trace.log_determinant() - standard_normal_log_density(x.middleRows(begin, count));
    if (options.progress &&
        !options.progress(static_cast<double>(begin + count) / static_cast<double>(x.rows())))
      throw Interrupted("Metropolis correction: interrupted");
  }
  result.density_evaluations = checked.evaluations();
  if (log_weight.maxCoeff() == -std::numeric_limits<double>::infinity())
    throw NumericalError(
        "Metropolis correction: the density is zero at every proposal; the map misses its support");
  return log_weight;
}

}  // namespace

MetropolisCorrectionResult metropolis_correction(const ComposedMap& map, sampling::LogDensity& target,
                                                 const MetropolisCorrectionOptions& options) {
  require(map, target, options);
  const Eigen::Index d = map.dimension(), chains = options.chains;
  const Eigen::Index kept = (options.samples + chains - 1) / chains, length = options.warm_up + kept;
  MetropolisCorrectionResult result;
  const Eigen::MatrixXd x = numerics::monte_carlo_normal_points(chains * length, d, options.seed);
  Eigen::MatrixXd z;
  const Eigen::VectorXd log_weight = weigh(map, target, x, options, result, z);

  result.chains = options.chains;
  result.points.resize(chains * kept, d);
  result.reference.resize(chains * kept, d);
  const Eigen::VectorXd uniform =
      numerics::monte_carlo_points(chains * length, 1, options.seed ^ 0x6d6574726f706f6cULL);
  Eigen::Index accepted = 0;
  for (Eigen::Index c = 0; c < chains; ++c) {
    Eigen::Index at = c * length, stay = 0;
    for (Eigen::Index i = 0; i < length; ++i) {
      const Eigen::Index proposal = c * length + i;
      // From a point of no density every proposal is accepted.
      const bool accept = proposal == at || !std::isfinite(log_weight[at]) ||
                          std::log(uniform[proposal]) < log_weight[proposal] - log_weight[at];
      if (accept) at = proposal;
      if (i < options.warm_up) continue;
      stay = accept ? 1 : stay + 1;
      accepted += accept ? 1 : 0;
      result.longest_stay = std::max(result.longest_stay, stay);
      result.points.row(c * kept + i - options.warm_up) = z.row(at);
      result.reference.row(c * kept + i - options.warm_up) = x.row(at);
    }
  }
  result.acceptance = static_cast<double>(accepted) / static_cast<double>(chains * kept);
  result.r_hat.resize(d), result.effective_sizes.resize(d);
  for (Eigen::Index k = 0; k < d; ++k) {
    const Eigen::MatrixXd draws =
        Eigen::Map<const Eigen::MatrixXd>(result.points.col(k).data(), kept, chains);
    result.r_hat[k] = sampling::split_r_hat(draws);
    result.effective_sizes[k] = sampling::effective_sample_size(draws);
  }
  result.converged = result.r_hat.maxCoeff() <= 1.01 && result.effective_sizes.minCoeff() >= 400;
  return result;
}

}  // namespace knothe::transport
