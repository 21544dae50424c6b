#pragma once
/// @file Mixtures of Gaussians or of Student's t: where tempered particles begin, and what importance
/// sampling draws from.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior {

/// log(exp(a) + exp(b)); of zeros, −∞, too.
[[nodiscard]] inline double log_sum(double a, double b) {
  const double largest = std::max(a, b);
  return std::isinf(largest) ? largest : largest + std::log1p(std::exp(-std::abs(a - b)));
}

struct MixtureComponent {
  double weight = 1;       ///< relative to the others
  Eigen::VectorXd centre;  ///< d
  Eigen::MatrixXd lower;   ///< L, lower triangular, positive diagonal: scale matrix L Lᵀ
};

/// Σ w_k N(m_k, L_k L_kᵀ), or the same of Student's t, normalised.
class Mixture {
 public:
  /// `tails`: degrees of freedom of all components, an even number; infinite: Gaussians. Errors: UsageError
  /// for no components, sizes that disagree, weights or diagonals that are not positive, other degrees.
  explicit Mixture(std::vector<MixtureComponent> components,
                   double tails = std::numeric_limits<double>::infinity());
  [[nodiscard]] static Mixture standard_normal(Eigen::Index d) {
    return Mixture({{1.0, Eigen::VectorXd::Zero(d), Eigen::MatrixXd::Identity(d, d)}});
  }

  [[nodiscard]] Eigen::Index dimension() const { return components_.front().centre.size(); }
  [[nodiscard]] const std::vector<MixtureComponent>& components() const { return components_; }
  /// n × d; component k has its share of the points, stratified, so that a small one is not left out by
  /// chance.
  [[nodiscard]] Eigen::MatrixXd sample(Eigen::Index n, RandomNumbers& random) const;
  void sample(Eigen::Index n, RandomNumbers& random, Eigen::MatrixXd& points) const;
  /// From points of N(0, I), n × d: each component has its share of the rows, one after the other.
  [[nodiscard]] Eigen::MatrixXd points(const Eigen::Ref<const Eigen::MatrixXd>& normal) const;
  /// n log-densities. That of a point does not depend on the other points.
  void log_density(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::VectorXd& out) const;
  /// The same with derivatives, of Gaussians.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives, LogDensityBatch& out) const;
  /// Those of each component times its weight, n × components.
  void log_densities(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::ArrayXXd& out) const;

 private:
  [[nodiscard]] double stretch(RandomNumbers& random) const;
  [[nodiscard]] bool is_gaussian() const { return tails_ == std::numeric_limits<double>::infinity(); }

  std::vector<MixtureComponent> components_;
  double tails_;
  std::vector<Eigen::MatrixXd> inverse_;   ///< L⁻¹
  std::vector<Eigen::VectorXd> whitened_;  ///< L⁻¹ m
  Eigen::VectorXd log_factor_;             ///< of the weight and the normalisation
};

}  // namespace knothe::posterior
