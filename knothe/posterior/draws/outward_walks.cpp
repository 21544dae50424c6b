#include "knothe/posterior/draws/outward_walks.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {
namespace {

/// Up to this dimension steps have the shape of the whole Hessian, beyond of its diagonal.
constexpr Eigen::Index k_full_shape = 4;
/// A draw at either end of a variable has so much of the mass beyond it.
constexpr double k_beyond = 1e-3;
constexpr Eigen::Index k_telling = 4, k_heaviest = 2;
/// What one draw may move: a third of what is tolerated.
constexpr double k_mean_shift = ImportanceResult::k_mean_tolerance / 3,
                 k_deviation_shift = ImportanceResult::k_deviation_tolerance / 3;
constexpr std::size_t k_places = 8;
constexpr double k_widened = 1.5;

Eigen::Index steps_between_shapes(Eigen::Index d) {
  return d > k_full_shape ? 40 : std::max<Eigen::Index>(8, d * (d + 1));
}

Eigen::MatrixXd factor_of(Eigen::MatrixXd covariance) {
  for (Eigen::Index k = 0; k < covariance.rows(); ++k)
    covariance(k, k) = covariance(k, k) * (1 + 1e-10) + std::numeric_limits<double>::min();
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  if (factor.info() == Eigen::Success) return factor.matrixL();
  return covariance.diagonal().cwiseSqrt().asDiagonal();
}

/// Moments of the variables, and how much one draw moves them.
class Influence {
 public:
  explicit Influence(const DrawsToJudge& draws) : draws_(draws) {
    Eigen::MatrixXd covariance;
    numerics::mean_and_covariance(draws.variables, draws.weights, mean_, covariance);
    deviation_ = covariance.diagonal().cwiseMax(1e-300).cwiseSqrt();
  }
  /// The largest of all variables for a draw of this weight at `variables` (1 × k).
  void add(const Eigen::Ref<const Eigen::RowVectorXd>& variables, double weight, double& mean,
           double& deviation) const {
    for (Eigen::Index k = 0; k < variables.size(); ++k) {
      const double t = std::abs(variables[k] - mean_[k]) / deviation_[k];
      mean = std::max(mean, weight * t);
      deviation = std::max(deviation, 0.5 * weight * std::abs(t * t - 1));
    }
  }
  /// n: that of each draw, in shares of what it may be.
  [[nodiscard]] Eigen::VectorXd of_draws() const {
    Eigen::VectorXd all(draws_.weights.size());
    for (Eigen::Index i = 0; i < all.size(); ++i) {
      double mean = 0, deviation = 0;
      add(draws_.variables.row(i), draws_.weights[i], mean, deviation);
      all[i] = std::max(mean / k_mean_shift, deviation / k_deviation_shift);
    }
    return all;
  }

 private:
  const DrawsToJudge& draws_;
  Eigen::VectorXd mean_, deviation_;
};

/// The draws with the largest of these numbers.
std::vector<Eigen::Index> largest(const Eigen::VectorXd& of_draws, Eigen::Index most) {
  std::vector<Eigen::Index> order(of_draws.size());
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  const Eigen::Index count = std::min(most, std::ssize(order));
  std::partial_sort(order.begin(), order.begin() + count, order.end(),
                    [&](Eigen::Index a, Eigen::Index b) { return of_draws[a] > of_draws[b]; });
  order.resize(count);
  return order;
}

/// Draws at both ends of the variables, and those that tell most.
std::vector<Eigen::Index> starts_of(const DrawsToJudge& draws, const Influence& influence,
                                    const OutwardWalkOptions& options) {
  std::set<Eigen::Index> starts;
  const Eigen::Index count = draws.variables.cols(), chosen = std::min(count, options.most_variables);
  std::vector<Eigen::Index> order(draws.weights.size());
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  for (Eigen::Index c = 0; c < chosen; ++c) {
    const Eigen::Index k = (options.seed * chosen + c) % count;
    std::sort(order.begin(), order.end(),
              [&](Eigen::Index a, Eigen::Index b) { return draws.variables(a, k) < draws.variables(b, k); });
    const auto end = [&](auto begin, auto finish) {
      double beyond = 0;
      for (auto i = begin; i != finish; ++i)
        if ((beyond += draws.weights[*i]) >= k_beyond) return *i;
      return *begin;
    };
    starts.insert(end(order.begin(), order.end()));
    starts.insert(end(order.rbegin(), order.rend()));
  }
  const std::vector<Eigen::Index> telling = largest(influence.of_draws(), k_telling);
  starts.insert(telling.begin(), telling.end());
  return {starts.begin(), starts.end()};
}

/// All walks, in lockstep.
class Walks {
 public:
  /// The last `climbing` of them only ever go up.
  Walks(CheckedDensity& target, Eigen::MatrixXd starts, Eigen::Index climbing, const Eigen::MatrixXd& lower,
        std::uint64_t seed)
      : target_(target),
        first_climbing_(starts.rows() - climbing),
        random_(seed),
        lower_(lower),
        position_(std::move(starts)),
        log_scale_(Eigen::VectorXd::Constant(position_.rows(), std::log(1.7 / std::sqrt(position_.cols())))),
        shapes_(position_.rows(), lower) {
    target_.evaluate(position_, 0, batch_);
    value_ = batch_.value;
  }

  /// Steps become those of the target's curvature where the walks are, nowhere longer than the draws' spread.
  void take_shapes() { position_.cols() <= k_full_shape ? take_hessians() : take_diagonals(); }

  /// One step of each; those that have moved.
  std::vector<Eigen::Index> advance() {
    constexpr double k_wanted = 0.3, k_gain = 0.6;
    const Eigen::Index n = position_.rows(), d = position_.cols();
    Eigen::MatrixXd proposal(n, d);
    for (Eigen::Index i = 0; i < n; ++i)
      proposal.row(i) =
          position_.row(i) + std::exp(log_scale_[i]) * (shapes_[i] * random_.normals(d, 1)).transpose();
    target_.evaluate(proposal, 0, batch_);
    std::vector<Eigen::Index> moved;
    for (Eigen::Index i = 0; i < n; ++i) {
      const double log_ratio = batch_.value[i] - value_[i];
      log_scale_[i] =
          std::clamp(log_scale_[i] + k_gain * (std::exp(std::min(0.0, log_ratio)) - k_wanted), -20.0, 1.0);
      const double least = std::log(random_.uniform());
      if (!((i < first_climbing_ ? least : 0) < log_ratio)) continue;
      position_.row(i) = proposal.row(i);
      value_[i] = batch_.value[i];
      moved.push_back(i);
    }
    return moved;
  }

  [[nodiscard]] const Eigen::MatrixXd& position() const { return position_; }
  [[nodiscard]] const Eigen::VectorXd& value() const { return value_; }
  [[nodiscard]] const Eigen::MatrixXd& shape(Eigen::Index i) const { return shapes_[i]; }

 private:
  void take_hessians() {
    const Eigen::Index n = position_.rows(), d = position_.cols();
    const Eigen::MatrixXd scales =
        (0.1 * lower_.diagonal().transpose()).replicate(n, 1).cwiseMax(std::numeric_limits<double>::min());
    target_.evaluate_with_differences(position_, 2, scales, batch_);
    Eigen::MatrixXd hessian(d, d);
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index a = 0; a < d; ++a)
        for (Eigen::Index b = 0; b < d; ++b) hessian(a, b) = batch_.hessian(i, packed_index(a, b));
      const Eigen::MatrixXd whitened = lower_.transpose() * hessian * lower_;
      if (!whitened.allFinite()) continue;
      const numerics::SymmetricEigen eigen(whitened);
      shapes_[i] = lower_ * eigen.eigenvectors() *
                   eigen.eigenvalues().cwiseAbs().cwiseMax(1).cwiseSqrt().cwiseInverse().asDiagonal();
    }
  }

  void take_diagonals() {
    constexpr double k_step = 0.05;
    const Eigen::Index n = position_.rows(), d = position_.cols();
    for (Eigen::Index i = 0; i < n; ++i) {
      Eigen::MatrixXd sides(2 * d, d);
      for (Eigen::Index a = 0; a < d; ++a) {
        sides.row(2 * a) = position_.row(i) + k_step * lower_.col(a).transpose();
        sides.row(2 * a + 1) = position_.row(i) - k_step * lower_.col(a).transpose();
      }
      target_.evaluate(sides, 0, batch_);
      for (Eigen::Index a = 0; a < d; ++a) {
        const double bend =
            std::abs(batch_.value[2 * a] + batch_.value[2 * a + 1] - 2 * value_[i]) / (k_step * k_step);
        shapes_[i].col(a) = lower_.col(a) / std::sqrt(std::clamp(bend, 1.0, 1e12));
      }
    }
  }

  CheckedDensity& target_;
  Eigen::Index first_climbing_;
  RandomNumbers random_;
  const Eigen::MatrixXd& lower_;
  Eigen::MatrixXd position_;
  Eigen::VectorXd value_, log_scale_;
  std::vector<Eigen::MatrixXd> shapes_;
  LogDensityBatch batch_;
};

/// A state of a walk, and what the target looks like there.
struct Place {
  Eigen::VectorXd point;
  double share = 0;  ///< of the influence that a draw may have
  Eigen::MatrixXd shape;
};

/// The places that tell most, none of them near another by its own measure.
std::vector<MixtureComponent> choose(std::vector<Place> places) {
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.share > b.share; });
  std::vector<MixtureComponent> chosen;
  for (const Place& place : places) {
    if (chosen.size() == k_places) break;
    const bool near = std::any_of(chosen.begin(), chosen.end(), [&](const MixtureComponent& c) {
      return c.lower.triangularView<Eigen::Lower>().solve(place.point - c.centre).norm() < 1;
    });
    if (near) continue;
    const Eigen::MatrixXd covariance = k_widened * k_widened * place.shape * place.shape.transpose();
    chosen.push_back({1, place.point, factor_of(covariance)});
  }
  return chosen;
}

}  // namespace

MassBeyond walk_outwards(CheckedDensity& target, const DrawsToJudge& draws,
                         const OutwardWalkOptions& options) {
  const Influence influence(draws);
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  numerics::mean_and_covariance(draws.points, draws.weights, mean, covariance);
  const Eigen::MatrixXd lower = factor_of(covariance);
  const std::vector<Eigen::Index> chosen = starts_of(draws, influence, options);
  // The heaviest draws may lie at the foot of a narrow peak in the middle of the others.
  const std::vector<Eigen::Index> heaviest = largest(draws.weights, k_heaviest);
  Eigen::MatrixXd starts(std::ssize(chosen) + draws.more_starts.rows() + std::ssize(heaviest),
                         target.dimension());
  starts.topRows(std::ssize(chosen)) = draws.points(chosen, Eigen::all);
  if (draws.more_starts.rows() > 0)
    starts.middleRows(std::ssize(chosen), draws.more_starts.rows()) = draws.more_starts;
  starts.bottomRows(std::ssize(heaviest)) = draws.points(heaviest, Eigen::all);
  Walks walks(target, std::move(starts), std::ssize(heaviest), lower, options.seed);
  MassBeyond beyond;
  std::vector<Place> places;
  for (int step = 0; step < options.steps; ++step) {
    if (step % steps_between_shapes(target.dimension()) == 0) walks.take_shapes();
    const std::vector<Eigen::Index> moved = walks.advance();
    if (moved.empty()) continue;
    const Eigen::MatrixXd points = walks.position()(moved, Eigen::all);
    const Eigen::VectorXd log_weight = draws.log_weight(points, walks.value()(moved));
    const Eigen::MatrixXd variables = draws.to_variables ? draws.to_variables(points) : points;
    for (Eigen::Index j = 0; j < points.rows(); ++j) {
      double of_mean = 0, of_deviation = 0;
      influence.add(variables.row(j), std::exp(std::min(0.0, log_weight[j])), of_mean, of_deviation);
      const double share = std::max(of_mean / k_mean_shift, of_deviation / k_deviation_shift);
      beyond.mean_shift = std::max(beyond.mean_shift, of_mean);
      beyond.deviation_shift = std::max(beyond.deviation_shift, of_deviation);
      if (share > 1) places.push_back({points.row(j).transpose(), share, walks.shape(moved[j])});
    }
  }
  beyond.places = choose(std::move(places));
  return beyond;
}

std::int64_t cost_of_walks(Eigen::Index d, Eigen::Index more_starts, const OutwardWalkOptions& options) {
  const std::int64_t walks = 2 * std::min(d, options.most_variables) + k_telling + k_heaviest + more_starts;
  const std::int64_t shape = d > k_full_shape ? 2 * d : 1 + d + d * d;
  const std::int64_t between = steps_between_shapes(d), shapes = (options.steps + between - 1) / between;
  return walks * (1 + options.steps + shapes * shape);
}

}  // namespace knothe::posterior
