#pragma once
/// @file The ways of computing a posterior.
#include <array>

#include "knothe/base/enum_names.hpp"

namespace knothe::posterior {

enum class Method {
  automatic,  ///< the cheapest verified one of `grid`, around the modes, weighted draws, and `transport`
  transport,
  grid,                    ///< dense quadrature: the plain answer, at most 3 parameters
  markov_chain,            ///< adaptive chains, their evidence by bridge sampling
  sequential_monte_carlo,  ///< weighted draws along tempered densities
  extended_kalman,
  unscented_kalman,
  ensemble_kalman
};

constexpr auto names_of(Method /*method*/) {
  return std::to_array<Named<Method>>({{Method::automatic, "auto"},
                                       {Method::transport, "transport"},
                                       {Method::grid, "grid"},
                                       {Method::markov_chain, "mcmc"},
                                       {Method::sequential_monte_carlo, "smc"},
                                       {Method::extended_kalman, "ekf"},
                                       {Method::unscented_kalman, "ukf"},
                                       {Method::ensemble_kalman, "enkf"}});
}

/// Kalman filters, which take the data one after the other.
constexpr bool is_filter(Method method) {
  return method >= Method::extended_kalman;
}

}  // namespace knothe::posterior
