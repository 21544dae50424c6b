#include "knothe/numerics/optimise/newton_cg.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/numerics/optimise/trust_region_step.hpp"

namespace knothe::numerics {

namespace {

/// τ ≥ 0 with |step + τ direction| = radius.
double distance_to_border(const Eigen::VectorXd& step, const Eigen::VectorXd& direction, double radius) {
  const double a = direction.squaredNorm(), b = step.dot(direction),
               c = std::max(0.0, radius * radius - step.squaredNorm());
  const double root = std::sqrt(b * b + a * c);
  return b > 0 ? c / (b + root) : (root - b) / a;
}

}  // namespace

void NewtonCg::multiply(Objective& objective, const Eigen::VectorXd& x, const Eigen::VectorXd& v,
                        Eigen::VectorXd& product, MinimiserSummary& summary) {
  if (objective.has_hessian_vector()) {
    objective.hessian_vector(x, v, product);
    return;
  }
  // Central differences over a length that balances cancellation and curvature; nearer at the border.
  double length = 6e-6 * (1 + x.norm()) / v.norm(), value = 0;
  for (int attempt = 0; attempt < 2; ++attempt) {
    shifted_ = length * v;
    const double forward = objective.step_limit(x, shifted_);
    shifted_ = -length * v;
    const double fraction = std::min(forward, objective.step_limit(x, shifted_));
    if (fraction == 1) break;
    length *= fraction;
  }
  product.setZero();
  for (const double sign : {1.0, -1.0}) {
    shifted_ = x + sign * length * v;
    ++summary.evaluations;
    if (!objective.evaluate(shifted_, 1, value, shifted_gradient_, unused_)) shifted_gradient_ = gradient_;
    product += sign / (2 * length) * shifted_gradient_;
  }
}

double NewtonCg::solve_subproblem(Objective& objective, const NewtonCgOptions& options,
                                  const Eigen::VectorXd& x, double radius, MinimiserSummary& summary) {
  step_.setZero();
  product_.setZero();  // ∇² f step_, gathered on the way
  residual_ = gradient_;
  direction_ = -gradient_;
  double square = residual_.squaredNorm();
  const double norm = std::sqrt(square), wanted = std::min(0.5, std::sqrt(norm)) * norm;
  for (int k = 0; k < options.max_products; ++k) {
    multiply(objective, x, direction_, curvature_, summary);
    const double bend = direction_.dot(curvature_);
    const double length = square / bend;
    const bool downward = !(bend > 1e-15 * direction_.squaredNorm());  // negative or no curvature
    if (downward || (step_ + length * direction_).norm() >= radius) {
      const double border = distance_to_border(step_, direction_, radius);
      step_ += border * direction_;
      product_ += border * curvature_;
      break;
    }
    step_ += length * direction_;
    product_ += length * curvature_;
    residual_ += length * curvature_;
    const double next = residual_.squaredNorm();
    if (std::sqrt(next) <= wanted) break;
    direction_ = next / square * direction_ - residual_;
    square = next;
  }
  return -(gradient_.dot(step_) + 0.5 * step_.dot(product_));
}

MinimiserSummary NewtonCg::minimise(Objective& objective, const NewtonCgOptions& options,
                                    Eigen::VectorXd& x) {
  const Eigen::Index n = objective.dimension();
  for (auto* v : {&gradient_, &trial_gradient_, &step_, &trial_, &residual_, &direction_, &curvature_,
                  &product_, &shifted_, &shifted_gradient_})
    v->resize(n);
  MinimiserSummary summary;
  summary.evaluations = 1;
  if (!objective.evaluate(x, 1, summary.value, gradient_, unused_) || !std::isfinite(summary.value)) {
    summary.termination = Termination::start_infeasible;
    return summary;
  }
  double radius = options.initial_radius;
  while (summary.iterations < options.max_iterations) {
    summary.gradient_norm = gradient_.lpNorm<Eigen::Infinity>();
    if (summary.gradient_norm <= options.gradient_tolerance) {
      summary.termination = Termination::converged;
      return summary;
    }
    double predicted = solve_subproblem(objective, options, x, radius, summary);
    summary.predicted_decrease = predicted;
    if (!(predicted > options.decrease_tolerance)) {
      summary.termination = Termination::converged;
      return summary;
    }
    ++summary.iterations;
    const double limit = objective.step_limit(x, step_);
    if (limit < 1) {
      ++summary.limited_steps;
      predicted = -limit * (gradient_.dot(step_) + 0.5 * limit * step_.dot(product_));
      step_ *= limit;
    }
    const double length = step_.norm();
    trial_ = x + step_;
    double trial_value = 0;
    ++summary.evaluations;
    const bool feasible =
        objective.evaluate(trial_, 1, trial_value, trial_gradient_, unused_) && std::isfinite(trial_value);
    const double agreement =
        TrialStep{feasible, predicted, summary.value, trial_value, gradient_.norm(), trial_gradient_.norm(),
                  length}
            .agreement();
    radius = next_radius(radius, options.max_radius, agreement, length);
    if (agreement > k_least_agreement) {
      x.swap(trial_);
      gradient_.swap(trial_gradient_);
      summary.value = trial_value;
    } else if (radius < 1e-14 * (1 + x.norm())) {
      summary.termination = Termination::small_step;
      return summary;
    }
  }
  summary.gradient_norm = gradient_.lpNorm<Eigen::Infinity>();
  return summary;
}

}  // namespace knothe::numerics
