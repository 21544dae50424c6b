#pragma once
/// @file Probabilists' Hermite polynomials, orthonormal under the standard normal distribution.
#include <span>

namespace knothe::numerics {

/// ĥ_0(x) … ĥ_n(x), n = values.size() − 1, with ∫ ĥ_i ĥ_j φ dx = δ_ij: √(k+1) ĥ_{k+1} = x ĥ_k − √k ĥ_{k−1}.
void normalised_hermite(double x, std::span<double> values);

}  // namespace knothe::numerics
