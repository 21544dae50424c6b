#pragma once
/// @file Crack solutions as modes, for the model's file (Rubio et al. 2019, Eq. 32).
#include <span>

#include "knothe/model/reduced/model_file.hpp"

namespace knothe::model {

/// Singular value decomposition of the solutions `values` ([lengths, n_dof], m per m): orthonormal modes u_k,
/// coefficients σ_k v_k(l), by falling σ_k. All that differ from rounding (1e-10 of the largest) are kept.
/// Errors: DataError where the shapes disagree.
[[nodiscard]] CrackSolutions crack_modes(std::span<const double> lengths, std::span<const double> values);

}  // namespace knothe::model
