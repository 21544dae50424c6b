#pragma once
/// @file The priors that this room's tests share.
#include <cmath>
#include <vector>

#include "knothe/assimilation/update/prior.hpp"

namespace knothe::assimilation::test {

/// Of Rubio et al. 2019, §6: normal, variance 0.2.
inline std::vector<Prior> papers_priors() {
  return {Prior::normal(0.9, std::sqrt(0.2)), Prior::normal(1.1, std::sqrt(0.2))};
}

}  // namespace knothe::assimilation::test
