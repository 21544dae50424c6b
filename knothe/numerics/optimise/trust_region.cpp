#include "knothe/numerics/optimise/trust_region.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

namespace {

/// Shifts tried with a Cholesky factorisation each before the eigenbasis, which costs some twenty of them.
constexpr int k_max_shifts = 12;
/// A step of this agreement is taken.
constexpr double k_min_agreement = 1e-4;

/// The radius after a step: wider where the model held to the border, narrower where it did not hold.
double next_radius(double radius, double max_radius, double agreement, double length) {
  if (!(agreement > k_min_agreement)) return 0.25 * std::min(length, radius);
  if (agreement < 0.25) return 0.5 * length;
  return agreement > 0.75 && length > 0.8 * radius ? std::min(2.5 * radius, max_radius) : radius;
}

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
  for (int k = 0; k < k_max_shifts; ++k) {
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

void NewtonTrustRegion::solve_subproblem(Objective&, const TrustRegionOptions&, const Eigen::VectorXd&,
                                         double radius, MinimiserSummary&) {
  if (!solve_by_cholesky(radius)) solve_in_eigenbasis(radius);
  product_.noalias() = hessian_ * step_;
}

double TrustRegion::agreement(double value, double trial_value, double predicted) const {
  // Below rounding of the value itself the ratio says nothing; then trust the gradient.
  const double noise = 1e-14 * (1 + std::abs(value));
  if (std::abs(predicted) < noise && trial_value <= value + noise)
    return trial_gradient_.norm() <= gradient_.norm() ? 1 : -1;
  return (value - trial_value) / predicted;
}

MinimiserSummary TrustRegion::minimise(Objective& objective, const TrustRegionOptions& options,
                                       Eigen::VectorXd& x) {
  const Index n = objective.dimension();
  for (auto* v : {&gradient_, &trial_gradient_, &step_, &trial_, &product_}) v->resize(n);
  if (derivatives_ == 2)
    for (auto* m : {&hessian_, &trial_hessian_}) m->resize(n, n);
  const auto evaluate = [&](const Eigen::VectorXd& at, double& value, Eigen::VectorXd& gradient,
                            Eigen::MatrixXd& hessian) {
    return objective.evaluate(at, derivatives_, value, gradient, hessian) && std::isfinite(value);
  };
  MinimiserSummary summary;
  summary.evaluations = 1;
  if (!evaluate(x, summary.value, gradient_, hessian_)) {
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
    solve_subproblem(objective, options, x, radius, summary);
    double predicted = summary.predicted_decrease = predicted_decrease();
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
      predicted = predicted_decrease(limit);
      step_ *= limit;
    }
    const double length = step_.norm();
    trial_ = x + step_;
    double trial_value = 0;
    ++summary.evaluations;
    const bool feasible = evaluate(trial_, trial_value, trial_gradient_, trial_hessian_);
    const double agreed = feasible ? agreement(summary.value, trial_value, predicted) : -1;
    radius = next_radius(radius, options.max_radius, agreed, length);
    if (agreed > k_min_agreement) {
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
