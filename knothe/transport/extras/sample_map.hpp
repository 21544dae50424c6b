#pragma once
/// @file Maps from samples: density estimation, and conditional sampling from joint samples (Marzouk,
/// Moselhy, Parno, Spantini 2016; Baptista, Marzouk, Zahm 2023).
///
/// S takes the samples' distribution to ρ = N(0, I). Each of its components is found by itself, as the
/// minimum of
///   J_k(a) = Σ_i w_i [½ S^k(x_i)² − log ∂_k S^k(x_i)] + ½ λ |a'|²,   Σ w_i = 1,
/// a' being the coefficients of what is not affine: the conditional density of x_k given x_1 … x_{k−1} by
/// maximum likelihood. How many terms a component gets, cross-validation decides, component by component.
#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "knothe/transport/map/composed_map.hpp"

namespace knothe::transport {

/// The affine map that samples go through first.
enum class Standardisation {
  automatic,  ///< whitening where every component may depend on all before it, else diagonal
  diagonal,   ///< each coordinate to mean 0, standard deviation 1: keeps conditional independence
  whitening   ///< to mean 0, covariance I, by the Cholesky factor
};

struct SampleMapOptions {
  /// Which maps are tried, by order; empty: total order, integrated softplus. A sparse family (sparse_map
  /// with parents_by_elimination) makes use of known conditional independence.
  MapFamily family;
  int min_order = 1;
  int max_order = 5;
  /// Of the cross-validation that chooses the order of each component. 0: none, every component gets
  /// max_order.
  int folds = 5;
  double regularisation = 1e-6;  ///< λ
  Standardisation standardisation = Standardisation::automatic;
  int max_iterations = 100;  ///< of Newton's method, per component and fit
  std::uint64_t seed = 1;    ///< shuffles samples into folds
};

/// A density made from samples.
class SampleMap {
 public:
  ComposedMap map;          ///< S: (standardised to reference) ∘ (affine standardisation)
  std::vector<int> orders;  ///< of each component
  Eigen::Index coefficient_count = 0;
  double log_likelihood = 0;  ///< weighted mean of log density over the samples it was made from
  /// The same over samples held out, by cross-validation; what to compare models by. NaN without folds.
  double held_out_log_likelihood = 0;
  double held_out_error = 0;  ///< standard error of that mean, over samples
  int iterations = 0;
  bool converged = false;  ///< every final fit
  std::string reason;      ///< if not: which component and why

  [[nodiscard]] Eigen::Index dimension() const { return map.dimension(); }
  /// At the points z (n × d).
  [[nodiscard]] Eigen::VectorXd log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// n new draws, through the inverse.
  [[nodiscard]] Eigen::MatrixXd sample(Eigen::Index n, std::uint64_t seed) const;
  /// log density of z_{m+1} … z_d (n × (d − m)) given z_1 … z_m. Errors: UsageError for sizes that do not
  /// fit.
  [[nodiscard]] Eigen::VectorXd conditional_log_density(const Eigen::VectorXd& given,
                                                        const Eigen::Ref<const Eigen::MatrixXd>& rest) const;
  /// n draws of all coordinates with the first m equal to `given`. From samples of (data, parameters) and the
  /// data that were measured: samples of the posterior.
  [[nodiscard]] Eigen::MatrixXd conditional_sample(const Eigen::VectorXd& given, Eigen::Index n,
                                                   std::uint64_t seed) const;
  /// The points of the reference that these draws are the images of.
  [[nodiscard]] Eigen::MatrixXd conditional_reference(const Eigen::VectorXd& given, Eigen::Index n,
                                                      std::uint64_t seed) const;
};

/// From `samples` (n × d) with `weights` (n, ≥ 0; empty: equal). Errors: UsageError for options that make no
/// sense or sizes that disagree; DataError, with sample and coordinate, for a value that is not finite, a
/// coordinate without spread, fewer samples than a component has coefficients.
[[nodiscard]] SampleMap map_from_samples(const Eigen::Ref<const Eigen::MatrixXd>& samples,
                                         const Eigen::VectorXd& weights = {},
                                         const SampleMapOptions& options = {});

}  // namespace knothe::transport
