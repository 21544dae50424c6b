#pragma once
/// @file From damage to a crack: the density of the crack length at the horizon (Rubio et al. 2019, §6.3.2,
/// Eq. 33).
#include <Eigen/Core>

#include "knothe/forecast/crack_meta_model.hpp"
#include "knothe/forecast/horizon.hpp"
#include "knothe/forecast/scalar_forecast.hpp"

namespace knothe::forecast {

struct CrackBridgeOptions {
  double prior_mean =
      0.04;  ///< m; the paper's prior on l_T is N(0.04, 0.013²), here truncated to the lengths
  double prior_std = 0.013;       ///< m
  double discrepancy_std = 1e-6;  ///< m; how far an elastic crack may be from the damaged beam, dof by dof
  double threshold = 0.04;        ///< m; P(l_T > threshold) is reported
};

struct CrackForecast {
  ScalarForecast length;  ///< m
  double residual_rms =
      0.0;  ///< m; distance of u_SVD(l) at the most probable l from E[u], root mean square over the dofs
};

/// π(l_T) ∝ N(u_imp u_SVD(l); E[u], Cov[u] + discrepancy_std² I) π₀(l), with the moments of u = lift + A w(p)
/// under the posterior of p. Everything that does not depend on the posterior is done once: one orthonormal
/// basis of span{σ_k u_k, lift, A} turns all observed fields into at most N_SVD + r + 1 coordinates, in which
/// the covariance is C Cov[w] Cᵀ + discrepancy_std² I, and outside of which it is discrepancy_std² I and the
/// misfit is zero. (This is Woodbury's identity without its cancellation.) The cost of an update does not
/// depend on the number of dofs.
class CrackBridge {
 public:
  /// `imposed_displacement` is u_imp(T) [m], by which the unit solutions are multiplied.
  /// Errors: ProjectError for options out of range, DataError where the shapes disagree or a number is not
  /// finite.
  CrackBridge(CrackMetaModel meta_model, const LinearPrediction& prediction, double imposed_displacement,
              const CrackBridgeOptions& options = {});

  /// Eq. 33 from the moments of w (r, r × r). Errors: NumericalError for moments that are not finite.
  [[nodiscard]] CrackForecast update(const FunctionMoments& moments) const;

  /// The direct forecast, a cross-check: the best-fitting length of every posterior sample (Eq. 14) and their
  /// weighted kernel density. `functions`: w at the samples, n × r; no prior on the length and no discrepancy
  /// enter.
  [[nodiscard]] ScalarForecast direct(const Eigen::Ref<const reduction::RowMatrix>& functions,
                                      const Eigen::Ref<const Eigen::VectorXd>& weights) const;

  /// The length whose elastic field is nearest to each sample's field, n, in m.
  [[nodiscard]] Eigen::VectorXd best_lengths(const Eigen::Ref<const reduction::RowMatrix>& functions) const;

  [[nodiscard]] const CrackMetaModel& meta_model() const { return meta_model_; }
  [[nodiscard]] const CrackBridgeOptions& options() const { return options_; }

 private:
  [[nodiscard]] double nearest_length(const Eigen::VectorXd& target, Eigen::Index start) const;

  CrackMetaModel meta_model_;
  CrackBridgeOptions options_;
  Eigen::Index observations_;
  Eigen::MatrixXd crack_;  ///< coordinates of u_imp σ_k u_k, k × N_SVD
  Eigen::VectorXd lift_;   ///< coordinates of lift, k
  Eigen::MatrixXd modes_;  ///< coordinates of A, k × r
  std::vector<double>
      base_;  ///< lengths of the first pass, four intervals of two halves a millimetre for 1 mm spacing
  Eigen::MatrixXd base_values_;  ///< v(l) at `base_`, N_SVD × n
  Eigen::VectorXd base_prior_;   ///< log π₀ at `base_`
  // For the direct forecast: crack_ = Q R, hence |crack_ v − y|² = |R v − Qᵀ y|² + rest.
  Eigen::MatrixXd crack_basis_;   ///< Q, k × N
  Eigen::MatrixXd crack_factor_;  ///< R, N × N_SVD
  Eigen::MatrixXd base_fields_;   ///< R v at `base_`, N × n
};

}  // namespace knothe::forecast
