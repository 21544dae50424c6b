#pragma once
/// @file The simplex method of Nelder and Mead, for objectives without derivatives.
#include "knothe/numerics/optimise/minimiser.hpp"

namespace knothe::numerics {

struct NelderMeadOptions {
  int max_iterations = 20000;
  double initial_step = 0.1;       ///< edge of the first simplex
  double value_tolerance = 1e-12;  ///< stop when the values on the simplex differ by less …
  double point_tolerance = 1e-7;   ///< … and its points too (maximum norm)
  int restarts = 3;                ///< fresh simplices around the result, against collapsed ones
};

/// Nelder–Mead with parameters adapted to the dimension (Gao and Han 2012), restarted around its result.
class NelderMead {
 public:
  MinimiserSummary minimise(Objective& objective, const NelderMeadOptions& options, Eigen::VectorXd& x);

 private:
  double value_at(Objective& objective, const Eigen::VectorXd& from, const Eigen::VectorXd& point,
                  MinimiserSummary& summary);
  bool run(Objective& objective, const NelderMeadOptions& options, double edge, Eigen::VectorXd& x,
           MinimiserSummary& summary);

  Eigen::MatrixXd simplex_;  ///< n × (n+1)
  Eigen::VectorXd values_, centre_, trial_, other_, unused_, step_, best_;
  Eigen::MatrixXd unused_hessian_;
};

}  // namespace knothe::numerics
