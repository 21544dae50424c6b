#include "knothe/numerics/optimise/nelder_mead.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

double NelderMead::value_at(Objective& objective, const Eigen::VectorXd& from, const Eigen::VectorXd& point,
                            MinimiserSummary& summary) {
  step_ = point - from;
  if (objective.step_limit(from, step_) < 1) {
    ++summary.limited_steps;
    return std::numeric_limits<double>::infinity();
  }
  double value = 0;
  ++summary.evaluations;
  if (!objective.evaluate(point, 0, value, unused_, unused_hessian_) || std::isnan(value))
    return std::numeric_limits<double>::infinity();
  return value;
}

bool NelderMead::run(Objective& objective, const NelderMeadOptions& options, double edge, Eigen::VectorXd& x,
                     MinimiserSummary& summary) {
  const Index n = x.size();
  const double dn = n;
  const double expand = 1 + 2 / dn, contract = 0.75 - 0.5 / dn, shrink = n > 1 ? 1 - 1 / dn : 0.5;
  for (Index j = 0; j <= n; ++j) {
    trial_ = x;
    if (j < n) trial_[j] += edge;
    simplex_.col(j) = trial_;
    values_[j] = value_at(objective, x, trial_, summary);
  }
  for (; summary.iterations < options.max_iterations; ++summary.iterations) {
    Index low = 0, high = 0;
    values_.minCoeff(&low);
    values_.maxCoeff(&high);
    double second = -std::numeric_limits<double>::infinity();
    for (Index j = 0; j <= n; ++j)
      if (j != high) second = std::max(second, values_[j]);
    best_ = simplex_.col(low);
    const double spread = (simplex_.colwise() - best_).cwiseAbs().maxCoeff();
    if (values_[high] - values_[low] <= options.value_tolerance && spread <= options.point_tolerance) break;
    centre_ = (simplex_.rowwise().sum() - simplex_.col(high)) / dn;
    trial_ = 2 * centre_ - simplex_.col(high);
    const double reflected = value_at(objective, best_, trial_, summary);
    if (reflected < values_[low]) {
      other_ = centre_ + expand * (trial_ - centre_);
      const double expanded = value_at(objective, best_, other_, summary);
      simplex_.col(high) = expanded < reflected ? other_ : trial_;
      values_[high] = std::min(expanded, reflected);
      continue;
    }
    if (reflected < second) {
      simplex_.col(high) = trial_;
      values_[high] = reflected;
      continue;
    }
    const bool outside = reflected < values_[high];
    if (outside)
      other_ = centre_ + contract * (trial_ - centre_);
    else
      other_ = centre_ + contract * (simplex_.col(high) - centre_);
    const double contracted = value_at(objective, best_, other_, summary);
    if (contracted < std::min(reflected, values_[high])) {
      simplex_.col(high) = other_;
      values_[high] = contracted;
      continue;
    }
    for (Index j = 0; j <= n; ++j) {
      if (j == low) continue;
      trial_ = best_ + shrink * (simplex_.col(j) - best_);
      simplex_.col(j) = trial_;
      values_[j] = value_at(objective, best_, trial_, summary);
    }
  }
  Index low = 0;
  summary.value = values_.minCoeff(&low);
  x = simplex_.col(low);
  return summary.iterations < options.max_iterations;
}

MinimiserSummary NelderMead::minimise(Objective& objective, const NelderMeadOptions& options,
                                      Eigen::VectorXd& x) {
  const Index n = objective.dimension();
  simplex_.resize(n, n + 1);
  values_.resize(n + 1);
  for (auto* v : {&centre_, &trial_, &other_, &step_, &best_}) v->resize(n);
  MinimiserSummary summary;
  summary.value = value_at(objective, x, x, summary);
  if (!std::isfinite(summary.value)) {
    summary.termination = Termination::start_infeasible;
    return summary;
  }
  bool finished = true;
  for (int k = 0; k <= options.restarts && finished; ++k)
    finished = run(objective, options, options.initial_step * std::pow(0.3, k), x, summary);
  summary.termination = finished ? Termination::converged : Termination::iteration_limit;
  return summary;
}

}  // namespace knothe::numerics
