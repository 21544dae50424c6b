#pragma once
/// @file The posterior of three parameters by the trapezoidal rule on the nodes of a lattice that hold its
/// mass.
#include "knothe/posterior/quadrature/tensor_quadrature.hpp"

namespace knothe::posterior {

/// Trapezoidal rule along the parameters' own axes, on the nodes whose density is within exp(−20) of the
/// maximum. They are found neighbour by neighbour, from the modes (of a search, and of ascents from the local
/// maxima of a coarse lattice of the prior's range) and from a coarse look at the window between them: what a
/// ring, a sphere or a narrow ridge costs goes with its surface or length, where a tensor grid costs its box.
/// Refined along the axes that need it until the tolerances and `max_nodes` of the options (the other ones
/// are not used) are met; `resolved` says whether it came to that, and nothing but its errors is set if
/// `max_nodes` were too few. Every other node is that of a chequerboard. A target that is a
/// `numerics::GridEvaluator` is asked row by row. Errors: UsageError for other than three parameters; those
/// of `CheckedDensity` and `ModeSearch`.
[[nodiscard]] QuadraturePosterior filled_quadrature(LogDensity& target, const QuadratureOptions& options,
                                                    ModeSearch& search);

/// The sum of densities, each integrated by `filled_quadrature` on a lattice of its own: a mixture of narrow
/// and wide parts needs no grid as fine as the narrowest and as large as the widest. Points, weights,
/// quantiles and evidence of all; the errors are the largest of the parts'. There is no lattice.
[[nodiscard]] QuadraturePosterior joined(std::span<const QuadraturePosterior> parts);

}  // namespace knothe::posterior
