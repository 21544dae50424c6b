#pragma once
/// @file What one specimen's test says about its parameters, its prior divided out: posterior / prior.
#include <Eigen/Core>
#include <vector>

#include "knothe/posterior/draws/mixture.hpp"

namespace knothe::assimilation {

inline constexpr double k_log_two_pi = 1.83787706640934548356;
inline constexpr Eigen::Index k_max_population_parameters = 8;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, k_max_population_parameters, 1>;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, k_max_population_parameters,
                                  k_max_population_parameters>;

/// N(mean, L Lᵀ): the specimens of a population.
struct PopulationNormal {
  SmallVector mean;   ///< d
  SmallMatrix lower;  ///< L, d × d
};

/// Independent normal priors; where `std` is infinite, a prior of density 1.
struct ReferencePrior {
  Eigen::VectorXd mean, std;  ///< d
};

/// L(x) = Σ_k exp(c_k + h_kᵀx − ½ xᵀΛ_k x), x ∈ R^d: each Gaussian of a posterior over a normal prior. Λ_k is
/// the part's precision less the prior's. Where that is not positive semidefinite (a part wider than the
/// prior, which no likelihood makes: sampling does), the part is taken as wide as the prior in that
/// direction.
class SpecimenLikelihood {
 public:
  /// `log_factor` is added to log L.
  SpecimenLikelihood(const std::vector<posterior::MixtureComponent>& posterior, const ReferencePrior& prior,
                     double log_factor = 0);
  /// Of a Gaussian posterior.
  SpecimenLikelihood(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance,
                     const ReferencePrior& prior);

  [[nodiscard]] Eigen::Index dimension() const { return parts_.front().linear.size(); }
  /// log ∫ L(x) N(x; population) dx.
  [[nodiscard]] double log_integral(const PopulationNormal& population) const;

  /// One Gaussian of L(x) N(x; population), covariance F Fᵀ.
  struct Conditional {
    double log_mass;
    SmallVector mean;
    SmallMatrix factor;
  };
  /// All of them: the masses sum to `log_integral`.
  [[nodiscard]] std::vector<Conditional> given(const PopulationNormal& population) const;

  /// (m − μ)ᵀ (Λ⁻¹ + Σ)⁻¹ (m − μ), L taken as one Gaussian N(m, Λ⁻¹): of χ² distribution with d degrees of
  /// freedom for a specimen of this population.
  [[nodiscard]] double squared_distance(const PopulationNormal& population) const;

 private:
  struct Part {
    double log_factor;
    SmallVector linear;
    SmallMatrix precision;
  };
  static Part divided(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance,
                      const ReferencePrior& prior);

  std::vector<Part> parts_;
  SmallVector matched_mean_;       ///< m
  SmallMatrix matched_precision_;  ///< Λ
};

}  // namespace knothe::assimilation
