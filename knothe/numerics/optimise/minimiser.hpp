#pragma once
/// @file Minimisers of smooth functions: what they have in common.
#include <Eigen/Core>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// A function to minimise, with its derivatives and its feasible set.
class Objective {
 public:
  virtual ~Objective() = default;
  [[nodiscard]] virtual Index dimension() const = 0;
  /// Value at x and, for derivatives ≥ 1 and 2, gradient and (symmetric, both triangles) Hessian, sized by
  /// the caller. A value that is not finite, or `false`, refuses the point.
  virtual bool evaluate(const Eigen::VectorXd& x, int derivatives, double& value, Eigen::VectorXd& gradient,
                        Eigen::MatrixXd& hessian) = 0;
  /// Whether `hessian_vector` is there; without it a minimiser that wants products takes differences of
  /// gradients.
  [[nodiscard]] virtual bool has_hessian_vector() const { return false; }
  /// product = ∇²f(x) v, both of the dimension's size. Called many times in a row with the same x, at which
  /// `evaluate` was called before with derivatives ≥ 1 (perhaps followed by points that were then refused):
  /// what depends on x alone is worth keeping.
  virtual void hessian_vector(const Eigen::VectorXd& x, const Eigen::VectorXd& v, Eigen::VectorXd& product) {
    (void)x, (void)v, (void)product;
  }
  /// Step filter: the largest fraction in [0, 1] of `step` from the feasible point x that stays in the
  /// feasible set. Called before `evaluate`, hence cheap; it keeps a minimiser from jumping over a barrier
  /// that the values alone do not show.
  [[nodiscard]] virtual double step_limit(const Eigen::VectorXd& x, const Eigen::VectorXd& step) {
    (void)x, (void)step;
    return 1;
  }
};

/// Why a minimiser stopped.
enum class Termination {
  converged,        ///< gradient or predicted decrease below its tolerance
  small_step,       ///< no smaller step changes the value: rounding, or the border of the feasible set
  iteration_limit,  ///< options.max_iterations
  start_infeasible  ///< the objective refuses the starting point
};
[[nodiscard]] const char* describe(Termination termination);

/// What a minimiser did.
struct MinimiserSummary {
  Termination termination = Termination::iteration_limit;
  int iterations = 0;             ///< accepted and refused steps
  int evaluations = 0;            ///< calls of Objective::evaluate
  int limited_steps = 0;          ///< steps that the step filter shortened
  double value = 0;               ///< at the result
  double gradient_norm = 0;       ///< maximum norm at the result (0 for minimisers without gradient)
  double predicted_decrease = 0;  ///< of the last quadratic model
  [[nodiscard]] bool converged() const { return termination == Termination::converged; }
};

}  // namespace knothe::numerics
