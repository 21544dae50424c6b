#pragma once
/// @file A mixture of Gaussians: where tempered particles begin.
#include <Eigen/Core>
#include <vector>

#include "knothe/sampling/random_numbers.hpp"

namespace knothe::sampling {

struct GaussianComponent {
  double weight = 1;       ///< relative to the others
  Eigen::VectorXd centre;  ///< d
  Eigen::MatrixXd lower;   ///< L, lower triangular, positive diagonal: covariance L Lᵀ
};

/// Σ w_k N(m_k, L_k L_kᵀ), normalised.
class GaussianMixture {
 public:
  /// Errors: UsageError for no components, sizes that disagree, weights or diagonals that are not positive.
  explicit GaussianMixture(std::vector<GaussianComponent> components);

  [[nodiscard]] Eigen::Index dimension() const { return components_.front().centre.size(); }
  /// n × d; component k has its share of the points, stratified, so that a small one is not left out by
  /// chance.
  [[nodiscard]] Eigen::MatrixXd sample(Eigen::Index n, RandomNumbers& random) const;
  /// n log-densities.
  void log_density(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::VectorXd& out) const;

 private:
  std::vector<GaussianComponent> components_;
  Eigen::VectorXd log_factor_;  ///< log weight − log det L − d/2 log 2π
};

}  // namespace knothe::sampling
