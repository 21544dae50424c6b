#pragma once
/// @file Newton's method for many variables: products with the Hessian instead of the Hessian.
#include "knothe/numerics/optimise/trust_region.hpp"

namespace knothe::numerics {

/// Trust-region Newton with the subproblem solved by truncated conjugate gradients (T. Steihaug 1983; Nocedal
/// and Wright 2006, algorithm 7.2): directions of negative curvature are followed to the border of the
/// region. Inner tolerance min(½, √|g|) |g|, hence superlinear convergence. Memory 10 n. Objectives without
/// `hessian_vector` are served by central differences of gradients (two evaluations a product, counted),
/// which cannot reach gradients below some 1e-9 of their first size.
class NewtonCg : public TrustRegion {
 public:
  NewtonCg() : TrustRegion(1) {}

 private:
  void solve_subproblem(Objective& objective, const TrustRegionOptions& options, const Eigen::VectorXd& x,
                        double radius, MinimiserSummary& summary) override;
  void multiply(Objective& objective, const Eigen::VectorXd& x, const Eigen::VectorXd& v,
                Eigen::VectorXd& product, MinimiserSummary& summary);

  Eigen::VectorXd residual_, direction_, curvature_, shifted_, shifted_gradient_;
};

}  // namespace knothe::numerics
