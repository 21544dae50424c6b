#pragma once
/// @file The posterior of three parameters by the trapezoidal rule on the nodes of a lattice that hold its
/// mass.
#include "knothe/assimilation/update/tensor_quadrature.hpp"

namespace knothe::assimilation {

/// Trapezoidal rule along the parameters' own axes, on the nodes whose density is within exp(−20) of the
/// maximum. They are found neighbour by neighbour, from the modes (of a search, and of ascents from the local
/// maxima of a coarse lattice of the prior's range) and from a coarse look at the window between them: what a
/// ring, a sphere or a narrow ridge costs goes with its surface or length, where a tensor grid costs its box.
/// Refined along the axes that need it until the tolerances and `max_nodes` of the options (the other ones
/// are not used) are met; `resolved` says whether it came to that, and nothing but its errors is set if
/// `max_nodes` were too few. Every other node is that of a chequerboard. A target that is a
/// `reduction::GridEvaluator` is asked row by row. Errors: UsageError for other than three parameters; those
/// of `sampling::CheckedDensity` and `sampling::ModeSearch`.
[[nodiscard]] QuadraturePosterior filled_quadrature(sampling::LogDensity& target,
                                                    const QuadratureOptions& options,
                                                    sampling::ModeSearch& search);

}  // namespace knothe::assimilation
