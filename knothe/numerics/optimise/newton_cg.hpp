#pragma once
/// @file Newton's method for many variables: products with the Hessian instead of the Hessian.
#include "knothe/numerics/optimise/minimiser.hpp"

namespace knothe::numerics {

struct NewtonCgOptions {
  int max_iterations = 200;
  int max_products = 200;             ///< Hessian-vector products per iteration
  double gradient_tolerance = 1e-10;  ///< stop when max |gradient| is below
  double decrease_tolerance =
      1e-14;                  ///< stop when the model predicts a smaller decrease than this (absolute)
  double initial_radius = 1;  ///< Euclidean
  double max_radius = 1e3;
};

/// Trust-region Newton with the subproblem solved by truncated conjugate gradients (T. Steihaug 1983; Nocedal
/// and Wright 2006, algorithm 7.2): directions of negative curvature are followed to the border of the
/// region. Inner tolerance min(½, √|g|) |g|, hence superlinear convergence. Memory 10 n. Objectives without
/// `hessian_vector` are served by central differences of gradients (two evaluations a product, counted),
/// which cannot reach gradients below some 1e-9 of their first size.
class NewtonCg {
 public:
  /// Minimises from x, which becomes the best point found.
  MinimiserSummary minimise(Objective& objective, const NewtonCgOptions& options, Eigen::VectorXd& x);

 private:
  /// step_ = approximate argmin of the model within `radius`, product_ = ∇² f step_; returns the predicted
  /// decrease.
  double solve_subproblem(Objective& objective, const NewtonCgOptions& options, const Eigen::VectorXd& x,
                          double radius, MinimiserSummary& summary);
  void multiply(Objective& objective, const Eigen::VectorXd& x, const Eigen::VectorXd& v,
                Eigen::VectorXd& product, MinimiserSummary& summary);

  Eigen::VectorXd gradient_, trial_gradient_, step_, trial_, residual_, direction_, curvature_, product_;
  Eigen::VectorXd shifted_, shifted_gradient_;
  Eigen::MatrixXd unused_;
};

}  // namespace knothe::numerics
