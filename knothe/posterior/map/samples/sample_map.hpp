#pragma once
/// @file Maps from samples: density estimation, and conditional sampling from joint samples (Marzouk,
/// Moselhy, Parno, Spantini 2016; Baptista, Marzouk, Zahm 2023).
///
/// S takes the samples' distribution to ρ = N(0, I). Each of its components is found by itself, as the
/// minimum of
///   J_k(a) = 1/n Σ_i [½ S^k(x_i)² − log ∂_k S^k(x_i)] + ½ λ |a'|²,
/// a' being the coefficients of what is not affine: the conditional density of x_k given x_1 … x_{k−1} by
/// maximum likelihood. How many terms a component gets, cross-validation decides, component by component.
#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/composed_map.hpp"

namespace knothe::posterior {

struct SampleMapOptions {
  int max_order = 5;
  /// Of the cross-validation that chooses the order of each component. 0: none, every component gets
  /// max_order.
  int folds = 5;
  std::uint64_t seed = 1;  ///< shuffles samples into folds
};

/// A density made from samples.
class SampleMap {
 public:
  ComposedMap map;          ///< S: (standardised to reference) ∘ (affine standardisation)
  std::vector<int> orders;  ///< of each component
  bool converged = false;   ///< every final fit
  std::string reason;       ///< if not: which component and why

  [[nodiscard]] Index dimension() const { return map.dimension(); }
  /// At the points z (n × d).
  [[nodiscard]] Eigen::VectorXd log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// n points of the reference whose preimages are draws of all coordinates with the first m equal to
  /// `given`. From samples of (data, parameters) and the data that were measured: samples of the posterior.
  [[nodiscard]] Eigen::MatrixXd conditional_reference(const Eigen::VectorXd& given, Index n,
                                                      std::uint64_t seed) const;
};

/// From `samples` (n × d). Errors: UsageError for options that make no sense; DataError, with sample and
/// coordinate, for a value that is not finite, a coordinate without spread, fewer samples than a component
/// has coefficients.
[[nodiscard]] SampleMap map_from_samples(const Eigen::Ref<const Eigen::MatrixXd>& samples,
                                         const SampleMapOptions& options = {});

}  // namespace knothe::posterior
