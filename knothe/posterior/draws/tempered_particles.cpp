#include "knothe/posterior/draws/tempered_particles.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "knothe/base/error.hpp"

namespace knothe::posterior {

namespace {

constexpr double k_infinity = std::numeric_limits<double>::infinity();

/// Effective number of weights exp(step × increment); −∞ increments have none.
double effective_number(const Eigen::VectorXd& increments, double step) {
  const double top = increments.maxCoeff();
  double sum = 0, squares = 0;
  for (const double a : increments) {
    if (a == -k_infinity) continue;
    const double w = std::exp(step * (a - top));
    sum += w, squares += w * w;
  }
  return sum * sum / squares;
}

}  // namespace

TemperedParticles::TemperedParticles(CheckedDensity& target, const Mixture& reference,
                                     TemperingOptions options)
    : target_(target),
      reference_(reference),
      options_(std::move(options)),
      random_(options_.seed),
      n_(std::max<Eigen::Index>(16, options_.particles + options_.particles % 2)),
      d_(target.dimension()) {
  if (reference.dimension() != d_)
    throw UsageError(
        fmt::format("smc: a start in {} dimensions for a density in {}", reference.dimension(), d_));
  first_evaluation_ = target_.evaluations();
  if (!(options_.ess_share > 0 && options_.ess_share < 1))
    throw UsageError(
        fmt::format("smc: ess_share is {}; it must lie between 0 and 1, both excluded", options_.ess_share));
  if (options_.max_moves < 1) throw UsageError(fmt::format("smc: max_moves is {}", options_.max_moves));
}

void TemperedParticles::run() {
  const auto report = [&] {
    if (options_.progress && !options_.progress(beta_))
      throw Interrupted(fmt::format("smc: interrupted at temperature {:.3g} of 1", beta_));
  };
  report();
  points_ = reference_.sample(n_, random_);
  reference_.log_density(points_, log_reference_);
  target_.evaluate(points_, 0, batch_);
  log_target_ = batch_.value;
  if (log_target_.maxCoeff() == -k_infinity)
    throw NumericalError(fmt::format(
        "smc: the density is zero at all {} first particles; give a centre and a spread where its mass is",
        n_));
  ancestor_.resize(n_);
  changes_.resize(d_);
  std::iota(ancestor_.begin(), ancestor_.end(), Eigen::Index{0});
  log_scale_ = std::log(2.38 / std::sqrt(2.0 * d_));
  temperatures_.assign(1, 0.0);
  log_evidence_ = 0;
  while (beta_ < 1) {
    reweigh_and_resample(next_temperature());
    move();
    if (beta_ == options_.kept) points_at_kept_ = points_;
    report();
  }
}

/// The largest step that keeps ess_share of the particles whose weight is not zero.
double TemperedParticles::next_temperature() {
  increments_ = log_target_ - log_reference_;
  const double alive = (increments_.array() > -k_infinity).count();
  const double goal = beta_ < options_.kept ? options_.kept : 1, rest = goal - beta_,
               wanted = (1 - 1e-9) * std::max(1.0, options_.ess_share * alive);
  if (effective_number(increments_, rest) >= wanted) return goal;
  // Bisection on the logarithm: a density far narrower than the reference needs very small first steps.
  double low = std::log(rest) - 300, high = std::log(rest);
  for (int i = 0; i < 50; ++i) {
    const double middle = 0.5 * (low + high);
    (effective_number(increments_, std::exp(middle)) >= wanted ? low : high) = middle;
  }
  const double next = beta_ + std::exp(low);
  return next > beta_ ? next : std::nextafter(beta_, 1.0);
}

void TemperedParticles::reweigh_and_resample(double next) {
  const double step = next - beta_, top = increments_.maxCoeff();
  Eigen::VectorXd weights(n_);
  for (Eigen::Index i = 0; i < n_; ++i)
    weights[i] = increments_[i] == -k_infinity ? 0 : std::exp(step * (increments_[i] - top));
  const double sum = weights.sum();
  log_evidence_ += step * top + std::log(sum / n_);
  weights /= sum;
  step_variances_ += std::max(0.0, weights.squaredNorm() - 1.0 / n_);
  beta_ = next;
  temperatures_.push_back(beta_);
  if (beta_ >= 1) estimate_error(weights);
  // Systematic resampling.
  const Eigen::MatrixXd old_points = points_;
  const Eigen::VectorXd old_target = log_target_, old_reference = log_reference_;
  const std::vector<Eigen::Index> old_ancestor = ancestor_;
  double position = random_.uniform() / n_, cumulative = weights[0];
  // Which half a copy goes to must not depend on its place in the sum: even and odd copies.
  Eigen::Index source = 0;
  for (Eigen::Index r = 0; r < n_; ++r) {
    while (cumulative < position && source + 1 < n_) cumulative += weights[++source];
    while (weights[source] == 0 && source > 0) --source;  // rounding at the end of the sum
    const Eigen::Index i = r % 2 == 0 ? r / 2 : n_ / 2 + r / 2;
    points_.row(i) = old_points.row(source);
    log_target_[i] = old_target[source];
    log_reference_[i] = old_reference[source];
    ancestor_[i] = old_ancestor[source];
    position += 1.0 / n_;
  }
}

void TemperedParticles::estimate_error(const Eigen::VectorXd& weights) {
  Eigen::VectorXd family = Eigen::VectorXd::Zero(n_);
  for (Eigen::Index i = 0; i < n_; ++i) family[ancestor_[i]] += weights[i];
  // Relative variance of the evidence: Σ over families of their squared share, less what equal families of
  // one would have; the factor makes up for the pairs that resampling excludes (Lee, Whiteley 2018, Eq. 4).
  // That is for independent resampling; systematic resampling scatters less, so that the estimate may even be
  // negative. Then what the weights of each temperature say, as if the moves made all particles independent,
  // is larger.
  const double n = n_, exponent = temperatures_.size() * std::log(n / (n - 1));
  const double genealogical = 1 - std::exp(exponent) * (1 - family.squaredNorm());
  log_evidence_error_ = std::sqrt(std::max(genealogical, step_variances_));
}

double TemperedParticles::mean_squared_jump() const {
  Eigen::MatrixXd jump = (points_ - before_).transpose();
  whitener_.triangularView<Eigen::Lower>().solveInPlace(jump);
  return jump.squaredNorm() / n_;
}

/// Which coordinates a proposal changes: all, or each with probability ½ or 1/d, but at least one (Vrugt et
/// al. 2009): parameters that the data do not couple go their own ways.
Eigen::Index TemperedParticles::choose_coordinates(double probability) {
  Eigen::Index count = 0;
  for (Eigen::Index k = 0; k < d_; ++k) count += changes_[k] = random_.uniform() < probability;
  if (count > 0) return count;
  changes_[random_.index(d_)] = true;
  return 1;
}

void TemperedParticles::propose(Eigen::Index begin, Eigen::Index partners, bool full) {
  const Eigen::Index half = n_ / 2;
  const double one_over_d = 1.0 / d_, probabilities[] = {1, 0.5, one_over_d};
  const double probability = probabilities[random_.index(3)];
  proposal_.resize(half, d_);
  for (Eigen::Index i = 0; i < half; ++i) {
    const Eigen::Index a = random_.index(half);
    Eigen::Index b = random_.index(half - 1);
    if (b >= a) ++b;
    const double count = choose_coordinates(probability);
    // A little noise beside: else particles that resampling has made equal would never part.
    const double length =
        (full ? 1 : std::exp(log_scale_) * std::sqrt(d_ / count)) * (1 + 0.4 * (random_.uniform() - 0.5));
    for (Eigen::Index k = 0; k < d_; ++k) {
      proposal_(i, k) = points_(begin + i, k);
      if (changes_[k])
        proposal_(i, k) += length * (points_(partners + a, k) - points_(partners + b, k)) +
                           3e-3 * whitener_(k, k) * (random_.uniform() - 0.5);
    }
  }
}

double TemperedParticles::move_half(Eigen::Index begin, Eigen::Index partners) {
  const Eigen::Index half = n_ / 2;
  // Now and then a full difference: it leads from mode to mode (ter Braak 2006, section 2).
  const bool full = random_.uniform() < 0.25;
  propose(begin, partners, full);
  target_.evaluate(proposal_, 0, batch_);
  reference_.log_density(proposal_, proposal_reference_);
  double acceptance = 0;
  for (Eigen::Index i = 0; i < half; ++i) {
    const double log_ratio = beta_ * (batch_.value[i] - log_target_[begin + i]) +
                             (1 - beta_) * (proposal_reference_[i] - log_reference_[begin + i]);
    acceptance += std::exp(std::min(0.0, log_ratio)) / half;
    if (std::log(random_.uniform()) >= log_ratio) continue;
    points_.row(begin + i) = proposal_.row(i);
    log_target_[begin + i] = batch_.value[i];
    log_reference_[begin + i] = proposal_reference_[i];
  }
  if (!full) log_scale_ = std::clamp(log_scale_ + (acceptance - 0.25), -12.0, 1.0);
  return acceptance;
}

/// Until particles are as far from where they were as two draws are from each other, or get no farther:
/// between modes far apart they never go.
void TemperedParticles::move() {
  constexpr double k_far_enough = 0.9, k_no_farther = 1.05;
  constexpr int k_look_back = 4;
  before_ = points_;
  const Eigen::MatrixXd centred = points_.rowwise() - points_.colwise().mean();
  Eigen::MatrixXd covariance = centred.transpose() * centred / n_;
  for (Eigen::Index k = 0; k < d_; ++k)
    covariance(k, k) = covariance(k, k) * (1 + 1e-10) + std::numeric_limits<double>::min();
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  if (factor.info() == Eigen::Success)
    whitener_ = factor.matrixL();
  else
    whitener_ = covariance.diagonal().cwiseSqrt().asDiagonal();
  std::vector<double> jumps;
  for (int m = 0; m < options_.max_moves; ++m) {
    if (options_.max_evaluations > 0 &&
        target_.evaluations() - first_evaluation_ + n_ > options_.max_evaluations)
      return;
    acceptance_ = 0.5 * (move_half(0, n_ / 2) + move_half(n_ / 2, 0));
    jumps.push_back(mean_squared_jump());
    if (jumps.back() >= k_far_enough * 2 * d_) return;
    if (m >= 2 * k_look_back && jumps.back() < k_no_farther * jumps[jumps.size() - 1 - k_look_back]) return;
  }
}

void TemperedParticles::go_on(int moves) {
  for (int m = 0; m < moves; ++m) acceptance_ = 0.5 * (move_half(0, n_ / 2) + move_half(n_ / 2, 0));
}

double TemperedParticles::effective_size() const {
  const Eigen::RowVectorXd mean = points_.colwise().mean();
  Eigen::MatrixXd family = Eigen::MatrixXd::Zero(n_, d_);
  for (Eigen::Index i = 0; i < n_; ++i) family.row(ancestor_[i]) += points_.row(i) - mean;
  const double n = n_;
  double least = n;
  for (Eigen::Index k = 0; k < d_; ++k) {
    const double variance = (points_.col(k).array() - mean[k]).square().mean();
    const double of_mean = family.col(k).squaredNorm() / (n * n);
    if (of_mean > 0) least = std::min(least, variance / of_mean);
  }
  return std::max(1.0, least);
}

}  // namespace knothe::posterior
