#pragma once
/// @file The isotropic damage law of concrete (Rubio et al. 2019, Eq. 29), at one material point.
///
/// Strains and stresses are in Voigt order xx, yy, zz, xy, yz, zx; shear strains are engineering strains (2
/// ε_xy), so that stress · strain is the work.
#include <array>

#include "knothe/project/offline_options.hpp"

namespace knothe::offline {

using Voigt = std::array<double, 6>;
using Matrix3 = std::array<std::array<double, 3>, 3>;
using VoigtMatrix = std::array<double, 36>;  ///< 6 × 6, row-major

/// Isotropic linear elasticity, C.
struct ElasticConstants {
  double young_modulus = 30e9;  ///< E, Pa
  double poisson_ratio = 0.23;  ///< ν

  [[nodiscard]] double lambda() const {  ///< Lamé's first constant, Pa
    return young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
  }
  [[nodiscard]] double mu() const {
    return young_modulus / (2 * (1 + poisson_ratio));
  }  ///< shear modulus, Pa

  /// Throws ProjectError unless E > 0 and -1 < ν < 0.5.
  void validate() const;
};

using project::SofteningLaw;

/// The two parameters of the law; defaults are the paper's reference values.
struct DamageParameters {
  double threshold = 216.0;  ///< Y₀, J/m³: energy release rate at which damage starts
  /// A_d, m³/J: drives the post-peak behaviour. Of the laws of stress against opening 2 h_r / G_f.
  double brittleness = 2.25e-3;
  SofteningLaw law = SofteningLaw::brittle;

  /// Throws ProjectError unless both are finite, Y₀ ≥ 0 and A_d > 0.
  void validate() const;
};

/// A_d that the exponential and the bilinear law have in place of its fracture energy G_f [J/m²],
/// `reference_size` h_r in m.
[[nodiscard]] inline double brittleness_of(double fracture_energy, double reference_size) {
  return 2 * reference_size / fracture_energy;
}

/// Eigenvalues, largest first, and orthonormal eigenvectors of the strain tensor.
struct PrincipalStrains {
  std::array<double, 3> values{};
  Matrix3 directions{};  ///< directions[i] belongs to values[i]
};
/// In closed form, without iteration, accurate at repeated eigenvalues too (Eberly 2014, "A robust
/// eigensolver for 3 × 3 symmetric matrices": the best separated eigenvalue first, the others in the plane
/// across its eigenvector).
[[nodiscard]] PrincipalStrains principal_strains(const Voigt& strain);

/// Y = ½ ⟨ε⟩₊ : C : ⟨ε⟩₊, J/m³, with ⟨ε⟩₊ the strain tensor's positive part (negative principal strains set
/// to 0).
[[nodiscard]] double energy_release_rate(const PrincipalStrains& principal, const ElasticConstants& elastic);
[[nodiscard]] double energy_release_rate(const Voigt& strain, const ElasticConstants& elastic);

/// ∂Y/∂ε = λ tr(ε⁺) P⁺ + 2 μ ε⁺, the derivative in the Voigt components (engineering shear), Pa. No
/// derivative of an eigenvector enters. It jumps where a principal strain changes sign while another is
/// positive.
[[nodiscard]] Voigt energy_release_rate_derivative(const PrincipalStrains& principal,
                                                   const ElasticConstants& elastic);

/// d(Y) = 1 - 1 / (1 + A_d (Y - Y₀)) for Y > Y₀, else 0 (Eq. 29); always in [0, 1). Brittle law only.
[[nodiscard]] double damage(double energy_release_rate, const DamageParameters& parameters);

/// D and its derivative where Y grows, in a crack band that is not of the reference width.
struct BandDamage {
  double damage = 0;  ///< D, the stiffness that is lost
  double slope = 0;   ///< dD/dY, m³/J; 0 where D = 0
};
/// Crack-band scaling that keeps stress against opening (docs/explanation/mechanics.md, "Crack band").
/// `ratio` r is the reference width / the width of this band. The law's fracture energy diverges, so it is
/// the inelastic strain that is scaled: the strain ε_r = s ε of the reference law gives the stress, and ε =
/// (1 - d) ε_r + r d ε_r, so s (1 + (r - 1) d(s² Y)) = 1 and D = r d / (1 + (r - 1) d). With r = 1, D = d.
///
/// Exponential law: σ = f_t exp(-f_t w / G_f) with f_t = √(2 E Y₀) and the opening w = h D ε. With ε in units
/// of its onset, s = √(Y/Y₀), the inelastic strain x = D s is the root of s - x = exp(-q x), q = 2 h Y₀ / G_f
/// = A_d Y₀ / r: Young's modulus drops out. Bilinear law (Petersson 1981): the stress falls from f_t to f_t/3
/// at w = 0.8 G_f / f_t, then to 0 at 3.6 G_f / f_t, so that exp(-q x) becomes two straight lines in q x.
///
/// `ratio` must be at least `smallest_band_ratio(parameters)`, or there is no unique solution.
[[nodiscard]] BandDamage band_damage(double energy_release_rate, const DamageParameters& parameters,
                                     double ratio);
/// d of the reference law that belongs to D.
[[nodiscard]] inline double reference_damage(double damage, double ratio) {
  return damage / (damage + ratio * (1 - damage));
}
/// Below this r the strain of the scaled law would have to fall back while the crack opens: 1 - 1/g, with g
/// the largest slope of the inelastic strain d ε_r of the reference law (its stress falls at most with g - 1
/// times the elastic slope). Exponential law: A_d Y₀, where q = 1; bilinear 5/6 of it.
[[nodiscard]] double smallest_band_ratio(const DamageParameters& parameters);

/// C : ε.
[[nodiscard]] inline Voigt elastic_stress(const Voigt& strain, double lambda, double mu) {
  const double volumetric = lambda * (strain[0] + strain[1] + strain[2]);
  return {volumetric + 2 * mu * strain[0],
          volumetric + 2 * mu * strain[1],
          volumetric + 2 * mu * strain[2],
          mu * strain[3],
          mu * strain[4],
          mu * strain[5]};
}

/// The state of a material point after a strain.
struct MaterialResponse {
  Voigt stress{};        ///< (1 - d) C ε, Pa
  double damage = 0;     ///< d = max(previous d, d(Y(ε))): the history's maximum
  bool growing = false;  ///< whether d is above the previous one
  VoigtMatrix tangent{};  ///< ∂σ/∂ε, Pa: (1 - d) C - A_d (1 - d)² (C ε) ⊗ ∂Y/∂ε while growing, else (1 - d) C
};
/// Eq. 29 with irreversible damage: `previous_damage` is the largest so far. `band_ratio` as in band_damage.
[[nodiscard]] MaterialResponse respond(const Voigt& strain, double previous_damage,
                                       const ElasticConstants& elastic, const DamageParameters& parameters,
                                       double band_ratio = 1);

}  // namespace knothe::offline
