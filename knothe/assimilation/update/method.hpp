#pragma once
/// @file The ways of computing a posterior.
#include <array>

#include "knothe/base/enum_names.hpp"

namespace knothe::assimilation {

enum class Method {
  automatic,  ///< the cheapest verified one of `grid`, around the modes, weighted draws, and `transport`
  transport,
  grid,  ///< dense quadrature: the plain answer, at most 3 parameters
  markov_chain,
  sequential_monte_carlo,
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

/// Whether it makes a map or a grid of the posterior (`SequentialUpdate`), or is one of those that both are
/// compared with (`BaselineUpdate`).
constexpr bool is_baseline(Method method) {
  return method != Method::automatic && method != Method::transport && method != Method::grid;
}

}  // namespace knothe::assimilation
