#include "knothe/transport/missed_modes.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/sampling/tempered_particles.hpp"
#include "knothe/transport/map_solver.hpp"

namespace knothe::transport {

namespace {

using sampling::Mode;

/// log mean exp and its standard error.
void evidence_of(const Eigen::VectorXd& log_weight, double& log_evidence, double& error) {
  const double top = log_weight.maxCoeff(), n = static_cast<double>(log_weight.size());
  const Eigen::ArrayXd w = (log_weight.array() - top).exp();
  log_evidence = top + std::log(w.mean());
  const double share = w.sum() * w.sum() / (n * w.square().sum());
  error = std::sqrt(std::max(0.0, 1 / share - 1) / n);
}

std::string describe(const Eigen::VectorXd& z) {
  std::string text = "z = (";
  for (Eigen::Index k = 0; k < z.size(); ++k) text += fmt::format("{}{:.4g}", k > 0 ? ", " : "", z[k]);
  return text + ")";
}

/// Keeps what a look needs at hand.
class Search {
 public:
  Search(sampling::CheckedDensity& target, const MapResult& result, sampling::ModeSearch& ascents,
         std::vector<Mode>& modes, const MissedModesOptions& options, MissedModes& out)
      : target_(target), result_(result), ascents_(ascents), modes_(modes), options_(options), out_(out) {}

  /// True if the map has next to no density at a mode that has mass.
  bool a_mode_is_missed();
  /// True if the particles say that the map leaves mass out.
  bool particles_elsewhere(int effort, double widest);

 private:
  bool judge(const sampling::TemperedParticles& particles);
  [[nodiscard]] sampling::GaussianMixture reference(double wider) const;
  [[nodiscard]] Eigen::MatrixXd starts_among(const sampling::TemperedParticles& particles,
                                             const std::vector<Eigen::Index>& uncovered) const;
  [[nodiscard]] std::vector<Eigen::Index> sample_of(const sampling::TemperedParticles& particles) const;

  sampling::CheckedDensity& target_;
  const MapResult& result_;
  sampling::ModeSearch& ascents_;
  std::vector<Mode>& modes_;
  const MissedModesOptions& options_;
  MissedModes& out_;
};

bool Search::a_mode_is_missed() {
  for (const Mode& mode : modes_) {
    // The map was built around this one; how well is for the diagnostic to say.
    if (result_.pre_map.inverse(mode.point.transpose()).norm() < 0.5) continue;
    const double log_share = mode.log_mass - out_.map_log_evidence;
    if (log_share < std::log(options_.mode_mass)) continue;
    // Not missed if the map puts mass there: its density is compared with the normalised target's.
    const double approximation = result_.log_density(mode.point.transpose())[0];
    if (mode.value - out_.map_log_evidence <= approximation + 1) continue;
    out_.found = true;
    out_.mode = mode.point;
    out_.share = 1 / (1 + std::exp(-log_share));
    out_.reason = fmt::format(
        "a second mode with about {:.2g} % of the mass was found at {}, and the map leaves it out",
        100 * out_.share, describe(mode.point));
    return true;
  }
  return false;
}

/// Far wider than all that is known of the target, so that what is not known is inside.
sampling::GaussianMixture Search::reference(double wider) const {
  const Eigen::Index d = target_.dimension();
  if (options_.reference_spread > 0)
    return sampling::GaussianMixture(
        {{1.0, Eigen::VectorXd::Zero(d), options_.reference_spread * Eigen::MatrixXd::Identity(d, d)}});
  const Mode& main = modes_.front();
  // Half of the spread without correlation: another mode need not lie along the ridge of this one.
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(d, d);
  for (const Mode& mode : modes_) {
    if (mode.log_mass < out_.map_log_evidence + std::log(options_.mode_mass)) continue;
    const Eigen::MatrixXd own = mode.lower * mode.lower.transpose();
    const Eigen::VectorXd apart = mode.point - main.point;
    covariance += 0.5 * wider * wider * own + apart * apart.transpose();
    covariance.diagonal() += 0.5 * wider * wider * own.diagonal();
  }
  Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  Eigen::MatrixXd lower = wider * main.lower;
  if (factor.info() == Eigen::Success) lower = factor.matrixL();
  return sampling::GaussianMixture({{1.0, main.point, lower}});
}

/// The inverse of the map costs more than a cheap density: 256 particles stand for all, and beside them the
/// 64 farthest from the main mode.
std::vector<Eigen::Index> Search::sample_of(const sampling::TemperedParticles& particles) const {
  const Eigen::Index n = particles.points().rows(), even = std::min<Eigen::Index>(n, 256);
  std::vector<Eigen::Index> chosen;
  for (Eigen::Index i = 0; i < even; ++i) chosen.push_back(i * n / even);
  const Eigen::MatrixXd apart = modes_.front().lower.triangularView<Eigen::Lower>().solve(
      (particles.points().rowwise() - modes_.front().point.transpose()).transpose());
  const Eigen::VectorXd distance = apart.colwise().squaredNorm();
  std::vector<Eigen::Index> order(static_cast<std::size_t>(n));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  const auto far = order.begin() + std::min<Eigen::Index>(n, 64);
  std::partial_sort(order.begin(), far, order.end(), [&](Eigen::Index a, Eigen::Index b) {
    return distance[a] != distance[b] ? distance[a] > distance[b] : a < b;
  });
  chosen.insert(chosen.end(), order.begin(), far);
  return chosen;
}

/// Up to 12, far from each other: first the one of the highest density, then always the one farthest from
/// those chosen.
Eigen::MatrixXd Search::starts_among(const sampling::TemperedParticles& particles,
                                     const std::vector<Eigen::Index>& uncovered) const {
  constexpr std::size_t k_most = 12;
  const auto m = static_cast<Eigen::Index>(uncovered.size());
  Eigen::MatrixXd points(m, target_.dimension());
  Eigen::Index best = 0;
  for (Eigen::Index i = 0; i < m; ++i) {
    const auto particle = uncovered[static_cast<std::size_t>(i)];
    points.row(i) = particles.points().row(particle);
    if (particles.log_target()[particle] > particles.log_target()[uncovered[static_cast<std::size_t>(best)]])
      best = i;
  }
  const Eigen::MatrixXd scaled =
      modes_.front().lower.triangularView<Eigen::Lower>().solve(points.transpose()).transpose();
  Eigen::VectorXd nearest = Eigen::VectorXd::Constant(m, std::numeric_limits<double>::max());
  std::vector<Eigen::Index> chosen;
  while (chosen.size() < std::min(k_most, uncovered.size())) {
    chosen.push_back(best);
    nearest = nearest.cwiseMin((scaled.rowwise() - scaled.row(best)).rowwise().squaredNorm());
    nearest.maxCoeff(&best);
  }
  Eigen::MatrixXd starts(static_cast<Eigen::Index>(chosen.size()), points.cols());
  for (std::size_t i = 0; i < chosen.size(); ++i)
    starts.row(static_cast<Eigen::Index>(i)) = points.row(chosen[i]);
  return starts;
}

bool Search::particles_elsewhere(int effort, double widest) {
  const Eigen::Index d = target_.dimension();
  sampling::TemperingOptions tempering;
  tempering.particles =
      options_.particles > 0
          ? options_.particles
          : std::clamp<Eigen::Index>(Eigen::Index{256} << std::min<Eigen::Index>(d, 5), 512, 8192);
  tempering.particles *= effort;
  tempering.max_moves = options_.max_moves * (effort > 1 ? 2 : 1);
  tempering.max_evaluations = options_.max_evaluations;
  tempering.seed = options_.seed + 0x74656d70;
  // Where the density is zero at all particles, as around a box, they begin nearer.
  for (const double wider : {120.0, 12.0, 2.0}) {
    if (wider > widest) continue;
    const sampling::GaussianMixture start = reference(wider);
    sampling::TemperedParticles particles(target_, start, tempering);
    try {
      particles.run();
    } catch (const NumericalError&) {
      if (options_.reference_spread > 0) break;
      continue;
    }
    return judge(particles);
  }
  out_.tempered_conclusive = false;
  return false;
}

bool Search::judge(const sampling::TemperedParticles& particles) {
  out_.tempered_done = true;
  out_.tempered_log_evidence = particles.log_evidence();
  out_.tempered_log_evidence_error = particles.log_evidence_error();

  // Particles where the target's normalised density is far above the map's.
  constexpr double k_far_above = 2;  // e²
  const std::vector<Eigen::Index> sample = sample_of(particles);
  Eigen::MatrixXd points(static_cast<Eigen::Index>(sample.size()), target_.dimension());
  for (std::size_t i = 0; i < sample.size(); ++i)
    points.row(static_cast<Eigen::Index>(i)) = particles.points().row(sample[i]);
  const Eigen::VectorXd approximation = result_.log_density(points);
  const std::size_t even = std::min<std::size_t>(256, static_cast<std::size_t>(particles.points().rows()));
  std::vector<Eigen::Index> uncovered;
  double share = 0;
  for (std::size_t i = 0; i < sample.size(); ++i) {
    const double density = particles.log_target()[sample[i]] - out_.map_log_evidence;
    if (!(density > approximation[static_cast<Eigen::Index>(i)] + k_far_above)) continue;
    uncovered.push_back(sample[i]);
    if (i < even) share += 1 / static_cast<double>(even);
  }
  if (!uncovered.empty()) {
    ascents_.ascend_from(target_, starts_among(particles, uncovered), modes_);
    if (a_mode_is_missed()) return true;
  }
  const double excess = out_.tempered_log_evidence - out_.map_log_evidence;
  const double error = std::hypot(out_.tempered_log_evidence_error, out_.map_log_evidence_error);
  out_.tempered_conclusive = excess > -(3 * error + 0.5);
  // Shares are of the particles' mass; particles that lost their way have next to none of it.
  share *= std::exp(std::min(0.0, excess));
  if (share > 0.05 + 3 * std::sqrt(share / static_cast<double>(even))) {
    out_.found = true;
    out_.share = share;
    out_.mode = particles.points().row(uncovered.front()).transpose();
    out_.reason =
        fmt::format("about {:.2g} % of the mass lies where the map has next to none, for instance at {}",
                    100 * share, describe(out_.mode));
  } else if (excess > 4 * error + 0.3) {
    out_.found = true;
    out_.share = 1 - std::exp(-excess);
    out_.mode = modes_.front().point;
    out_.reason = fmt::format(
        "the log-evidence by tempering, {:.4g} ± {:.2g}, is above the map's, {:.4g} ± {:.2g}: mass is left "
        "out",
        out_.tempered_log_evidence, out_.tempered_log_evidence_error, out_.map_log_evidence,
        out_.map_log_evidence_error);
  }
  return out_.found;
}

}  // namespace

MissedModes look_for_missed_modes(sampling::CheckedDensity& target, const MapResult& result,
                                  sampling::ModeSearch& search, std::vector<sampling::Mode>& modes,
                                  const MissedModesOptions& options) {
  MissedModes out;
  if (options.level != ModeSearchLevel::tempered && modes.size() < 2) return out;  // the online case: no time
  evidence_of(result.verification.log_weight, out.map_log_evidence, out.map_log_evidence_error);
  if (options.level == ModeSearchLevel::none || modes.empty()) return out;
  Search look(target, result, search, modes, options, out);
  if (look.a_mode_is_missed() || options.level == ModeSearchLevel::multi_start) return out;
  const sampling::CheckedDensity::Leniency lenient(target);
  // Particles that came from too far and lost their way find less mass than the map has: once more, more of
  // them, from nearer.
  if (!look.particles_elsewhere(1, 120) && !out.tempered_conclusive) (void)look.particles_elsewhere(4, 12);
  return out;
}

}  // namespace knothe::transport
