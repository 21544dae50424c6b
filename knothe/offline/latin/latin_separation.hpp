#pragma once
/// @file Terms of the fully separated form from joint coordinates, and fewer terms from many: alternating
/// least squares of the reduction room (docs/explanation/reduction.md), in the energy norm.
#include <Eigen/Core>
#include <span>

#include "knothe/base/index.hpp"
#include "knothe/offline/latin/latin_terms.hpp"

namespace knothe::offline {

/// Terms for c(t, p), one R × P matrix for each step: as many, grown one by one, as leave less than the
/// fraction `tolerance` of √(Σ w cᵀc), or `most`.
[[nodiscard]] LatinTerms separate(std::span<const Eigen::MatrixXd> coordinates, const LatinGrid& grid,
                                  Index most, double tolerance);

/// Recompression: the smallest terms are left out, and what they did is given to the others, as long as the
/// whole changes by less than the fraction `allowed` or there are more than `most`.
[[nodiscard]] LatinTerms with_fewer_terms(const LatinTerms& terms, const LatinGrid& grid, Index most,
                                          double allowed);

}  // namespace knothe::offline
