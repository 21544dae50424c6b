#include "knothe/numerics/optimise/newton_cg.hpp"

#include <algorithm>
#include <cmath>

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
    if (!objective.evaluate(shifted_, 1, value, shifted_gradient_, hessian_)) shifted_gradient_ = gradient_;
    product += sign / (2 * length) * shifted_gradient_;
  }
}

void NewtonCg::solve_subproblem(Objective& objective, const TrustRegionOptions& options,
                                const Eigen::VectorXd& x, double radius, MinimiserSummary& summary) {
  curvature_.resize(x.size());
  shifted_gradient_.resize(x.size());
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
}

}  // namespace knothe::numerics
