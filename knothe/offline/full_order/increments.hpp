#pragma once
/// @file A load step in increments, and what is said of it: the same for every way of solving one.
#include <cmath>
#include <numeric>
#include <span>

#include "knothe/offline/full_order/full_order_model.hpp"

namespace knothe::offline {

[[nodiscard]] inline double dot(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}
[[nodiscard]] inline double norm(std::span<const double> v) {
  return std::sqrt(dot(v, v));
}

/// From the imposed displacement `from` to `target`: the increment is halved where `newton(next)` fails, at
/// most `max_cuts` times, and doubled again after it succeeds; where no halving is left `fallback(next)`
/// decides. `commit(next)` takes what either has reached.
template <class Newton, class Fallback, class Commit>
void advance_by_increments(double from, double target, int max_cuts, const Newton& newton,
                           const Fallback& fallback, const Commit& commit) {
  double increment = target - from;
  int cuts = 0;
  while (from < target) {
    const double next = target - from < increment * 1.000001 ? target : from + increment;
    const bool by_newton = newton(next);
    if (!by_newton && cuts < max_cuts) {
      ++cuts;
      increment /= 2;
      continue;
    }
    if (!by_newton) fallback(next);
    commit(next);
    from = next;
    if (by_newton && cuts > 0) {
      --cuts;
      increment *= 2;
    }
  }
}

/// A step's derivative: with the change of damage, or without.
enum class Stiffness { tangent, secant };

enum class NewtonVerdict { go_on, converged, failed };
/// Of the relative residuals of Newton's iterations so far, at least one. At the rounding floor, well below
/// the acceptance, a residual that no longer falls has converged.
[[nodiscard]] NewtonVerdict newton_verdict(std::span<const double> residuals, const SolverOptions& options);

/// Of the half body that is solved for, at the end of an increment.
struct HalfBody {
  double imposed = 0;     ///< m
  double reaction = 0;    ///< N
  double work = 0;        ///< J, since the start
  double stored = 0;      ///< J
  double dissipated = 0;  ///< J, since the start
};

/// Counts the increment, which leaves the relative residual `residual`, and notes the whole body's numbers.
void add_increment(const HalfBody& half, double residual, double acceptance, StepRecord& record);

/// m; 0 if the mesh has no crack mouth.
[[nodiscard]] double crack_mouth_opening(const Structure& structure, std::span<const double> displacement);

}  // namespace knothe::offline
