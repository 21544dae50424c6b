#include "knothe/numerics/optimise/trust_region.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/numerics/optimise/trust_region_step.hpp"

namespace knothe::numerics {

namespace {

/// Shifts tried with a Cholesky factorisation each before the eigenbasis, which costs some twenty of them.
constexpr int k_most_shifts = 12;

}  // namespace

const char* describe(Termination termination) {
  switch (termination) {
    case Termination::converged:
      return "converged";
    case Termination::small_step:
      return "no step makes the objective smaller";
    case Termination::iteration_limit:
      return "iteration limit reached";
    case Termination::start_infeasible:
      return "the starting point is outside the feasible set";
  }
  return "";
}

void NewtonTrustRegion::solve_in_eigenbasis(double radius) {
  eigen_.compute(hessian_);
  const auto& values = eigen_.eigenvalues();
  rotated_.noalias() = eigen_.eigenvectors().transpose() * gradient_;
  const double lowest = values[0],
               scale = std::max({std::abs(lowest), std::abs(values[values.size() - 1]), 1e-300});
  const auto norm_at = [&](double shift) {
    return (rotated_.array() / (values.array() + shift)).matrix().norm();
  };
  double shift = 0;
  if (!(lowest > 1e-14 * scale) || norm_at(0) > radius) {
    double low = std::max(0.0, -lowest), high = low + rotated_.norm() / radius + 1e-12 * scale;
    const double floor = low + 1e-13 * scale;
    // |step(shift)| decreases: Newton on 1/|step| − 1/radius, kept between low and high.
    shift = std::max(floor, 0.5 * (low + high));
    for (int k = 0; k < 60; ++k) {
      const double norm = norm_at(shift);
      if (std::abs(norm - radius) <= 1e-3 * radius) break;
      (norm > radius ? low : high) = shift;
      const double slope = (rotated_.array().square() / (values.array() + shift).cube()).sum();
      const double newton = shift + (norm / radius - 1) * norm * norm / slope;
      shift = newton > low && newton < high ? newton : 0.5 * (low + high);
      if (high - low <= 1e-15 * high) break;
      shift = std::max(shift, floor);
      if (shift == floor && norm_at(floor) < radius) break;
    }
  }
  rotated_.array() /= -(values.array() + shift);
  const double missing = radius * radius - rotated_.squaredNorm();
  if (lowest < 0 &&
      missing > 1e-2 * radius * radius)  // hard case: go along the direction of negative curvature
    rotated_[0] += (rotated_[0] < 0 ? -1 : 1) * std::sqrt(missing);
  step_.noalias() = eigen_.eigenvectors() * rotated_;
  if (const double norm = step_.norm(); norm > radius) step_ *= radius / norm;
}

bool NewtonTrustRegion::solve_by_cholesky(double radius) {
  cholesky_.compute(hessian_);
  double shift = 0;
  for (int k = 0; k < k_most_shifts; ++k) {
    if (cholesky_.info() == Eigen::Success) {
      step_ = -gradient_;
      cholesky_.solveInPlace(step_);
      const double norm = step_.norm();
      if (!std::isfinite(norm)) return false;
      if (norm <= 1.001 * radius) {
        if (norm > radius) step_ *= radius / norm;
        return true;
      }
      // Newton on 1/|step| − 1/radius, from the left: |step| falls towards the radius and never below it.
      product_ = step_;
      cholesky_.matrixL().solveInPlace(product_);
      shift += norm * norm / product_.squaredNorm() * (norm - radius) / radius;
    } else if (shift == 0) {
      shift = 1e-13 * hessian_.diagonal().cwiseAbs().maxCoeff();  // indefinite by rounding alone?
    } else {
      return false;
    }
    shifted_ = hessian_;
    shifted_.diagonal().array() += shift;
    cholesky_.compute(shifted_);
  }
  return false;
}

double NewtonTrustRegion::solve_subproblem(double radius) {
  if (!solve_by_cholesky(radius)) solve_in_eigenbasis(radius);
  product_.noalias() = hessian_ * step_;
  return -(gradient_.dot(step_) + 0.5 * step_.dot(product_));
}

MinimiserSummary NewtonTrustRegion::minimise(Objective& objective, const TrustRegionOptions& options,
                                             Eigen::VectorXd& x) {
  const Eigen::Index n = objective.dimension();
  for (auto* v : {&gradient_, &trial_gradient_, &step_, &trial_, &rotated_, &product_}) v->resize(n);
  hessian_.resize(n, n);
  trial_hessian_.resize(n, n);
  MinimiserSummary summary;
  summary.evaluations = 1;
  if (!objective.evaluate(x, 2, summary.value, gradient_, hessian_) || !std::isfinite(summary.value)) {
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
    double predicted = solve_subproblem(radius);
    summary.predicted_decrease = predicted;
    const bool for_nothing =
        predicted < options.decrease_at_border && step_.norm() > 0.99 * options.max_radius;
    if (!(predicted > options.decrease_tolerance) || for_nothing) {
      summary.termination = Termination::converged;
      return summary;
    }
    ++summary.iterations;
    // The step filter: shorten, so that the next point is strictly feasible.
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
    const bool feasible = objective.evaluate(trial_, 2, trial_value, trial_gradient_, trial_hessian_) &&
                          std::isfinite(trial_value);
    const double agreement =
        TrialStep{feasible, predicted, summary.value, trial_value, gradient_.norm(), trial_gradient_.norm(),
                  length}
            .agreement();
    radius = next_radius(radius, options.max_radius, agreement, length);
    if (agreement > k_least_agreement) {
      x.swap(trial_);
      gradient_.swap(trial_gradient_);
      hessian_.swap(trial_hessian_);
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
