#pragma once
/// @file Newton's method in a trust region: the driver, and the subproblem with the exact Hessian.
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "knothe/numerics/optimise/minimiser.hpp"

namespace knothe::numerics {

struct TrustRegionOptions {
  int max_iterations = 200;
  int max_products = 200;             ///< of the Hessian with a vector, per iteration (NewtonCg)
  double gradient_tolerance = 1e-10;  ///< stop when max |gradient| is below
  double decrease_tolerance =
      1e-14;                  ///< stop when the model predicts a smaller decrease than this (absolute)
  double initial_radius = 1;  ///< Euclidean
  double max_radius = 1e3;
  double decrease_at_border = 0;  ///< stop when a step of length `max_radius` gains less than this: x would
                                  ///< go on without end for nearly nothing
};

/// The driver of both methods below: Nocedal and Wright 2006, algorithm 4.1, with a step filter. Keeps its
/// workspace.
class TrustRegion {
 public:
  virtual ~TrustRegion() = default;
  /// Minimises from x, which becomes the best point found.
  MinimiserSummary minimise(Objective& objective, const TrustRegionOptions& options, Eigen::VectorXd& x);

 protected:
  /// `derivatives`: 2 where the subproblem needs the Hessian itself, else 1.
  explicit TrustRegion(int derivatives) : derivatives_(derivatives) {}
  /// step_ = argmin of the model within `radius`, product_ = ∇²f step_.
  virtual void solve_subproblem(Objective& objective, const TrustRegionOptions& options,
                                const Eigen::VectorXd& x, double radius, MinimiserSummary& summary) = 0;

  Eigen::VectorXd gradient_, step_, product_;
  Eigen::MatrixXd hessian_;

 private:
  /// Decrease that the model predicts for the fraction `fraction` of the step.
  [[nodiscard]] double predicted_decrease(double fraction = 1) const {
    return -fraction * (gradient_.dot(step_) + 0.5 * fraction * step_.dot(product_));
  }
  /// Actual over predicted decrease; −1 for a point that is refused.
  [[nodiscard]] double agreement(double value, double trial_value, double predicted) const;

  int derivatives_;
  Eigen::VectorXd trial_, trial_gradient_;
  Eigen::MatrixXd trial_hessian_;
};

/// Newton's method with the exact Hessian. The subproblem by Cholesky factorisations of shifted Hessians
/// (Moré and Sorensen 1983) where the Hessian is positive definite up to rounding, else in the eigenbasis
/// (Nocedal and Wright, section 4.3). Solving again with the same dimension allocates nothing as long as
/// Hessians are positive definite.
class NewtonTrustRegion : public TrustRegion {
 public:
  NewtonTrustRegion() : TrustRegion(2) {}

 private:
  void solve_subproblem(Objective& objective, const TrustRegionOptions& options, const Eigen::VectorXd& x,
                        double radius, MinimiserSummary& summary) override;
  [[nodiscard]] bool solve_by_cholesky(double radius);  ///< false: the Hessian has negative curvature
  void solve_in_eigenbasis(double radius);

  Eigen::VectorXd rotated_;
  Eigen::MatrixXd shifted_;
  Eigen::LLT<Eigen::MatrixXd> cholesky_;
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen_;
};

}  // namespace knothe::numerics
