#pragma once
/// @file Sensors that see one number: an output of the model (a load cell), or a linear combination of
/// displacements (a strain gauge, the opening of a crack's mouth).
#include <array>
#include <span>
#include <string>
#include <vector>

#include "knothe/model/observe/observed_model.hpp"

namespace knothe::model {

/// One sensor: either an output, or Σ_k coefficients[k] · u_components[k](points[k]).
struct ScalarObservation {
  std::string name;                      ///< for messages
  std::string output;                    ///< or quantity of the model; empty: a combination of displacements
  std::vector<double> points;            ///< [k, 3], m
  std::vector<std::int64_t> components;  ///< [k], 0 x, 1 y, 2 z
  std::vector<double> coefficients;      ///< [k]
  std::string units;                     ///< of the number; "1" without a dimension

  /// (u(to) − u(from))·e, e the unit vector from `from` to `to`: how far two points move apart; divided by
  /// their distance where `strain`. UsageError where they are the same point.
  [[nodiscard]] static ScalarObservation elongation(const std::string& name, std::span<const double, 3> from,
                                                    std::span<const double, 3> to, bool strain);
  /// Strain ½ (∂u_a/∂b + ∂u_b/∂a), `axes` {a, b}, as image correlation states it: the slopes of the plane
  /// that fits displacements best over a square window about `at`, `window` m wide, a coordinate plane that
  /// has both axes (of one axis: x and y, or x and z). UsageError for a window that has no width.
  [[nodiscard]] static ScalarObservation strain_in_window(const std::string& name,
                                                          std::span<const double, 3> at, double window,
                                                          std::array<int, 2> axes);
};

/// `observed` with a row per sensor added, in order. An output, known on the grid of the parameters at each
/// time, is separated as s(t)·φ(p) (singular value decomposition, exact to 1e-7 of its variation over the
/// parameters); its functions φ join w. UsageError for an output that the model does not have, DataError for
/// points outside it.
[[nodiscard]] ObservedModel with_scalars(const ObservedModel& observed, const SeparatedModel& model,
                                         std::span<const ScalarObservation> sensors);

}  // namespace knothe::model
