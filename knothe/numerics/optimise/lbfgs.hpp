#pragma once
/// @file BFGS with limited memory, for objectives with gradient in many variables.
#include "knothe/base/index.hpp"
#include "knothe/numerics/optimise/minimiser.hpp"

namespace knothe::numerics {

struct LbfgsOptions {
  int max_iterations = 2000;
  int memory = 12;                    ///< pairs of steps and gradient changes kept
  double gradient_tolerance = 1e-8;   ///< stop when max |gradient| is below
  double decrease_tolerance = 1e-15;  ///< stop when gᵀ B⁻¹ g / 2 is below
};

/// L-BFGS by the two-loop recursion (Nocedal and Wright 2006, algorithm 7.4) with a line search for the
/// strong Wolfe conditions (algorithms 3.5 and 3.6, cubic interpolation); steps stay in the feasible set: one
/// that reaches the step filter's limit with enough decrease is accepted as it is. Memory 2 `memory` n.
class Lbfgs {
 public:
  MinimiserSummary minimise(Objective& objective, const LbfgsOptions& options, Eigen::VectorXd& x);

 private:
  /// Value and slope at a step length along direction_.
  struct Trial {
    double length = 0, value = 0, slope = 0;
  };
  Trial try_length(Objective& objective, const Eigen::VectorXd& x, double length, MinimiserSummary& summary);
  /// Fills trial_ and trial_gradient_ and `accepted`; false if no length makes the value smaller.
  bool line_search(Objective& objective, const Eigen::VectorXd& x, double first_length,
                   MinimiserSummary& summary, Trial& accepted);
  bool zoom(Objective& objective, const Eigen::VectorXd& x, const Trial& start, Trial low, Trial high,
            MinimiserSummary& summary, Trial& accepted);
  void find_direction();
  void remember();

  Eigen::VectorXd gradient_, trial_gradient_, direction_, trial_;
  Eigen::MatrixXd steps_, changes_;  ///< n × (memory + 1), a ring
  Eigen::VectorXd inverse_curvature_, alpha_;
  Index kept_ = 0, newest_ = -1;
  Eigen::MatrixXd unused_;
};

}  // namespace knothe::numerics
