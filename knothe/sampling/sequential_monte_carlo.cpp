#include "knothe/sampling/sequential_monte_carlo.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/sampling/tempered_particles.hpp"

namespace knothe::sampling {

SequentialMonteCarloResult sequential_monte_carlo(LogDensity& user_target,
                                                  const SequentialMonteCarloOptions& options) {
  const Eigen::Index d = user_target.dimension();
  if (d < 1) throw UsageError(fmt::format("smc: a density in {} dimensions", d));
  if (options.particles < 16)
    throw UsageError(fmt::format("smc: {} particles; at least 16 are needed", options.particles));
  if (!(options.initial_spread > 0))
    throw UsageError(fmt::format("smc: the initial spread {} is not positive", options.initial_spread));
  if (options.centre.size() != 0 && options.centre.size() != d)
    throw UsageError(
        fmt::format("smc: the centre has {} coordinates, the density {}", options.centre.size(), d));
  CheckedDensity target(user_target);
  const Eigen::VectorXd centre = options.centre.size() == d ? options.centre : Eigen::VectorXd::Zero(d);
  const Mixture start({{1.0, centre, options.initial_spread * Eigen::MatrixXd::Identity(d, d)}});
  TemperingOptions tempering;
  tempering.particles = options.particles;
  tempering.ess_share = options.ess_share;
  tempering.max_moves = options.max_moves;
  tempering.seed = options.seed;
  tempering.progress = options.progress;
  TemperedParticles particles(target, start, tempering);
  particles.run();
  SequentialMonteCarloResult result;
  WeightedSample& sample = result.sample;
  sample.points = particles.points();
  const Eigen::Index n = sample.points.rows();
  sample.weights = Eigen::VectorXd::Constant(n, 1.0 / static_cast<double>(n));
  sample.effective_size = particles.effective_size();
  sample.log_evidence = particles.log_evidence();
  sample.log_evidence_error = particles.log_evidence_error();
  sample.has_evidence = true;
  sample.density_evaluations = target.evaluations();
  result.temperatures = particles.temperatures();
  result.acceptance = particles.acceptance();
  return result;
}

}  // namespace knothe::sampling
