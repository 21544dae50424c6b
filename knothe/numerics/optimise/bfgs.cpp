#include "knothe/numerics/optimise/bfgs.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

bool Bfgs::line_search(Objective& objective, const Eigen::VectorXd& x, MinimiserSummary& summary,
                       double& trial_value) {
  constexpr double k_decrease = 1e-4, k_curvature = 0.9;
  const double slope = gradient_.dot(direction_);
  const double limit = objective.step_limit(x, direction_);
  if (limit < 1) ++summary.limited_steps;
  double low = 0, high = limit, t = limit, accepted = 0;
  bool bracketed = limit < 1;
  for (int k = 0; k < 60; ++k) {
    trial_ = x + t * direction_;
    ++summary.evaluations;
    const bool good = objective.evaluate(trial_, 1, trial_value, trial_gradient_, unused_) &&
                      std::isfinite(trial_value) && trial_value <= summary.value + k_decrease * t * slope;
    if (!good) {
      high = t;
      bracketed = true;
      if (accepted > 0 && k > 8) break;
    } else {
      accepted = t;
      low = t;
      if (trial_gradient_.dot(direction_) >= k_curvature * slope || (bracketed && t == limit)) return true;
    }
    if (!bracketed) {
      t = 2 * t;
      const Eigen::VectorXd& longer = step_ = t * direction_;
      const double fraction = objective.step_limit(x, longer);
      if (fraction < 1) return true;  // the border of the feasible set is near: be content
    } else {
      t = 0.5 * (low + high);
    }
    if (high - low < 1e-16 && bracketed) break;
  }
  if (accepted == 0) return false;
  trial_ = x + accepted * direction_;
  ++summary.evaluations;
  return objective.evaluate(trial_, 1, trial_value, trial_gradient_, unused_);
}

void Bfgs::update_inverse_hessian(bool first) {
  const double curvature = step_.dot(change_);
  if (!(curvature > 1e-12 * step_.norm() * change_.norm())) return;  // keeps it positive definite
  if (first) inverse_hessian_.setIdentity(), inverse_hessian_ *= curvature / change_.squaredNorm();
  product_.noalias() = inverse_hessian_ * change_;
  const double factor = (1 + change_.dot(product_) / curvature) / curvature;
  inverse_hessian_.noalias() += factor * step_ * step_.transpose();
  inverse_hessian_.noalias() -= (product_ / curvature) * step_.transpose();
  inverse_hessian_.noalias() -= (step_ / curvature) * product_.transpose();
}

MinimiserSummary Bfgs::minimise(Objective& objective, const BfgsOptions& options, Eigen::VectorXd& x) {
  const Index n = objective.dimension();
  for (auto* v : {&gradient_, &trial_gradient_, &direction_, &trial_, &step_, &change_, &product_})
    v->resize(n);
  inverse_hessian_.setIdentity(n, n);
  MinimiserSummary summary;
  summary.evaluations = 1;
  if (!objective.evaluate(x, 1, summary.value, gradient_, unused_) || !std::isfinite(summary.value)) {
    summary.termination = Termination::start_infeasible;
    return summary;
  }
  bool fresh = true;  // the inverse Hessian knows nothing yet
  while (summary.iterations < options.max_iterations) {
    summary.gradient_norm = gradient_.lpNorm<Eigen::Infinity>();
    direction_.noalias() = -(inverse_hessian_ * gradient_);
    if (fresh) direction_ /= std::max(1.0, direction_.norm());
    summary.predicted_decrease = -0.5 * gradient_.dot(direction_);
    if (summary.gradient_norm <= options.gradient_tolerance ||
        (!fresh && summary.predicted_decrease <= options.decrease_tolerance)) {
      summary.termination = Termination::converged;
      return summary;
    }
    ++summary.iterations;
    double trial_value = 0;
    if (!line_search(objective, x, summary, trial_value)) {
      if (fresh) {
        summary.termination = Termination::small_step;
        return summary;
      }
      inverse_hessian_.setIdentity();
      fresh = true;
      continue;
    }
    step_ = trial_ - x;
    change_ = trial_gradient_ - gradient_;
    update_inverse_hessian(fresh);
    fresh = false;
    x.swap(trial_);
    gradient_.swap(trial_gradient_);
    summary.value = trial_value;
  }
  summary.gradient_norm = gradient_.lpNorm<Eigen::Infinity>();
  return summary;
}

}  // namespace knothe::numerics
