#pragma once
/// @file Values with Student-t noise: their exact log-likelihood as a function of w, and the quadratic form
/// that comes near it where the posterior is.
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "knothe/likelihood/step/step_form.hpp"
#include "knothe/model/observe/observed_model.hpp"

namespace knothe::likelihood {

/// The values of all data, each with the density Γ((ν + 1)/2)/(Γ(ν/2) √(νπ) σ) (1 + e²/νσ²)^−(ν + 1)/2 of its
/// error e: as a Gaussian of precision λ/σ² with λ ~ Gamma(ν/2, ν/2) (Lange, Little and Taylor 1989). A
/// function of v = w − w₀. The cost of everything here is that of a pass over all values.
class StudentLikelihood {
 public:
  /// `central`: w₀, r. `degrees`: ν > 0.
  StudentLikelihood(std::shared_ptr<const model::ObservedModel> model, Eigen::VectorXd central,
                    double degrees);

  /// Adds a datum: `values` (n; NaN = missing) at a model time index, with noise scales σ (n, > 0). DataError
  /// for an infinite value, and then nothing has changed.
  void add(std::size_t time_index, const Eigen::Ref<const Eigen::VectorXd>& values,
           const Eigen::Ref<const Eigen::VectorXd>& scale);
  /// The likelihood of all values so far to the power `power`, in [0, 1].
  void raise(double power);
  [[nodiscard]] Eigen::Index last_used() const { return data_.back().used; }  ///< values of the last datum

  /// Log-likelihood of all values at v = origin + basis · c for each column c of `coordinates` (q × K): K
  /// numbers. `basis`: r × q.
  [[nodiscard]] Eigen::VectorXd evaluate(const Eigen::VectorXd& origin, const Eigen::MatrixXd& basis,
                                         const Eigen::MatrixXd& coordinates) const;

  /// The quadratic form in u, v = mean + basis · u (basis: r × m), that all values have together, by
  /// statistical linearisation: each value's log-density ℓ(e) by the slope E ℓ′ and the curvature E ℓ″, where
  /// the value is predicted with the mean and the covariance factor·factorᵀ (factor: r × q) of v. Of all
  /// Gaussians the fixed point of this is the one nearest to the posterior by Kullback-Leibler divergence
  /// (Opper and Archambeau 2009). Where E ℓ″ > 0, far out, no curvature is taken: the form stays positive.
  /// Its constant is left open (0).
  [[nodiscard]] StepForm linearise(const Eigen::VectorXd& mean, const Eigen::MatrixXd& factor,
                                   const Eigen::MatrixXd& basis) const;

  /// Of the last datum, predicted so: λ = (ν + 1)/(ν + E[e²]/σ²), the expected precision factors, n; NaN
  /// where the value is missing.
  [[nodiscard]] Eigen::VectorXd precision_factors(const Eigen::VectorXd& mean,
                                                  const Eigen::MatrixXd& factor) const;
  /// The form in v of the last datum with Gaussian noise of these precisions, its constants included.
  [[nodiscard]] StepForm gaussian_form(const Eigen::VectorXd& precision_factors) const;

 private:
  struct Kept {
    std::size_t time_index;
    Eigen::VectorXd residual;   ///< value − prediction at w₀, over σ; 0 where missing
    Eigen::VectorXd precision;  ///< 1/σ, n; 0 where missing
    Eigen::Index used;
    double power = 1;  ///< to which its likelihood counts
  };
  /// Rows of ∂(prediction over σ)/∂u, n × m.
  [[nodiscard]] Eigen::MatrixXd rows(const Kept& datum, const Eigen::MatrixXd& basis) const;

  std::shared_ptr<const model::ObservedModel> model_;
  Eigen::VectorXd central_;
  double degrees_;
  std::vector<Kept> data_;
  double log_constant_ = 0;  ///< of all values
};

}  // namespace knothe::likelihood
