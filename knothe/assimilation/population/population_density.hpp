#pragma once
/// @file p(population | all specimens), up to its evidence, as a log-density of standard normal variables.
#include <Eigen/Core>
#include <span>
#include <vector>

#include "knothe/assimilation/population/specimen_likelihood.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::assimilation {

/// Means (d), spreads (d: standard deviations) and correlations (d(d − 1)/2, by rows of the lower triangle)
/// of a population of specimens, as N(μ, Σ).
[[nodiscard]] PopulationNormal population_of(const Eigen::Ref<const Eigen::VectorXd>& parameters,
                                             Eigen::Index d);

/// log π̄(z) = log N(z; 0, I) + Σ_i log ∫ L_i(x) N(x; μ, Σ) dx, with μ, Σ of z by their priors.
///
/// Σ = diag(τ) C Cᵀ diag(τ), C lower triangular with rows of length 1, whose entries are made of partial
/// correlations tanh ζ as in Lewandowski, Kurowicka, Joe 2009: any ζ gives a correlation matrix.
class PopulationDensity final : public posterior::LogDensity {
 public:
  /// `priors`: of the d means, the d spreads (positive), the Fisher transforms ζ of the partial correlations.
  PopulationDensity(std::vector<const SpecimenLikelihood*> specimens, std::vector<posterior::Prior> priors);

  [[nodiscard]] Eigen::Index dimension() const override { return transform_.dimension(); }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                posterior::LogDensityBatch& out) override;
  /// Those of `population_of`, n × dimension.
  [[nodiscard]] Eigen::MatrixXd parameters(const Eigen::MatrixXd& z) const;

 private:
  /// Means, spreads, ζ.
  [[nodiscard]] Eigen::MatrixXd transformed(const Eigen::Ref<const Eigen::MatrixXd>& z) const;

  std::vector<const SpecimenLikelihood*> specimens_;
  posterior::PriorTransform transform_;
  Eigen::Index d_;
};

}  // namespace knothe::assimilation
