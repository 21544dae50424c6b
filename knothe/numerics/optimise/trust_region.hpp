#pragma once
/// @file Newton's method with exact Hessian in a trust region.
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "knothe/numerics/optimise/minimiser.hpp"

namespace knothe::numerics {

struct TrustRegionOptions {
  int max_iterations = 100;
  double gradient_tolerance = 1e-10;  ///< stop when max |gradient| is below
  double decrease_tolerance =
      1e-14;                  ///< stop when the model predicts a smaller decrease than this (absolute)
  double initial_radius = 1;  ///< Euclidean
  double max_radius = 1e3;
  double decrease_at_border = 0;  ///< stop when a step of length `max_radius` gains less than this: x would
                                  ///< go on without end for nearly nothing
};

/// Newton trust region (Nocedal and Wright 2006, algorithm 4.1; the subproblem by Cholesky
/// factorisations of shifted Hessians, Moré and Sorensen 1983, where the Hessian is positive definite up to
/// rounding, else in the eigenbasis, section 4.3). Keeps its workspace: solving again with the same dimension
/// allocates nothing as long as Hessians are positive definite.
class NewtonTrustRegion {
 public:
  /// Minimises from x, which becomes the best point found.
  MinimiserSummary minimise(Objective& objective, const TrustRegionOptions& options, Eigen::VectorXd& x);

 private:
  /// step_ = argmin of the model within `radius`; returns the predicted decrease.
  double solve_subproblem(double radius);
  [[nodiscard]] bool solve_by_cholesky(double radius);  ///< false: the Hessian has negative curvature
  void solve_in_eigenbasis(double radius);

  Eigen::VectorXd gradient_, trial_gradient_, step_, trial_, rotated_, product_;
  Eigen::MatrixXd hessian_, trial_hessian_, shifted_;
  Eigen::LLT<Eigen::MatrixXd> cholesky_;
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen_;
};

}  // namespace knothe::numerics
