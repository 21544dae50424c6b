#pragma once
/// @file A parameter that is not inferred: the temperature at each measurement, say.
#include <span>

#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/model_file.hpp"

namespace knothe::model {

/// The model with its last parameter fixed at `value`, inside its axis (asserted), as a model of the others.
/// There are at least two.
[[nodiscard]] ModelContents with_last_fixed(const ModelContents& contents, double value);

/// `observed` as a model of the parameters but the last one, which at its i-th time has the value values[i],
/// inside its axis (asserted). `axes`: those of the model. With w_k(p, T) = Σ_j c_j(T) β_kj(p), c_j the
/// cardinal splines of the axis of T, the functions β_kj do not depend on the data, and the cores take the
/// c_j(T_i): the form y = lift + space · core · w stays. The β_kj are compressed (1e-8 of their size). With
/// `derivative` 1 the result is ∂y/∂T in the same form.
[[nodiscard]] ObservedModel with_last_given(const ObservedModel& observed, std::span<const Axis> axes,
                                            std::span<const double> values, int derivative = 0);

}  // namespace knothe::model
