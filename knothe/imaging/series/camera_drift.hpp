#pragma once
/// @file Motions of the camera against the body, kept out of the likelihood in closed form.
///
/// d = u + B a + e with the drift a ~ N(0, S) of each picture by itself, B its rigid motions. The precision
/// of d is P − P B (S⁻¹ + Bᵀ P B)⁻¹ Bᵀ P, which is dense. But that of d and a together is sparse, and d's is
/// its marginal: so the a's are added as observations that are never measured (NaN), which the likelihood
/// takes out by the Schur complement, as it does with every missing value.
#include <Eigen/SparseCore>
#include <cstdint>
#include <vector>

#include "knothe/imaging/series/picture_series.hpp"

namespace knothe::imaging {

/// 0, 2 or 3 motions.
[[nodiscard]] int drift_modes(Drift drift);

/// Adds a place for each motion to `points` (3 numbers per observation) and `component` (of a node: two
/// following each other): those of the first observation.
void add_drift_places(Drift drift, std::vector<double>& points, std::vector<std::int64_t>& component);

/// Precision of displacements and motions together. `points`, `component` are those of the displacements,
/// maybe with the motions' behind them; `precision` their n × n precision, empty rows where nothing was
/// measured; `std` the standard deviation of a shift in units of the displacements. A turn is scaled to the
/// displacement that it makes at the root mean square distance from the middle. Returns (n + modes)².
[[nodiscard]] Eigen::SparseMatrix<double> with_drift(const Eigen::SparseMatrix<double>& precision,
                                                     Drift drift, const std::vector<double>& points,
                                                     const std::vector<std::int64_t>& component, double std);

}  // namespace knothe::imaging
