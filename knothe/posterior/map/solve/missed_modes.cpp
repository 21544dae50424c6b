#include "knothe/posterior/map/solve/missed_modes.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/posterior/draws/polar_scan.hpp"
#include "knothe/posterior/draws/tempered_particles.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"

namespace knothe::posterior {

namespace {

/// log mean exp and its standard error.
void evidence_of(const Eigen::VectorXd& log_weight, double& log_evidence, double& error) {
  const double top = log_weight.maxCoeff(), n = log_weight.size();
  const Eigen::ArrayXd w = (log_weight.array() - top).exp();
  log_evidence = top + std::log(w.mean());
  const double share = w.sum() * w.sum() / (n * w.square().sum());
  error = std::sqrt(std::max(0.0, 1 / share - 1) / n);
}

std::string describe(const Eigen::VectorXd& z) {
  std::string text = "z = (";
  for (Index k = 0; k < z.size(); ++k) text += fmt::format("{}{:.4g}", k > 0 ? ", " : "", z[k]);
  return text + ")";
}

/// The target with the mass that the map covers counted only e^−k_discount-fold. A particle on the known mode
/// proves nothing, and at every temperature most of them would be there: so fewer are needed to find what is
/// not known. With a = log (π̄ / (Z q)), Z the evidence, q the map's density: the whole discount for a ≤ 1,
/// none for a ≥ 3.
class DiscountedDensity final : public LogDensity {
 public:
  DiscountedDensity(CheckedDensity& target, const MapResult& result, double log_evidence)
      : target_(target), result_(result), log_evidence_(log_evidence) {}
  [[nodiscard]] Index dimension() const override { return target_.dimension(); }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int, LogDensityBatch& out) override {
    target_.evaluate(points, 0, batch_);
    const Eigen::VectorXd known = known_density(points);
    for (Index i = 0; i < points.rows(); ++i)
      out.value[i] = batch_.value[i] - discount(batch_.value[i] - log_evidence_ - known[i]);
  }
  /// What was taken off at points whose discounted values are `discounted`.
  [[nodiscard]] Eigen::VectorXd discount_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                            const Eigen::VectorXd& discounted) const {
    const Eigen::VectorXd known = known_density(points);
    Eigen::VectorXd out(points.rows());
    for (Index i = 0; i < out.size(); ++i) {
      const double left = discounted[i] - log_evidence_ - known[i];  // a − discount(a), increasing in a
      const double above = left <= 1 - k_discount ? left + k_discount
                           : left >= 3            ? left
                                                  : (left + 1.5 * k_discount) / (1 + 0.5 * k_discount);
      out[i] = discount(above);
    }
    return out;
  }
  /// a = log of how far the normalised target is above the map's density.
  [[nodiscard]] double discount(double above) const {
    return above < 3 ? k_discount * std::min((3 - above) / 2, 1.0) : 0;
  }

 private:
  /// log q; −∞ beyond 12 Laplace deviations, where no map has mass worth its inverse: most particles begin
  /// there.
  [[nodiscard]] Eigen::VectorXd known_density(const Eigen::Ref<const Eigen::MatrixXd>& points) const {
    constexpr double k_reach = 12;
    const Eigen::VectorXd distance = result_.pre_map.inverse(points).rowwise().norm();
    std::vector<Index> near;
    for (Index i = 0; i < points.rows(); ++i)
      if (distance[i] < k_reach) near.push_back(i);
    Eigen::VectorXd out = Eigen::VectorXd::Constant(points.rows(), -std::numeric_limits<double>::infinity());
    if (!near.empty()) out(near) = result_.log_density(points(near, Eigen::all));
    return out;
  }

  static constexpr double k_discount = 7;
  CheckedDensity& target_;
  const MapResult& result_;
  double log_evidence_;
  LogDensityBatch batch_;
};

/// Keeps what a look needs at hand.
class Search {
 public:
  Search(CheckedDensity& target, const MapResult& result, ModeSearch& ascents, std::vector<Mode>& modes,
         const MissedModesOptions& options, MissedModes& out)
      : target_(target), result_(result), ascents_(ascents), modes_(modes), options_(options), out_(out) {}

  /// True if the map has next to no density at a mode that has mass.
  bool a_mode_is_missed();
  /// In one and two dimensions: true if scans around the main mode, with the map, account for all mass (or
  /// find a mode that is missed). If not, it is for particles to say.
  bool scans_suffice();
  /// True if the particles say that the map leaves mass out.
  bool particles_elsewhere(int effort, double widest);

 private:
  [[nodiscard]] std::vector<PolarScan> scans() const;
  bool check_particles(const TemperedParticles& particles, const DiscountedDensity& discounted);
  [[nodiscard]] Mixture reference(double wider) const;
  [[nodiscard]] Mixture near_the_origin(double spread) const;
  [[nodiscard]] Eigen::MatrixXd starts_among(const Eigen::MatrixXd& points,
                                             const Eigen::VectorXd& values) const;
  [[nodiscard]] std::vector<Index> sample_of(const TemperedParticles& particles) const;

  CheckedDensity& target_;
  const MapResult& result_;
  ModeSearch& ascents_;
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

/// For parameters that come standardised: N(0, s² I); and the same around a mode that lies outside, else
/// particles would have to come all the way to it.
Mixture Search::near_the_origin(double spread) const {
  const Index d = target_.dimension();
  const Eigen::MatrixXd lower = spread * Eigen::MatrixXd::Identity(d, d);
  std::vector<MixtureComponent> parts = {{1.0, Eigen::VectorXd::Zero(d), lower}};
  const Eigen::VectorXd& mode = modes_.front().point;
  if (mode.cwiseAbs().maxCoeff() > 2 * spread) parts.push_back({1.0, mode, lower});
  return Mixture(std::move(parts));
}

/// Far wider than all that is known of the target, so that what is not known is inside.
Mixture Search::reference(double wider) const {
  const Index d = target_.dimension();
  if (options_.reference_spread > 0) return near_the_origin(options_.reference_spread);
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
  return Mixture({{1.0, main.point, lower}});
}

/// The inverse of the map costs more than a cheap density: 256 particles stand for all, and beside them the
/// 64 farthest from the main mode.
std::vector<Index> Search::sample_of(const TemperedParticles& particles) const {
  const Index n = particles.points().rows(), even = std::min<Index>(n, 256);
  std::vector<Index> chosen;
  for (Index i = 0; i < even; ++i) chosen.push_back(i * n / even);
  const Eigen::MatrixXd apart = modes_.front().lower.triangularView<Eigen::Lower>().solve(
      (particles.points().rowwise() - modes_.front().point.transpose()).transpose());
  const Eigen::VectorXd distance = apart.colwise().squaredNorm();
  std::vector<Index> order(n);
  std::iota(order.begin(), order.end(), Index{0});
  const auto far = order.begin() + std::min<Index>(n, 64);
  std::partial_sort(order.begin(), far, order.end(), [&](Index a, Index b) {
    return distance[a] != distance[b] ? distance[a] > distance[b] : a < b;
  });
  chosen.insert(chosen.end(), order.begin(), far);
  return chosen;
}

/// Up to 12 of the points, far from each other: first the one of the highest density, then always the one
/// farthest from those chosen.
Eigen::MatrixXd Search::starts_among(const Eigen::MatrixXd& points, const Eigen::VectorXd& values) const {
  constexpr Index k_max_starts = 12;
  Index best = 0;
  values.maxCoeff(&best);
  const Eigen::MatrixXd scaled =
      modes_.front().lower.triangularView<Eigen::Lower>().solve(points.transpose()).transpose();
  Eigen::VectorXd nearest = Eigen::VectorXd::Constant(points.rows(), std::numeric_limits<double>::max());
  std::vector<Index> chosen;
  while (std::ssize(chosen) < std::min(k_max_starts, points.rows())) {
    chosen.push_back(best);
    nearest = nearest.cwiseMin((scaled.rowwise() - scaled.row(best)).rowwise().squaredNorm());
    nearest.maxCoeff(&best);
  }
  return points(chosen, Eigen::all);
}

/// In the metric of the main mode, and, where that is narrow, in one that is not: another mode need not lie
/// along the ridge of this one. As far as particles would come from.
std::vector<PolarScan> Search::scans() const {
  constexpr double k_first = 0.5, k_far = 300, k_narrow = 0.5, k_farthest = 1e5, k_standard_far = 2;
  const Mode& main = modes_.front();
  Eigen::VectorXd unit = main.lower.rowwise().norm();
  double reach = k_far;
  if (options_.reference_spread > 0) {
    unit.setConstant(unit.maxCoeff());
    reach = std::clamp((k_standard_far * options_.reference_spread + main.point.norm()) / unit[0], 12.0,
                       k_farthest);
  }
  const Eigen::MatrixXd shape = unit.cwiseInverse().asDiagonal() * main.lower;
  const Eigen::VectorXd squared = numerics::SymmetricEigen(shape * shape.transpose()).eigenvalues();
  const bool is_narrow = squared.minCoeff() < k_narrow * k_narrow * squared.maxCoeff();
  const double spacing = unit.size() == 1 ? 0.03 : 0.15;
  const double across = std::sqrt(std::max(squared.minCoeff(), 1e-300));
  std::vector<PolarScan> scans;
  scans.emplace_back(target_, main.point, main.lower, k_first,
                     options_.reference_spread > 0 ? std::min(reach / across, k_farthest) : reach, spacing);
  if (is_narrow)
    scans.emplace_back(target_, main.point, Eigen::MatrixXd(unit.asDiagonal()), k_first * across, reach,
                       spacing);
  return scans;
}

bool Search::scans_suffice() {
  // Shares and evidences as those of particles, below.
  constexpr double k_far_above = 2, k_evidence_apart = 0.3, k_missed_share = 0.05;
  constexpr Index k_sample = 256;
  const std::vector<PolarScan> around = scans();
  const auto is_uncovered = [&](const Eigen::MatrixXd& points, const Eigen::VectorXd& values) {
    const Eigen::ArrayXd above = values - result_.log_density(points);
    return (above > out_.map_log_evidence + k_far_above).eval();
  };
  for (const auto& scan : around) {
    std::vector<Index> maxima = scan.local_maxima();
    if (maxima.empty()) continue;
    const auto uncovered = is_uncovered(scan.points()(maxima, Eigen::all), scan.values()(maxima));
    std::size_t kept = 0;
    for (Index i = 0; i < std::ssize(maxima); ++i)
      if (uncovered[i]) maxima[kept++] = maxima[i];
    maxima.resize(kept);
    if (maxima.empty()) continue;
    ascents_.ascend_from(target_, starts_among(scan.points()(maxima, Eigen::all), scan.values()(maxima)),
                         modes_);
  }
  if (a_mode_is_missed()) return true;
  // The scan in the mode's own metric has to find the mass that is known, the other one no more than that.
  const double tolerance = k_evidence_apart + 3 * out_.map_log_evidence_error;
  if (std::abs(around.front().log_evidence() - out_.map_log_evidence) > tolerance) return false;
  for (const auto& scan : around) {
    if (scan.log_evidence() > out_.map_log_evidence + tolerance) return false;
    const std::vector<Index> sample = scan.sample(k_sample);
    const auto uncovered = is_uncovered(scan.points()(sample, Eigen::all), scan.values()(sample)).count();
    if (uncovered > k_missed_share * k_sample) return false;
  }
  out_.scanned = true;
  return true;
}

bool Search::particles_elsewhere(int effort, double widest) {
  const Index d = target_.dimension();
  TemperingOptions tempering;
  tempering.particles =
      options_.particles > 0
          ? options_.particles
          : std::clamp<Index>(Index{options_.reference_spread > 0 ? 64 : 128} << std::min<Index>(d, 5), 256,
                              4096);
  tempering.particles *= effort;
  tempering.max_moves = options_.max_moves * (effort > 1 ? 2 : 1);
  tempering.max_evaluations = options_.max_evaluations;
  tempering.seed = options_.seed + 0x74656d70;
  // Where the density is zero at all particles, as around a box, they begin nearer.
  for (const double wider : {120.0, 12.0, 2.0}) {
    if (wider > widest) continue;
    const Mixture start = reference(wider);
    DiscountedDensity discounted(target_, result_, out_.map_log_evidence);
    CheckedDensity checked(discounted);
    const CheckedDensity::Leniency lenient(checked);
    TemperedParticles particles(checked, start, tempering);
    try {
      particles.run();
    } catch (const NumericalError&) {
      if (options_.reference_spread > 0) break;
      continue;
    }
    return check_particles(particles, discounted);
  }
  out_.tempered_conclusive = false;
  return false;
}

bool Search::check_particles(const TemperedParticles& particles, const DiscountedDensity& discounted) {
  out_.tempered_done = true;
  // log π̄ of the particles, and what each of them stands for: e^discount.
  const Index n = particles.points().rows();
  const Eigen::VectorXd discount = discounted.discount_of(particles.points(), particles.log_target());
  const Eigen::VectorXd log_target = particles.log_target() + discount;
  const Eigen::ArrayXd stands_for = discount.array().exp();
  const double mean = stands_for.mean();
  out_.tempered_log_evidence = particles.log_evidence() + std::log(mean);
  out_.tempered_log_evidence_error =
      std::hypot(particles.log_evidence_error(), std::sqrt((stands_for - mean).square().mean() / n) / mean);

  // Particles where the target's normalised density is far above the map's.
  constexpr double k_far_above = 2;  // e²
  const std::vector<Index> sample = sample_of(particles);
  Eigen::MatrixXd points(std::ssize(sample), target_.dimension());
  for (Index i = 0; i < std::ssize(sample); ++i) points.row(i) = particles.points().row(sample[i]);
  const Eigen::VectorXd approximation = result_.log_density(points);
  const Index even = std::min<Index>(256, particles.points().rows());
  std::vector<Index> uncovered;
  double share = 0;
  for (Index i = 0; i < std::ssize(sample); ++i) {
    const double density = log_target[sample[i]] - out_.map_log_evidence;
    if (!(density > approximation[i] + k_far_above)) continue;
    uncovered.push_back(sample[i]);
    if (i < even) share += stands_for[sample[i]] / even;
  }
  if (!uncovered.empty()) {
    ascents_.ascend_from(
        target_, starts_among(particles.points()(uncovered, Eigen::all), particles.log_target()(uncovered)),
        modes_);
    if (a_mode_is_missed()) return true;
  }
  const double excess = out_.tempered_log_evidence - out_.map_log_evidence;
  const double error = std::hypot(out_.tempered_log_evidence_error, out_.map_log_evidence_error);
  out_.tempered_conclusive = excess > -(3 * error + 0.5);
  // Of the mass that is known.
  share *= std::exp(particles.log_evidence() - out_.map_log_evidence);
  share /= 1 + share;
  if (share > 0.05 + 3 * std::sqrt(share / even)) {
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

MissedModes look_for_missed_modes(CheckedDensity& target, const MapResult& result, ModeSearch& search,
                                  std::vector<Mode>& modes, const MissedModesOptions& options) {
  MissedModes out;
  if (options.level != ModeSearchLevel::tempered && modes.size() < 2) return out;  // the online case: no time
  evidence_of(result.verification.log_weight, out.map_log_evidence, out.map_log_evidence_error);
  if (options.level == ModeSearchLevel::none || modes.empty()) return out;
  Search look(target, result, search, modes, options, out);
  if (look.a_mode_is_missed() || options.level == ModeSearchLevel::multi_start) return out;
  const CheckedDensity::Leniency lenient(target);
  if (target.dimension() <= PolarScan::k_max_dimension && look.scans_suffice()) return out;
  // Particles that came from too far and lost their way find less mass than the map has: once more, more of
  // them, from nearer.
  if (!look.particles_elsewhere(1, 120) && !out.tempered_conclusive) (void)look.particles_elsewhere(4, 12);
  return out;
}

}  // namespace knothe::posterior
