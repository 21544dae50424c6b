#include "knothe/posterior/draws/nested_laplace.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/posterior/checked_density.hpp"
#include "knothe/posterior/draws/recycled_importance.hpp"
#include "knothe/posterior/mode_search.hpp"
#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior {
namespace {

using Eigen::Index;

constexpr double k_infinity = std::numeric_limits<double>::infinity();
constexpr Index k_max_first = 4, k_block = 256;
/// Drawn first are the variables along which the curvature in the coordinates of the mode changes by more
/// than this over one standard deviation, and by more than this share of what it does along the worst.
constexpr double k_bending = 0.5, k_bending_share = 0.5;
/// The first draws are spread wider than Laplace's approximation by this.
constexpr double k_widened = 2;
/// A second mode counts whose log-mass is within this of the first.
constexpr double k_counting_mode = 5;

Eigen::MatrixXd symmetric(const LogDensityBatch& batch, Index row, const std::vector<Index>& variables) {
  const auto n = std::ssize(variables);
  Eigen::MatrixXd matrix(n, n);
  for (Index a = 0; a < n; ++a)
    for (Index b = 0; b <= a; ++b)
      matrix(a, b) = matrix(b, a) = batch.hessian(row, packed_index(variables[a], variables[b]));
  return matrix;
}

/// The variables along which the curvature changes most, in increasing order; at least one, not all.
std::vector<Index> variables_that_bend(CheckedDensity& target, const Mode& mode) {
  const Index d = mode.point.size();
  const Eigen::MatrixXd covariance = mode.lower * mode.lower.transpose();
  const Eigen::VectorXd spread = covariance.diagonal().cwiseSqrt();
  Eigen::MatrixXd points(2 * d + 1, d);
  points.row(2 * d) = mode.point.transpose();
  for (Index k = 0; k < d; ++k) {
    const Eigen::VectorXd side = covariance.col(k) / spread[k];
    points.row(2 * k) = (mode.point + side).transpose();
    points.row(2 * k + 1) = (mode.point - side).transpose();
  }
  LogDensityBatch batch;
  target.evaluate_with_differences(points, 2, spread.transpose().replicate(points.rows(), 1), batch);
  std::vector<Index> all(d);
  std::iota(all.begin(), all.end(), Index{0});
  const Eigen::MatrixXd here = symmetric(batch, 2 * d, all);
  Eigen::VectorXd bending = Eigen::VectorXd::Zero(d);
  for (Index i = 0; i < 2 * d; ++i)
    bending[i / 2] = std::max(
        bending[i / 2], (mode.lower.transpose() * (symmetric(batch, i, all) - here) * mode.lower).norm());
  std::stable_sort(all.begin(), all.end(), [&](Index a, Index b) { return bending[a] > bending[b]; });
  const Index most = std::min(k_max_first, d - 1);
  const double least = std::max(k_bending, k_bending_share * bending.maxCoeff());
  Index count = 1;
  while (count < most && bending[all[count]] > least) ++count;
  all.resize(count);
  std::sort(all.begin(), all.end());
  return all;
}

/// Of the other variables x, given θ: N(centre, (L Lᵀ)⁻¹), and log π̃(θ).
struct Conditional {
  Eigen::VectorXd centre;
  Eigen::MatrixXd factor;  ///< L
  double log_marginal = -k_infinity;
};

/// log π̃ at θ = mode + 2 L_θ u, as a density of u but for |2 L_θ|; L_θ L_θᵀ: Laplace's marginal covariance.
class MarginalDensity final : public LogDensity {
 public:
  MarginalDensity(CheckedDensity& target, const Mode& mode, std::vector<Index> first)
      : target_(target), first_(std::move(first)) {
    for (Index k = 0; k < mode.point.size(); ++k)
      if (!std::binary_search(first_.begin(), first_.end(), k)) rest_.push_back(k);
    const Eigen::MatrixXd covariance = mode.lower * mode.lower.transpose();
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance(first_, first_));
    scale_ = k_widened * Eigen::MatrixXd(factor.matrixL());
    regression_ = factor.solve(covariance(first_, rest_)).transpose();
    first_mode_ = mode.point(first_);
    rest_mode_ = mode.point(rest_);
    spread_ = covariance.diagonal().cwiseSqrt();
  }

  [[nodiscard]] Index dimension() const override { return std::ssize(first_); }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  [[nodiscard]] const std::vector<Index>& first() const { return first_; }
  [[nodiscard]] const std::vector<Index>& rest() const { return rest_; }

  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& u, int, LogDensityBatch& out) override {
    for (Index begin = 0; begin < u.rows(); begin += k_block) {
      const Index n = std::min(k_block, u.rows() - begin);
      const auto given = conditionals(u.middleRows(begin, n));
      for (Index i = 0; i < n; ++i) out.value[begin + i] = given[i].log_marginal;
    }
  }

  [[nodiscard]] double log_scale() const { return scale_.diagonal().array().log().sum(); }
  /// θ of u, n × |θ|.
  [[nodiscard]] Eigen::MatrixXd first_of(const Eigen::Ref<const Eigen::MatrixXd>& u) const {
    return (u * scale_.transpose()).rowwise() + first_mode_.transpose();
  }

  /// By Newton's steps in lockstep from the mean that Laplace's approximation has given θ. The last step is
  /// not looked at again: x* is where it leads, to second order.
  [[nodiscard]] std::vector<Conditional> conditionals(const Eigen::Ref<const Eigen::MatrixXd>& u) {
    constexpr int k_max_steps = 40;
    constexpr double k_settled = 1e-3;  ///< what the last step gains, of log π̄
    const Index n = u.rows(), d = target_.dimension();
    const Eigen::MatrixXd theta = first_of(u);
    Eigen::MatrixXd points(n, d);
    points(Eigen::all, first_) = theta;
    points(Eigen::all, rest_) =
        ((theta.rowwise() - first_mode_.transpose()) * regression_.transpose()).rowwise() +
        rest_mode_.transpose();
    std::vector<Conditional> found(n);
    std::vector<Ascent> ascents(n);
    std::vector<Index> active(n);
    std::iota(active.begin(), active.end(), Index{0});
    for (Index i = 0; i < n; ++i) ascents[i].next = points(i, rest_).transpose();
    const CheckedDensity::Leniency lenient(target_);
    for (int step = 0; step < k_max_steps && !active.empty(); ++step) {
      const Eigen::MatrixXd here = points(active, Eigen::all);
      target_.evaluate_with_differences(here, 2, spread_.transpose().replicate(here.rows(), 1), batch_);
      std::vector<Index> still;
      for (std::size_t row = 0; row < active.size(); ++row) {
        const std::size_t i = active[row];
        if (!advance(row, ascents[i], found[i], k_settled)) continue;
        points(active[row], rest_) = ascents[i].next.transpose();
        still.push_back(active[row]);
      }
      active = std::move(still);
    }
    return found;
  }

 private:
  struct Ascent {
    double value = -k_infinity;
    Eigen::VectorXd at, step, next;  ///< the best point so far, the step from it, and where to look
  };

  /// Looks at row `row` of the batch, which belongs to `ascent.next`; false where it is done.
  bool advance(Index row, Ascent& ascent, Conditional& found, double settled) {
    const double value = batch_.value[row];
    if (!(value > ascent.value)) {  // too far, or no density: half the way
      if (ascent.step.size() == 0 || ascent.step.norm() < 1e-12) return false;
      ascent.step *= 0.5;
      ascent.next = ascent.at + ascent.step;
      return true;
    }
    const Eigen::MatrixXd precision = -symmetric(batch_, row, rest_);
    const Eigen::VectorXd slope = batch_.gradient(row, rest_).transpose();
    Eigen::LLT<Eigen::MatrixXd> factor(precision);
    const bool concave = factor.info() == Eigen::Success;
    double damping = 1e-3 * precision.diagonal().cwiseAbs().maxCoeff();
    for (; factor.info() != Eigen::Success && damping < k_infinity; damping *= 10)
      factor.compute(precision + damping * Eigen::MatrixXd::Identity(precision.rows(), precision.cols()));
    ascent.at = ascent.next;
    ascent.value = value;
    ascent.step = factor.solve(slope);
    const double gain = 0.5 * slope.dot(ascent.step);
    if (!std::isfinite(gain)) return false;
    ascent.next = ascent.at + ascent.step;
    if (!concave || gain > settled) return true;
    found.centre = ascent.next;
    found.factor = factor.matrixL();
    found.log_marginal = value + gain - found.factor.diagonal().array().log().sum() +
                         0.5 * rest_.size() * std::log(2 * std::numbers::pi);
    return false;
  }

  CheckedDensity& target_;
  std::vector<Index> first_, rest_;
  Eigen::MatrixXd scale_, regression_;
  Eigen::VectorXd first_mode_, rest_mode_, spread_;
  LogDensityBatch batch_;
};

/// log of the weights π̄(θ, x)/(π̃(θ) q(x | θ)); the points (n × d) are drawn into `points`.
Eigen::VectorXd draw_others(CheckedDensity& target, MarginalDensity& marginal, const Eigen::MatrixXd& u,
                            RandomNumbers& random, Eigen::MatrixXd& points) {
  const auto q = std::ssize(marginal.rest());
  const std::vector<Conditional> given = marginal.conditionals(u);
  Eigen::VectorXd log_weight(u.rows());
  points.resize(u.rows(), target.dimension());
  points(Eigen::all, marginal.first()) = marginal.first_of(u);
  for (Index i = 0; i < u.rows(); ++i) {
    const Conditional& c = given[i];
    log_weight[i] = -k_infinity;
    if (!std::isfinite(c.log_marginal)) {  // has no weight: anywhere
      points(i, marginal.rest()).setZero();
      continue;
    }
    const Eigen::VectorXd xi = random.normals(q, 1);
    points(i, marginal.rest()) =
        (c.centre + c.factor.transpose().triangularView<Eigen::Upper>().solve(xi)).transpose();
    const double log_drawn = c.factor.diagonal().array().log().sum() - 0.5 * xi.squaredNorm() -
                             0.5 * q * std::log(2 * std::numbers::pi);
    log_weight[i] = -c.log_marginal - log_drawn;
  }
  LogDensityBatch batch;
  const CheckedDensity::Leniency lenient(target);
  target.evaluate(points, 0, batch);
  return log_weight + batch.value;
}

}  // namespace

NestedLaplaceResult nested_laplace(LogDensity& user_target, const NestedLaplaceOptions& options) {
  CheckedDensity target(user_target);
  if (target.dimension() < 2)
    throw UsageError("nested Laplace: a density in one variable has no others to draw after it");
  std::vector<Mode> modes;
  ModeSearch().run(target, true, modes);
  MarginalDensity marginal(target, modes.front(), variables_that_bend(target, modes.front()));
  NestedLaplaceResult result;
  result.first = marginal.first();

  // Twice as accurate as the whole has to be: the weights of the others come on top.
  RecycledImportanceOptions of_first;
  of_first.seed = options.seed;
  of_first.looks_beyond = false;
  of_first.share_of_tolerance = 0.5 * ImportanceResult::k_share_of_tolerance;
  of_first.progress = [&](double share) { return !options.progress || options.progress(0.8 * share); };
  const RecycledImportanceResult first = recycled_importance(marginal, of_first);

  const Index n = first.sample.points.rows();
  RandomNumbers random(options.seed);
  Eigen::MatrixXd points(n, target.dimension()), of_block;
  Eigen::VectorXd log_weight(n);
  for (Index begin = 0; begin < n; begin += k_block) {
    const Index count = std::min(k_block, n - begin);
    log_weight.segment(begin, count) =
        draw_others(target, marginal, first.sample.points.middleRows(begin, count), random, of_block);
    points.middleRows(begin, count) = of_block;
    if (options.progress && !options.progress(0.8 + 0.2 * begin / n))
      throw Interrupted(fmt::format("nested Laplace: interrupted after {} draws", begin));
  }
  log_weight.array() += first.sample.weights.array().max(1e-300).log();
  const double top = log_weight.maxCoeff();
  if (!std::isfinite(top))
    throw NumericalError(fmt::format("nested Laplace: the density is zero at all {} draws", n));
  Eigen::VectorXd weights = (log_weight.array() - top).exp();
  const double sum = weights.sum();
  weights /= sum;
  WeightedSample& sample = result.sample;
  sample.points = std::move(points);
  sample.weights = std::move(weights);
  sample.state_evidence(first.sample.log_evidence + marginal.log_scale() + top + std::log(sum));
  sample.density_evaluations = target.evaluations();
  result.state_errors(options.variables ? options.variables(sample.points) : sample.points);
  const bool one_mode = modes.size() == 1 || modes[1].log_mass < modes[0].log_mass - k_counting_mode;
  result.converged = result.converged && one_mode && first.converged;
  return result;
}

}  // namespace knothe::posterior
