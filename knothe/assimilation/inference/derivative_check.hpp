#pragma once
/// @file A model's own derivatives beside differences of its values, before anything is built on them.
#include <string>
#include <vector>

#include "knothe/assimilation/inference/model_evaluator.hpp"

namespace knothe::assimilation {

/// Compares Gradient, ApplyJacobian and ApplyHessian, where the model has them, with central differences at
/// three points of the priors, and switches off in `evaluator` those that are wrong (then differences take
/// their place). Returns one sentence for each, naming the worst parameter; empty if all agree.
///
/// Wrong is what is off by more than 2 % of the sum of its terms, beyond ten times the differences' own error
/// (from a second step, four times as long) and a thousandth of the steepest parameter's slope: a forgotten
/// sign or factor, not a solver's last digits. Costs 12 d + 3 evaluations, and three of each kind of
/// derivative; Hessians 6 d gradients more. Points at which a log-density is zero are left out.
[[nodiscard]] std::vector<std::string> check_derivatives(ModelEvaluator& evaluator,
                                                         const std::vector<posterior::Prior>& priors,
                                                         const std::vector<std::string>& names = {});

}  // namespace knothe::assimilation
