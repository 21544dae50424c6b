#include "knothe/posterior/draws/adaptive_importance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/posterior/draws/importance_proposal.hpp"
#include "knothe/posterior/draws/mixture.hpp"
#include "knothe/posterior/draws/tempered_particles.hpp"

namespace knothe::posterior {
namespace {

/// Degrees of freedom of the mixture drawn from, the share of the draws that come from a mixture fitted to
/// the flattened target, and its β in ρ^{1−β} π̄^β.
constexpr double k_tails = 4, k_flat_share = 0.2, k_flat = 0.5;
/// Points that a fit looks at.
constexpr Eigen::Index k_fit_points = 2048;
/// Weight of the particles in it.
constexpr double k_particles_share = 0.5;
/// Effective share of the draws below which a mixture is too bad a fit for its weights to tell their own
/// error.
constexpr double k_min_share = 0.05;
/// Where target and mixture differ by more than this factor the mixture is too thin; and the share of the
/// particles, beyond that of the draws, that may stand there.
constexpr double k_too_thin = 5, k_thin_share = 0.005;

WeightedPoints equally_weighted(const Eigen::MatrixXd& points) {
  return {points, Eigen::VectorXd::Constant(points.rows(), 1.0 / points.rows())};
}

/// What a fit looks at: every N-th of the draws, with weights none of which is worth more than √n, and the
/// particles, which also stand where no draw has been.
void choose_fit_points(const WeightedSample& sample, const Eigen::MatrixXd& particles,
                       WeightedPoints& fitted) {
  auto& [points, weights] = fitted;
  const Eigen::Index n = sample.points.rows(), stride = (n + k_fit_points - 1) / k_fit_points;
  const Eigen::Index kept = (n + stride - 1) / stride;
  const Eigen::Index particles_stride = (particles.rows() + k_fit_points - 1) / k_fit_points;
  const Eigen::Index particles_kept = (particles.rows() + particles_stride - 1) / particles_stride;
  points.resize(kept + particles_kept, particles.cols());
  weights.resize(points.rows());
  const double largest = 1 / std::sqrt(n);
  for (Eigen::Index i = 0; i < kept; ++i) {
    points.row(i) = sample.points.row(i * stride);
    weights[i] = std::min(largest, sample.weights[i * stride]);
  }
  for (Eigen::Index i = 0; i < particles_kept; ++i)
    points.row(kept + i) = particles.row(i * particles_stride);
  weights.head(kept) *= (1 - k_particles_share) / weights.head(kept).sum();
  weights.tail(particles_kept).setConstant(k_particles_share / particles_kept);
}

/// Draws from the mixture, weighted by the target; both are asked for few at a time, in the fastest memory.
void draw(CheckedDensity& target, const MixtureProduct& mixture, Eigen::Index n, RandomNumbers& random,
          WeightedSample& sample) {
  constexpr Eigen::Index k_block = 512;
  mixture.sample(n, random, sample.points);
  sample.weights.resize(n);
  Eigen::VectorXd log_proposal;
  LogDensityBatch batch;
  for (Eigen::Index begin = 0; begin < n; begin += k_block) {
    const Eigen::Index size = std::min(k_block, n - begin);
    const auto points = sample.points.middleRows(begin, size);
    mixture.log_density(points, log_proposal);
    target.evaluate(points, 0, batch);
    sample.weights.segment(begin, size) = batch.value - log_proposal;
  }
  const double largest = sample.weights.maxCoeff();
  sample.weights = (sample.weights.array() - largest).exp().matrix();
  const double sum = sample.weights.sum();
  sample.weights /= sum;
  sample.state_evidence(largest + std::log(sum / n));
}

/// The share of the particles, beyond that of the weighted draws, at places where the mixture has far too
/// little: mass that the draws have missed, of which their weights know nothing.
double missed_share(const MixtureProduct& mixture, const TemperedParticles& particles,
                    const WeightedSample& sample) {
  Eigen::VectorXd log_proposal;
  mixture.log_density(particles.points(), log_proposal);
  const double threshold = std::log(k_too_thin) + sample.log_evidence;
  const double thin = ((particles.log_target() - log_proposal).array() > threshold).count();
  const double of_draws =
      (sample.weights.array() > k_too_thin / sample.weights.size()).select(sample.weights, 0).sum();
  return thin / (particles.points().rows()) - of_draws;
}

/// The draws of several rounds. Each round's are weighted among themselves, and the rounds by how many draws
/// they are worth.
class Pool {
 public:
  explicit Pool(const AdaptiveImportanceOptions& options) : options_(options) {}

  void add(const WeightedSample& round, AdaptiveImportanceResult& r) {
    const double before = r.sample.effective_size,
                 share = round.effective_size / (before + round.effective_size);
    const Eigen::Index old = r.sample.points.rows(), n = old + round.points.rows(), d = round.points.cols();
    next_ = round.points;
    if (options_.variables) options_.variables(next_);
    r.sample.points.conservativeResize(n, d);
    r.sample.points.bottomRows(n - old) = round.points;
    variables_.conservativeResize(n, d);
    variables_.bottomRows(n - old) = next_;
    r.sample.weights.conservativeResize(n);
    r.sample.weights.head(old) *= 1 - share;
    r.sample.weights.tail(n - old) = share * round.weights;
    r.sample.effective_size = 1 / r.sample.weights.squaredNorm();
    r.sample.log_evidence =
        old == 0 ? round.log_evidence
                 : r.sample.log_evidence +
                       std::log1p(share * std::expm1(round.log_evidence - r.sample.log_evidence));
    r.sample.log_evidence_error =
        std::hypot((1 - share) * r.sample.log_evidence_error, share * round.log_evidence_error);
    r.sample.has_evidence = true;
    r.state_errors(variables_);
    r.converged = r.converged && r.sample.effective_size >= k_min_share * r.sample.weights.size();
  }

 private:
  const AdaptiveImportanceOptions& options_;
  Eigen::MatrixXd variables_, next_;
};

}  // namespace

AdaptiveImportanceResult adaptive_importance(LogDensity& user_target,
                                             const AdaptiveImportanceOptions& options) {
  CheckedDensity target(user_target);
  const Mixture start = Mixture::standard_normal(target.dimension());
  RandomNumbers random(options.seed);
  AdaptiveImportanceResult result;
  WeightedSample sample;
  WeightedPoints fitted;
  Pool pool(options);
  for (int attempt = 0; attempt < options.attempts && !result.converged; ++attempt) {
    TemperingOptions tempering;
    tempering.particles = options.particles << (2 * attempt);
    tempering.max_moves = options.max_moves << attempt;
    tempering.seed = options.seed;
    tempering.kept = k_flat;
    TemperedParticles particles(target, start, tempering);
    particles.run();
    ImportanceProposal proposal(k_tails, {k_flat_share});
    fitted = equally_weighted(particles.points());
    const WeightedPoints flattened = equally_weighted(particles.points_at_kept());
    for (int round = 0; round < options.max_rounds && !result.is_done(); ++round) {
      proposal.fit(dependent_groups({particles.points(), flattened.points}), fitted, flattened);
      result.components = proposal.components();
      const MixtureProduct mixture = proposal.mixtures();
      draw(target, mixture, std::min(options.max_draws, options.first_draws << round), random, sample);
      particles.go_on(2 * options.max_moves);
      result.missed = missed_share(mixture, particles, sample);
      if (result.missed <= k_thin_share) pool.add(sample, result);
      choose_fit_points(sample, particles.points(), fitted);
    }
  }
  if (result.sample.points.rows() == 0) pool.add(sample, result), result.converged = false;
  result.sample.density_evaluations = target.evaluations();
  return result;
}

}  // namespace knothe::posterior
