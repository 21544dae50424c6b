#include "knothe/numerics/optimise/lbfgs.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

namespace {

constexpr double k_decrease = 1e-4, k_curvature = 0.9;

/// Minimiser of the cubic through two values and slopes (Nocedal and Wright 2006, Eq. 3.59), kept away from
/// both ends; the middle where there is none.
double cubic_minimiser(double a, double value_a, double slope_a, double b, double value_b, double slope_b) {
  const double d1 = slope_a + slope_b - 3 * (value_a - value_b) / (a - b);
  const double square = d1 * d1 - slope_a * slope_b, middle = 0.5 * (a + b);
  if (!(square >= 0) || !std::isfinite(square)) return middle;
  const double d2 = std::copysign(std::sqrt(square), b - a);
  const double at = b - (b - a) * (slope_b + d2 - d1) / (slope_b - slope_a + 2 * d2);
  const double low = std::min(a, b), high = std::max(a, b), margin = 0.1 * (high - low);
  return std::isfinite(at) ? std::clamp(at, low + margin, high - margin) : middle;
}

}  // namespace

Lbfgs::Trial Lbfgs::try_length(Objective& objective, const Eigen::VectorXd& x, double length,
                               MinimiserSummary& summary) {
  Trial trial{length, 0, 0};
  trial_ = x + length * direction_;
  ++summary.evaluations;
  if (!objective.evaluate(trial_, 1, trial.value, trial_gradient_, unused_) || !std::isfinite(trial.value))
    trial.value = std::numeric_limits<double>::infinity();
  else
    trial.slope = trial_gradient_.dot(direction_);
  return trial;
}

bool Lbfgs::zoom(Objective& objective, const Eigen::VectorXd& x, const Trial& start, Trial low, Trial high,
                 MinimiserSummary& summary, Trial& accepted) {
  for (int k = 0; k < 40; ++k) {
    const double length = std::isfinite(high.value) ? cubic_minimiser(low.length, low.value, low.slope,
                                                                      high.length, high.value, high.slope)
                                                    : 0.5 * (low.length + high.length);
    const Trial trial = try_length(objective, x, length, summary);
    if (trial.value > start.value + k_decrease * length * start.slope || trial.value >= low.value) {
      high = trial;
    } else {
      if (std::abs(trial.slope) <= -k_curvature * start.slope) {
        accepted = trial;
        return true;
      }
      if (trial.slope * (high.length - low.length) >= 0) high = low;
      low = trial;
    }
    if (std::abs(high.length - low.length) <= 1e-16 * (1 + low.length)) break;
  }
  // Rounding: be content with any decrease.
  if (low.length == 0) return false;
  accepted = try_length(objective, x, low.length, summary);
  return accepted.value < start.value;
}

bool Lbfgs::line_search(Objective& objective, const Eigen::VectorXd& x, double first_length,
                        MinimiserSummary& summary, Trial& accepted) {
  const Trial start{0, summary.value, gradient_.dot(direction_)};
  Trial previous = start;
  double length = first_length;
  for (int k = 0; k < 40; ++k) {
    trial_ = length * direction_;
    const double fraction = objective.step_limit(x, trial_);
    const bool limited = fraction < 1;
    if (limited) {
      ++summary.limited_steps;
      length = std::max(fraction * length, previous.length);
      if (length == previous.length) {  // the border was reached by the step before
        accepted = try_length(objective, x, length, summary);
        return length > 0;
      }
    }
    const Trial trial = try_length(objective, x, length, summary);
    if (trial.value > start.value + k_decrease * length * start.slope ||
        (k > 0 && trial.value >= previous.value))
      return zoom(objective, x, start, previous, trial, summary, accepted);
    if (std::abs(trial.slope) <= -k_curvature * start.slope || (limited && trial.slope < 0)) {
      accepted = trial;
      return true;
    }
    if (trial.slope >= 0) return zoom(objective, x, start, trial, previous, summary, accepted);
    previous = trial;
    length *= 2;
  }
  accepted = try_length(objective, x, previous.length, summary);  // still falling after 2^40 steps
  return true;
}

void Lbfgs::find_direction() {
  direction_ = -gradient_;
  const Index ring = steps_.cols();
  for (Index j = 0; j < kept_; ++j) {  // newest first
    const Index i = (newest_ - j + ring) % ring;
    alpha_[i] = inverse_curvature_[i] * steps_.col(i).dot(direction_);
    direction_ -= alpha_[i] * changes_.col(i);
  }
  if (kept_ > 0) direction_ /= inverse_curvature_[newest_] * changes_.col(newest_).squaredNorm();
  for (Index j = kept_; j-- > 0;) {
    const Index i = (newest_ - j + ring) % ring;
    const double beta = inverse_curvature_[i] * changes_.col(i).dot(direction_);
    direction_ += (alpha_[i] - beta) * steps_.col(i);
  }
}

void Lbfgs::remember() {
  const Index ring = steps_.cols(), at = (newest_ + 1) % ring;
  steps_.col(at) = trial_;  // the caller has put the step there
  changes_.col(at) = trial_gradient_ - gradient_;
  const double curvature = steps_.col(at).dot(changes_.col(at));
  if (!(curvature > 1e-12 * steps_.col(at).norm() * changes_.col(at).norm())) return;
  inverse_curvature_[at] = 1 / curvature;
  newest_ = at;
  kept_ = std::min(kept_ + 1, ring - 1);
}

MinimiserSummary Lbfgs::minimise(Objective& objective, const LbfgsOptions& options, Eigen::VectorXd& x) {
  const Index n = objective.dimension(), memory = std::max(1, options.memory);
  for (auto* v : {&gradient_, &trial_gradient_, &direction_, &trial_}) v->resize(n);
  // One column more than is read, so that a pair without curvature overwrites nothing in use.
  steps_.resize(n, memory + 1);
  changes_.resize(n, memory + 1);
  inverse_curvature_.resize(memory + 1);
  alpha_.resize(memory + 1);
  kept_ = 0, newest_ = -1;
  MinimiserSummary summary;
  summary.evaluations = 1;
  if (!objective.evaluate(x, 1, summary.value, gradient_, unused_) || !std::isfinite(summary.value)) {
    summary.termination = Termination::start_infeasible;
    return summary;
  }
  while (summary.iterations < options.max_iterations) {
    summary.gradient_norm = gradient_.lpNorm<Eigen::Infinity>();
    find_direction();
    if (!(gradient_.dot(direction_) < 0)) {
      kept_ = 0;
      direction_ = -gradient_;
    }
    summary.predicted_decrease = -0.5 * gradient_.dot(direction_);
    if (summary.gradient_norm <= options.gradient_tolerance ||
        (kept_ > 0 && summary.predicted_decrease <= options.decrease_tolerance)) {
      summary.termination = Termination::converged;
      return summary;
    }
    ++summary.iterations;
    Trial accepted;
    const double first_length = kept_ > 0 ? 1 : 1 / std::max(1.0, direction_.norm());
    if (!line_search(objective, x, first_length, summary, accepted)) {
      if (kept_ == 0) {
        summary.termination = Termination::small_step;
        return summary;
      }
      kept_ = 0;  // forget and try the gradient
      continue;
    }
    x.swap(trial_);
    trial_ = x - trial_;
    remember();
    gradient_.swap(trial_gradient_);
    summary.value = accepted.value;
  }
  summary.gradient_norm = gradient_.lpNorm<Eigen::Infinity>();
  return summary;
}

}  // namespace knothe::numerics
