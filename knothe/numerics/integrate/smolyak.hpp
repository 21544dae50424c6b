#pragma once
/// @file Sparse quadrature for N(0, I).
#include "knothe/numerics/integrate/quadrature.hpp"

namespace knothe::numerics {

/// Smolyak's combination of tensor Gauss–Hermite rules, exact for all polynomials of total degree ≤ 2 level +
/// 1, with a number of points that grows like d^level, not exponentially in d: 2d² + 1 points for degree 5.
///
/// Rule number i in one variable must be exact to degree 2i − 1 (Novak and Ritter 1999); with 1, 3, 3, 5, 5,
/// 7, … nodes it is, every second difference of rules is zero (delayed growth, Petras 2003), and the origin
/// is shared by all. **Weights of both signs**: Σ|w| exceeds 1 and grows with d and level, so a positive
/// function may get a negative mean, and rounding and noise of the function are amplified by Σ|w|. Fit to
/// integrate smooth functions close to polynomials; not fit to train maps of high order with (an objective of
/// negative weights need not be bounded below) or to weigh samples with. Points are in no particular order,
/// which depends on d and level only. Errors: UsageError for d < 1, level outside 0 … 30, more than 2,000,000
/// points.
[[nodiscard]] PointRule smolyak_rule(Eigen::Index d, int level);

}  // namespace knothe::numerics
