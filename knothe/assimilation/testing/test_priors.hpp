#pragma once
/// @file The priors that this room's tests share.
#include <cmath>
#include <vector>

#include "knothe/posterior/prior/prior.hpp"

namespace knothe::assimilation::test {

/// Of Rubio et al. 2019, §6: normal, variance 0.2.
inline std::vector<posterior::Prior> papers_priors() {
  return {posterior::Prior::normal(0.9, std::sqrt(0.2)), posterior::Prior::normal(1.1, std::sqrt(0.2))};
}

}  // namespace knothe::assimilation::test
