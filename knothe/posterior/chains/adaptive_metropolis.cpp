#include "knothe/posterior/chains/adaptive_metropolis.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/posterior/chains/chain_statistics.hpp"
#include "knothe/posterior/checked_density.hpp"
#include "knothe/posterior/mode_search.hpp"
#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior {

namespace {

/// Shares of the warm-up at which a new covariance is estimated, from the draws since the one before. The
/// rest of it tunes the scale alone.
constexpr std::array k_learning_ends = {0.05, 0.1, 0.2, 0.35, 0.55, 0.85};

void require(const MetropolisOptions& o) {
  if (o.chains < 2)
    throw UsageError(
        fmt::format("mcmc: {} chains; at least 2 are needed to see whether they agree", o.chains));
  if (o.samples < 4 * o.chains)
    throw UsageError(
        fmt::format("mcmc: {} samples for {} chains; at least 4 a chain are needed", o.samples, o.chains));
  if (o.warm_up < 0) throw UsageError(fmt::format("mcmc: a warm-up of {} draws", o.warm_up));
}

/// One kind of step with its scale.
struct Kernel {
  bool uses_gradient = false;
  double log_scale = 0;
  double wanted_acceptance = 0.234;
};

/// Covariance within chains, about each chain's own mean, so that chains in different modes still learn how
/// wide a mode is.
class WithinCovariance {
 public:
  WithinCovariance(Eigen::Index chains, Eigen::Index d) : mean_(chains, d), sum_(d, d) { clear(); }
  void clear() {
    mean_.setZero();
    sum_.setZero();
    draws_ = 0;
  }
  void add(const Eigen::MatrixXd& position) {
    ++draws_;
    const Eigen::MatrixXd before = position - mean_;
    mean_ += before / draws_;
    sum_ += before.transpose() * (position - mean_);
  }
  /// Drawn towards `lower lowerᵀ`, as if that had been seen in 2 d draws more.
  [[nodiscard]] Eigen::MatrixXd lower_with(const Eigen::MatrixXd& lower) const {
    const double prior = 2.0 * sum_.rows();
    const double seen = draws_ * mean_.rows();
    const Eigen::MatrixXd sum = 0.5 * (sum_ + sum_.transpose()) + prior * lower * lower.transpose();
    const Eigen::LLT<Eigen::MatrixXd> factor(sum / (seen + prior));
    return factor.info() == Eigen::Success ? Eigen::MatrixXd(factor.matrixL()) : lower;
  }

 private:
  Eigen::MatrixXd mean_, sum_;
  std::int64_t draws_ = 0;
};

/// All chains and what moves them.
class Chains {
 public:
  Chains(LogDensity& target, const MetropolisOptions& options)
      : target_(target),
        random_(options.seed),
        chains_(options.chains),
        d_(target.dimension()),
        covariance_(chains_, d_) {
    derivatives_ = std::min(1, target.available_derivatives());
    const double d = d_;
    random_walk_ = {false, std::log(2.38 / std::sqrt(d)), d_ == 1 ? 0.44 : d_ < 5 ? 0.35 : 0.234};
    langevin_ = {true, std::log(1.4 / std::pow(d, 1.0 / 6)), 0.574};
    begin();
  }

  /// One step of every chain; `tune` adapts the scale of the step.
  void advance(bool tune);
  void learn() { covariance_.add(position_); }
  void use_learnt() {
    lower_ = covariance_.lower_with(lower_);
    covariance_.clear();
    steps_since_learning_ = 0;
    restrain(gradient_, restrained_);
  }
  [[nodiscard]] const Eigen::MatrixXd& position() const { return position_; }
  [[nodiscard]] double last_acceptance() const { return acceptance_; }
  [[nodiscard]] std::int64_t evaluations() const { return target_.evaluations(); }

 private:
  void begin();
  /// Drift directions Lᵀ∇ log π̄ in whitened coordinates, shortened where they are long: a light tail would
  /// else throw the proposal to the other side (Roberts, Tweedie 1996: truncated MALA).
  void restrain(const Eigen::MatrixXd& gradient, Eigen::MatrixXd& restrained) const;

  CheckedDensity target_;
  RandomNumbers random_;
  Eigen::Index chains_, d_;
  int derivatives_ = 0;
  Kernel random_walk_, langevin_;
  Eigen::MatrixXd lower_;     ///< L of the preconditioner L Lᵀ
  Eigen::MatrixXd position_;  ///< chains × d
  Eigen::VectorXd value_;
  Eigen::MatrixXd gradient_, restrained_, restrained_proposal_;
  LogDensityBatch batch_;
  WithinCovariance covariance_;
  double acceptance_ = 0;
  std::int64_t step_ = 0, steps_since_learning_ = 0;
};

void Chains::begin() {
  std::vector<Mode> modes;
  ModeSearch().run(target_, true, modes);
  // A chain that begins in a mode of no weight would never get out of it.
  constexpr double k_min_share = 1e-3;
  while (modes.size() > 1 && modes.back().log_mass < modes.front().log_mass + std::log(k_min_share))
    modes.pop_back();
  lower_ = modes.front().lower;
  position_.resize(chains_, d_);
  value_ = Eigen::VectorXd::Constant(chains_, -std::numeric_limits<double>::infinity());
  // Twice as wide as the mode; nearer where the density is zero or far too small there.
  double spread = 2;
  for (int attempt = 0; attempt < 30; ++attempt, spread *= 0.7) {
    const Eigen::MatrixXd noise = random_.normals(chains_, d_);
    Eigen::MatrixXd trial = position_;
    for (Eigen::Index c = 0; c < chains_; ++c) {
      const Mode& mode = modes[c % std::ssize(modes)];
      if (!std::isfinite(value_[c]))
        trial.row(c) = (mode.point + (attempt == 29 ? 0 : spread) * mode.lower * noise.row(c).transpose());
    }
    target_.evaluate(trial, derivatives_, batch_);
    for (Eigen::Index c = 0; c < chains_; ++c) {
      const Mode& mode = modes[c % std::ssize(modes)];
      if (batch_.value[c] < mode.value - 20.0 * (1 + d_) && attempt < 29) continue;
      position_.row(c) = trial.row(c);
      value_[c] = batch_.value[c];
    }
    if (value_.allFinite()) break;
  }
  target_.evaluate(position_, derivatives_, batch_);
  value_ = batch_.value;
  if (derivatives_ > 0) gradient_ = batch_.gradient;
  restrain(gradient_, restrained_);
}

void Chains::restrain(const Eigen::MatrixXd& gradient, Eigen::MatrixXd& restrained) const {
  if (derivatives_ == 0) return;
  restrained = gradient * lower_;
  const double longest = 3 * (1 + std::sqrt(d_));
  for (Eigen::Index c = 0; c < restrained.rows(); ++c) {
    const double length = restrained.row(c).stableNorm();
    if (!std::isfinite(length))
      restrained.row(c).setZero();
    else if (length > longest)
      restrained.row(c) *= longest / length;
  }
}

void Chains::advance(bool tune) {
  Kernel& kernel = derivatives_ > 0 && step_ % 4 != 3 ? langevin_ : random_walk_;
  const double scale = std::exp(kernel.log_scale), drift = 0.5 * scale * scale;
  Eigen::MatrixXd move = scale * random_.normals(chains_, d_);
  const Eigen::VectorXd forward = move.rowwise().squaredNorm() / (2 * scale * scale);
  if (kernel.uses_gradient) move += drift * restrained_;
  const Eigen::MatrixXd proposal = position_ + move * lower_.transpose();
  target_.evaluate(proposal, derivatives_, batch_);
  if (derivatives_ > 0) restrain(batch_.gradient, restrained_proposal_);
  acceptance_ = 0;
  for (Eigen::Index c = 0; c < chains_; ++c) {
    double log_ratio = batch_.value[c] - value_[c];
    if (kernel.uses_gradient) {
      const double backward =
          (move.row(c) + drift * restrained_proposal_.row(c)).squaredNorm() / (2 * scale * scale);
      log_ratio += forward[c] - backward;
    }
    acceptance_ += std::exp(std::min(0.0, log_ratio)) / chains_;
    if (std::log(random_.uniform()) >= log_ratio) continue;
    position_.row(c) = proposal.row(c);
    value_[c] = batch_.value[c];
    if (derivatives_ == 0) continue;
    gradient_.row(c) = batch_.gradient.row(c);
    restrained_.row(c) = restrained_proposal_.row(c);
  }
  ++step_;
  ++steps_since_learning_;
  if (tune)  // Robbins and Monro
    kernel.log_scale +=
        2 * std::pow(steps_since_learning_ / 4.0 + 1, -0.6) * (acceptance_ - kernel.wanted_acceptance);
}

void fill_statistics(MetropolisResult& result) {
  const Eigen::Index d = result.sample.points.cols(), chains = result.chains,
                     n = result.sample.points.rows() / chains;
  result.r_hat.resize(d);
  result.effective_sizes.resize(d);
  result.std_errors.resize(d);
  for (Eigen::Index k = 0; k < d; ++k) {
    const Eigen::Map<const Eigen::MatrixXd> draws(result.sample.points.col(k).data(), n, chains);
    result.r_hat[k] = split_r_hat(draws);
    result.effective_sizes[k] = min_effective_size(draws);
    result.std_errors[k] = relative_error_of_deviation(draws);
  }
  result.converged = result.r_hat.maxCoeff() <= 1.01 && result.effective_sizes.minCoeff() >= 400 &&
                     result.std_errors.maxCoeff() <= 0.02;
  result.sample.effective_size =
      std::min<double>(result.effective_sizes.minCoeff(), result.sample.points.rows());
}

}  // namespace

MetropolisResult adaptive_metropolis(LogDensity& target, const MetropolisOptions& options) {
  require(options);
  const Eigen::Index chain_count = options.chains;
  Eigen::Index kept = (options.samples + chain_count - 1) / chain_count;
  Eigen::Index warm_up = options.warm_up > 0 ? options.warm_up : std::max<Eigen::Index>(kept, 1000);
  // Nobody knows whether the chains will have to go on: while they may, the share goes half of the way that
  // is left.
  Eigen::Index stage_begin = 0, planned = warm_up + kept;
  double share_before = 0, share_after = options.max_thinning > 1 ? 0.5 : 1;
  const auto report = [&](Eigen::Index done) {
    const double steps = planned - stage_begin, of_stage = (done - stage_begin) / steps;
    if (options.progress && !options.progress(share_before + of_stage * (share_after - share_before)))
      throw Interrupted(fmt::format("mcmc: interrupted after {} of {} steps", done, planned));
  };
  report(0);
  Chains chains(target, options);
  Eigen::Index affordable = std::numeric_limits<Eigen::Index>::max();
  if (options.affordable_steps) {
    affordable = options.affordable_steps();
    warm_up = std::min(warm_up, affordable / 2);
    kept = std::min(kept, affordable - warm_up);
    planned = warm_up + kept;
    if (kept < 100)
      throw NumericalError(fmt::format(
          "mcmc: {} steps a chain are affordable once the modes are found; 200 are needed", affordable));
  }
  std::size_t window = 0;
  for (Eigen::Index t = 0; t < warm_up; ++t) {
    chains.advance(true);
    chains.learn();
    if (window < k_learning_ends.size() && t + 1 >= k_learning_ends[window] * warm_up) {
      chains.use_learnt();
      ++window;
    }
    report(t + 1);
  }
  MetropolisResult result;
  result.chains = options.chains;
  result.sample.points.resize(chain_count * kept, target.dimension());
  result.sample.weights = Eigen::VectorXd::Constant(chain_count * kept, 1.0 / (chain_count * kept));
  Eigen::Index steps = 0, draws = 0;
  for (;;) {
    for (; draws < kept; ++draws) {
      for (int step = 0; step < result.thinning; ++step) {
        chains.advance(false);
        result.acceptance += chains.last_acceptance();
        report(warm_up + ++steps);
      }
      for (Eigen::Index c = 0; c < chain_count; ++c)
        result.sample.points.row(c * kept + draws) = chains.position().row(c);
    }
    fill_statistics(result);
    if (result.converged || 2 * result.thinning > options.max_thinning) break;
    // Twice the length with the same number of draws: every second one stays.
    if (warm_up + steps + (kept - kept / 2) * 2 * result.thinning > affordable) break;
    draws = kept / 2;
    for (Eigen::Index c = 0; c < chain_count; ++c)
      for (Eigen::Index t = 0; t < draws; ++t)
        result.sample.points.row(c * kept + t) = result.sample.points.row(c * kept + 2 * t + 1).eval();
    result.thinning *= 2;
    stage_begin = warm_up + steps;
    planned = stage_begin + (kept - draws) * result.thinning;
    share_before = share_after;
    share_after = 2 * result.thinning > options.max_thinning ? 1 : 0.5 * (1 + share_before);
  }
  if (share_after < 1 && options.progress) (void)options.progress(1);
  result.acceptance /= steps;
  result.sample.density_evaluations = chains.evaluations();
  return result;
}

}  // namespace knothe::posterior
