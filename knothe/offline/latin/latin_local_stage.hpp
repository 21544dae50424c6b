#pragma once
/// @file The local stage of LATIN-PGD: the damage law of damage_law.hpp at one Gauss point for many parameter
/// points at once, in SIMD lanes (docs/explanation/latin.md).
#include <cstddef>

#include "knothe/offline/law/damage_law.hpp"

namespace knothe::offline {

/// Number of lanes that are computed together; every count of lanes below is a multiple of it.
constexpr std::size_t k_lanes = 8;
[[nodiscard]] constexpr std::size_t padded_lanes(std::size_t count) {
  return (count + k_lanes - 1) / k_lanes * k_lanes;
}

/// Threshold of a padding lane: never reached.
constexpr double k_never = 1e300;

/// What one Gauss point needs. Arrays over lanes are contiguous: component i of lane j at [i · lanes + j].
struct LocalStage {
  std::size_t lanes = 0;                ///< multiple of k_lanes
  const double* threshold = nullptr;    ///< Y₀ of each lane, J/m³ (padding: k_never)
  const double* brittleness = nullptr;  ///< A_d of each lane, m³/J
  const double* strain = nullptr;       ///< [6][lanes], Voigt, engineering shear
  const double* history = nullptr;      ///< [lanes]: largest damage before
  double* damage = nullptr;             ///< [lanes], out: max(history, d(Y(strain)))
  double* slope = nullptr;              ///< [lanes], out, may be null: ∂d/∂Y where d grows, else 0
  double* derivative = nullptr;  ///< [6][lanes], out, null together with slope: ∂Y/∂ε (tensor shear)
  double band_ratio = 1;         ///< r of the point's cell (band_damage); d is then D
};

/// Evaluates the law (Eq. 29). Eigenvalues in closed form without any trigonometric function,
/// eigenprojections instead of eigenvectors, no branch. Where two eigenvalues meet, Y is good to 1e-12
/// relative and ∂Y/∂ε, which is only used as a search direction, to 1e-7.
void evaluate_local_stage(const LocalStage& stage, const ElasticConstants& elastic);

}  // namespace knothe::offline
