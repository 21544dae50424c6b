#pragma once
/// @file The quasi-Newton method of Broyden, Fletcher, Goldfarb and Shanno, for objectives with gradient.
#include "knothe/numerics/optimise/minimiser.hpp"

namespace knothe::numerics {

struct BfgsOptions {
  int max_iterations = 500;
  double gradient_tolerance = 1e-8;   ///< stop when max |gradient| is below
  double decrease_tolerance = 1e-15;  ///< stop when gᵀ B⁻¹ g / 2 is below
};

/// BFGS on the inverse Hessian (Nocedal and Wright 2006, algorithm 6.1) with a bisection line search for the
/// weak Wolfe conditions (Lewis and Overton 2013); steps stay in the feasible set. Keeps its workspace.
class Bfgs {
 public:
  MinimiserSummary minimise(Objective& objective, const BfgsOptions& options, Eigen::VectorXd& x);

 private:
  /// Finds a step along direction_; false if there is none. Fills trial_, trial_gradient_, trial_value.
  bool line_search(Objective& objective, const Eigen::VectorXd& x, MinimiserSummary& summary,
                   double& trial_value);
  void update_inverse_hessian(bool first);

  Eigen::VectorXd gradient_, trial_gradient_, direction_, trial_, step_, change_, product_;
  Eigen::MatrixXd inverse_hessian_, unused_;
};

}  // namespace knothe::numerics
