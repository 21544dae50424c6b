#pragma once
/// @file The model between its times.
#include <span>
#include <vector>

#include "knothe/model/observe/observed_model.hpp"

namespace knothe::model {

/// f(t) ≈ Σ value_k f(time[index_k]), f'(t) ≈ Σ slope_k f(time[index_k]).
struct TimeWeights {
  std::vector<std::size_t> index;
  std::vector<double> value, slope;
};

/// Lagrange's polynomial through the (at most) four nearest of the increasing times, two on either side where
/// there are: exact for cubics, exactly the node's value at a node. `at` lies inside the times (asserted),
/// but for rounding.
[[nodiscard]] TimeWeights interpolate_in_time(std::span<const double> time, double at);

/// The model at these times instead of its own, not necessarily increasing ones: lift and cores are
/// interpolated, so that it stays y = lift + space · core · w(p).
[[nodiscard]] ObservedModel at_times(const ObservedModel& model, std::span<const double> times);

/// ∂y/∂t at these times, in the same form.
[[nodiscard]] ObservedModel rates_at_times(const ObservedModel& model, std::span<const double> times);

}  // namespace knothe::model
