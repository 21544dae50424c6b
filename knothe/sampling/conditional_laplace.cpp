#include "knothe/sampling/conditional_laplace.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/sampling/mixture.hpp"
#include "knothe/sampling/mixture_fit.hpp"
#include "knothe/sampling/mode_search.hpp"

namespace knothe::sampling {
namespace {

const double k_log_two_pi = std::log(2 * std::numbers::pi);
/// Draws that go through Newton's method together.
constexpr Eigen::Index k_block = 256;
/// Of the leading variables: degrees of freedom, how much wider than fitted they are drawn, and the share of
/// the pilot's own Student's t, which is wider still, in what they are drawn from.
constexpr double k_tails = 8, k_widened = 1.1, k_pilot_widened = 1.3, k_pilot_share = 0.1;
/// Of the others: the share of Student's t, and its degrees of freedom.
constexpr double k_heavy_share = 0.1, k_heavy_tails = 8;
constexpr double k_least_share = 0.1;
/// Rounds go on until the stated errors are this much below the tolerances: they are estimates themselves.
constexpr double k_margin = 0.8;

/// The symmetric matrix in row i of packed Hessians, of some of the variables.
Eigen::MatrixXd unpacked(const Eigen::MatrixXd& hessian, Eigen::Index i,
                         const std::vector<Eigen::Index>& variables) {
  const auto m = static_cast<Eigen::Index>(variables.size());
  Eigen::MatrixXd out(m, m);
  for (Eigen::Index a = 0; a < m; ++a)
    for (Eigen::Index b = 0; b <= a; ++b)
      out(a, b) = out(b, a) = hessian(
          i, packed_index(variables[static_cast<std::size_t>(a)], variables[static_cast<std::size_t>(b)]));
  return out;
}

std::vector<Eigen::Index> all_of(Eigen::Index d) {
  std::vector<Eigen::Index> all(static_cast<std::size_t>(d));
  std::iota(all.begin(), all.end(), Eigen::Index{0});
  return all;
}

/// By how much the Hessian in the mode's own coordinates changes one standard deviation along each variable,
/// the others following as they do on average.
Eigen::VectorXd changes_of_curvature(CheckedDensity& target, const Mode& mode) {
  const Eigen::Index d = mode.point.size();
  const Eigen::MatrixXd covariance = mode.lower * mode.lower.transpose();
  Eigen::MatrixXd points(2 * d + 1, d);
  points.row(2 * d) = mode.point.transpose();
  for (Eigen::Index a = 0; a < d; ++a) {
    const Eigen::VectorXd along = covariance.col(a) / std::sqrt(covariance(a, a));
    points.row(2 * a) = (mode.point + along).transpose();
    points.row(2 * a + 1) = (mode.point - along).transpose();
  }
  LogDensityBatch batch;
  target.evaluate(points, 2, batch);
  const std::vector<Eigen::Index> all = all_of(d);
  const Eigen::MatrixXd at_mode = unpacked(batch.hessian, 2 * d, all);
  Eigen::VectorXd changes = Eigen::VectorXd::Zero(d);
  for (Eigen::Index i = 0; i < 2 * d; ++i)
    changes[i / 2] +=
        (mode.lower.transpose() * (unpacked(batch.hessian, i, all) - at_mode) * mode.lower).squaredNorm();
  return changes.cwiseSqrt();
}

std::vector<Eigen::Index> leading_variables(CheckedDensity& target, const Mode& mode, std::size_t most) {
  const Eigen::VectorXd changes = changes_of_curvature(target, mode);
  std::vector<Eigen::Index> order = all_of(changes.size());
  std::stable_sort(order.begin(), order.end(),
                   [&](Eigen::Index a, Eigen::Index b) { return changes[a] > changes[b]; });
  order.resize(std::min({most, order.size() - 1, order.size()}));
  while (order.size() > 1 && changes[order.back()] < 0.5 * changes[order.front()]) order.pop_back();
  return order;
}

/// What the variables that do not lead are, given those that do.
class Conditional {
 public:
  Conditional(CheckedDensity& target, const Mode& mode, std::vector<Eigen::Index> leading)
      : target_(target), mode_(mode.point), leading_(std::move(leading)) {
    for (Eigen::Index a = 0; a < mode_.size(); ++a)
      if (std::find(leading_.begin(), leading_.end(), a) == leading_.end()) rest_.push_back(a);
    const Eigen::MatrixXd covariance = mode.lower * mode.lower.transpose();
    leading_covariance_ = covariance(leading_, leading_);
    regression_ = leading_covariance_.llt().solve(covariance(leading_, rest_)).transpose();
  }

  [[nodiscard]] const Eigen::MatrixXd& leading_covariance() const { return leading_covariance_; }

  /// At leading variables θ (n × k): Laplace's approximation of their log marginal density. Kept for `draw`:
  /// modes and curvatures of the others.
  Eigen::VectorXd laplace(const Eigen::MatrixXd& theta) {
    const Eigen::Index n = theta.rows(), m = static_cast<Eigen::Index>(rest_.size());
    points_.resize(n, mode_.size());
    points_(Eigen::all, leading_) = theta;
    points_(Eigen::all, rest_) =
        ((theta.rowwise() - mode_(leading_).transpose()) * regression_.transpose()).rowwise() +
        mode_(rest_).transpose();
    climb();
    Eigen::VectorXd out(n);
    for (Eigen::Index i = 0; i < n; ++i)
      out[i] = value_[i] + 0.5 * static_cast<double>(m) * k_log_two_pi - log_root(i);
    return out;
  }

  /// All variables, drawn at the θ of the last `laplace`, and the log-density of the draws given θ.
  void draw(RandomNumbers& random, Eigen::MatrixXd& points, Eigen::VectorXd& log_density) const {
    const Eigen::Index n = points_.rows(), m = static_cast<Eigen::Index>(rest_.size());
    points = points_;
    log_density.resize(n);
    Eigen::VectorXd unit(m);
    for (Eigen::Index i = 0; i < n; ++i) {
      const bool is_heavy = random.uniform() < k_heavy_share;
      double chi_squared = 0;
      for (int j = 0; j < static_cast<int>(k_heavy_tails) / 2; ++j)
        chi_squared -= 2 * std::log(random.uniform());
      for (Eigen::Index j = 0; j < m; ++j) unit[j] = random.normal();
      if (is_heavy) unit /= std::sqrt(chi_squared / k_heavy_tails);
      log_density[i] = log_unit_density(unit.squaredNorm(), static_cast<double>(m)) + log_root(i);
      roots_[static_cast<std::size_t>(i)].transpose().triangularView<Eigen::Upper>().solveInPlace(unit);
      for (Eigen::Index j = 0; j < m; ++j) points(i, rest_[static_cast<std::size_t>(j)]) += unit[j];
    }
  }

 private:
  [[nodiscard]] static double log_unit_density(double squared, double m) {
    const double gaussian = -0.5 * (squared + m * k_log_two_pi);
    const double heavy = std::lgamma(0.5 * (k_heavy_tails + m)) - std::lgamma(0.5 * k_heavy_tails) -
                         0.5 * m * std::log(k_heavy_tails * std::numbers::pi) -
                         0.5 * (k_heavy_tails + m) * std::log1p(squared / k_heavy_tails);
    const double a = std::log(1 - k_heavy_share) + gaussian, b = std::log(k_heavy_share) + heavy;
    return std::max(a, b) + std::log1p(std::exp(-std::abs(a - b)));
  }
  [[nodiscard]] double log_root(Eigen::Index i) const {
    return roots_[static_cast<std::size_t>(i)].diagonal().array().log().sum();
  }

  /// −∇² in the rest, made positive definite; its Cholesky factor is kept.
  void factorise(Eigen::Index i, Eigen::Index row) {
    Eigen::MatrixXd curvature = -unpacked(batch_.hessian, row, rest_);
    double shift = 0;
    for (int attempt = 0; attempt < 60; ++attempt) {
      const Eigen::LLT<Eigen::MatrixXd> factor(curvature);
      if (factor.info() == Eigen::Success) {
        roots_[static_cast<std::size_t>(i)] = factor.matrixL();
        return;
      }
      const double more =
          std::max(2 * shift, 1e-3 * std::max(curvature.diagonal().cwiseAbs().maxCoeff(), 1e-300));
      curvature.diagonal().array() += more - shift;
      shift = more;
    }
    roots_[static_cast<std::size_t>(i)].setIdentity(curvature.rows(), curvature.cols());
  }

  /// Newton's method for the rest of `points_`, all at once; a step that does not raise the density is halved.
  void climb() {
    const Eigen::Index n = points_.rows(), m = static_cast<Eigen::Index>(rest_.size());
    constexpr int k_max_steps = 50;
    constexpr double k_gain = 1e-8;
    roots_.assign(static_cast<std::size_t>(n), Eigen::MatrixXd::Identity(m, m));
    value_.setConstant(n, -std::numeric_limits<double>::infinity());
    Eigen::MatrixXd trial = points_, step = Eigen::MatrixXd::Zero(n, m);
    std::vector<Eigen::Index> active = all_of(n), still;
    for (int round = 0; round < k_max_steps && !active.empty(); ++round) {
      target_.evaluate(trial(active, Eigen::all), 2, batch_);
      still.clear();
      for (std::size_t r = 0; r < active.size(); ++r) {
        const Eigen::Index i = active[r], row = static_cast<Eigen::Index>(r);
        if (!(batch_.value[row] > CheckedDensity::k_min_log_density)) {
          if (round == 0) continue;  // nothing there: its weight will say so
          step.row(i) *= 0.5;
        } else if (batch_.value[row] >= value_[i]) {
          points_.row(i) = trial.row(i);
          value_[i] = batch_.value[row];
          factorise(i, row);
          Eigen::VectorXd slope = batch_.gradient(row, rest_).transpose(), newton = slope;
          const Eigen::MatrixXd& root = roots_[static_cast<std::size_t>(i)];
          root.triangularView<Eigen::Lower>().solveInPlace(newton);
          if (0.5 * newton.squaredNorm() < k_gain) continue;
          root.transpose().triangularView<Eigen::Upper>().solveInPlace(newton);
          step.row(i) = newton.transpose();
        } else {
          step.row(i) *= 0.5;
        }
        for (Eigen::Index j = 0; j < m; ++j) {
          const Eigen::Index a = rest_[static_cast<std::size_t>(j)];
          trial(i, a) = points_(i, a) + step(i, j);
        }
        still.push_back(i);
      }
      active.swap(still);
    }
  }

  CheckedDensity& target_;
  Eigen::VectorXd mode_;
  std::vector<Eigen::Index> leading_, rest_;
  Eigen::MatrixXd leading_covariance_, regression_;
  Eigen::MatrixXd points_;  ///< n × d: θ, and the mode of the others
  Eigen::VectorXd value_;   ///< n, log π̄ there
  std::vector<Eigen::MatrixXd> roots_;
  LogDensityBatch batch_;
};

/// What θ is drawn from: first the Laplace approximation of the whole, then what is fitted to those draws, with
/// the weights of their own marginal density, until they are worth something.
Mixture fitted(Conditional& conditional, const Eigen::VectorXd& centre, Eigen::Index n,
               RandomNumbers& random) {
  constexpr int k_max_rounds = 8;
  constexpr double k_good_share = 0.4;
  MixtureComponent pilot{1, centre,
                         k_pilot_widened * conditional.leading_covariance().llt().matrixL().toDenseMatrix()};
  Mixture proposal({pilot}, k_tails);
  for (int round = 0; round < k_max_rounds; ++round) {
    const Eigen::MatrixXd theta = proposal.sample(n, random);
    Eigen::VectorXd log_weight(n), log_drawn;
    proposal.log_density(theta, log_drawn);
    for (Eigen::Index begin = 0; begin < n; begin += k_block) {
      const Eigen::Index size = std::min(k_block, n - begin);
      log_weight.segment(begin, size) = conditional.laplace(theta.middleRows(begin, size));
    }
    log_weight -= log_drawn;
    Eigen::VectorXd weights = (log_weight.array() - log_weight.maxCoeff()).exp();
    weights /= weights.sum();
    const double share = 1 / (weights.squaredNorm() * static_cast<double>(n));
    weights = weights.cwiseMin(1 / std::sqrt(static_cast<double>(n)));  // Ionides 2008
    weights /= weights.sum();
    std::vector<MixtureComponent> parts = fit_mixture(theta, weights);
    double total = 0;
    for (MixtureComponent& part : parts) part.lower *= k_widened, total += part.weight;
    pilot.weight = total * k_pilot_share / (1 - k_pilot_share);
    parts.push_back(pilot);
    proposal = Mixture(std::move(parts), k_tails);
    if (share >= k_good_share) break;
  }
  return proposal;
}

void state(const ConditionalLaplaceOptions& options, const Eigen::VectorXd& log_weight,
           ConditionalLaplaceResult& r) {
  const double n = static_cast<double>(log_weight.size()), largest = log_weight.maxCoeff();
  r.sample.weights = (log_weight.array() - largest).exp();
  const double sum = r.sample.weights.sum();
  r.sample.weights /= sum;
  r.sample.effective_size = 1 / r.sample.weights.squaredNorm();
  r.sample.log_evidence = largest + std::log(sum / n);
  r.sample.log_evidence_error = std::sqrt(std::max(0.0, 1 / r.sample.effective_size - 1 / n));
  r.sample.has_evidence = true;
  const MomentErrors errors = standard_errors(r.sample.points, r.sample.weights);
  r.mean_error = 4 * errors.mean;
  r.deviation_error = 4 * errors.deviation;
  r.converged = !r.second_mode_found && r.mean_error <= options.mean_tolerance &&
                r.deviation_error <= options.deviation_tolerance &&
                r.sample.effective_size >= k_least_share * n;
}

}  // namespace

ConditionalLaplaceResult conditional_laplace(LogDensity& user_target,
                                             const ConditionalLaplaceOptions& options) {
  CheckedDensity target(user_target);
  const Eigen::Index d = target.dimension();
  if (d < 2 || target.available_derivatives() < 2)
    throw UsageError(
        fmt::format("conditional Laplace: a density in {} dimensions with derivatives of order {}; at least 2 "
                    "of each are needed",
                    d, target.available_derivatives()));
  std::vector<Mode> modes;
  ModeSearch().run(target, true, modes);
  ConditionalLaplaceResult result;
  result.second_mode_found =
      modes.size() > 1 && modes[1].log_mass > modes[0].log_mass + std::log(options.mode_mass);
  const CheckedDensity::Leniency lenient(target);
  result.leading = leading_variables(target, modes.front(), options.max_leading);
  Conditional conditional(target, modes.front(), result.leading);
  RandomNumbers random(options.seed);
  const Mixture proposal =
      fitted(conditional, modes.front().point(result.leading), options.pilot_draws, random);
  Eigen::VectorXd log_weight, log_drawn, log_given;
  Eigen::MatrixXd points;
  LogDensityBatch batch;
  for (Eigen::Index n = options.first_draws; n <= options.max_draws; n *= 2) {
    const Eigen::Index before = log_weight.size();
    result.sample.points.conservativeResize(n, d);
    log_weight.conservativeResize(n);
    const Eigen::MatrixXd theta = proposal.sample(n - before, random);
    proposal.log_density(theta, log_drawn);
    for (Eigen::Index begin = 0; begin < n - before; begin += k_block) {
      const Eigen::Index size = std::min(k_block, n - before - begin);
      (void)conditional.laplace(theta.middleRows(begin, size));
      conditional.draw(random, points, log_given);
      target.evaluate(points, 0, batch);
      result.sample.points.middleRows(before + begin, size) = points;
      log_weight.segment(before + begin, size) = batch.value - log_drawn.segment(begin, size) - log_given;
    }
    state(options, log_weight, result);
    if (result.converged && result.mean_error <= k_margin * options.mean_tolerance &&
        result.deviation_error <= k_margin * options.deviation_tolerance)
      break;
  }
  result.sample.density_evaluations = target.evaluations();
  return result;
}

}  // namespace knothe::sampling
