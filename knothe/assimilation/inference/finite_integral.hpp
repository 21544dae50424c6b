#pragma once
/// @file Whether a density given by its logarithm alone can be normalised at all.
#include "knothe/assimilation/inference/posterior_density.hpp"
#include "knothe/posterior/mode_search.hpp"

namespace knothe::assimilation {

/// A density that is no probability density for any constant: throws NumericalError, with the direction, if
/// from 10 to 10⁶ of its own standard deviations off the mode, along ± the columns of the Laplace factor,
/// neither π̄(r) r^d nor π̄(r) r times its widths across (small where π̄ has an integrable pole) falls by a
/// tenth from one power of ten to the next. Such a π̄ has no finite integral, or none that a number can hold.
/// A density that passes costs 4 d evaluations; a posterior made of a prior and data has a finite integral
/// and needs no look.
void require_finite_integral(PosteriorDensity& posterior, const posterior::Mode& mode,
                             const std::vector<std::string>& names = {});

}  // namespace knothe::assimilation
