#pragma once
/// @file A mixture of Gaussians fitted to weighted points by expectation-maximisation.
#include <Eigen/Core>

#include "knothe/posterior/draws/mixture.hpp"

namespace knothe::posterior {

struct MixtureFitOptions {
  std::size_t max_components = 32;
  int max_iterations = 20;  ///< for each number of components
  double min_gain = 5e-3;   ///< log-likelihood per point that an iteration must win
  double min_std = 0;       ///< of a component along any axis, in the points' coordinates
  /// How many independent points these are worth; 0: as many as the weights say. Nodes of a quadrature, whose
  /// weights have no error, are worth more.
  double worth = 0;
};

/// Begins with one Gaussian, or with the components of `start`, and splits all of them along their longest
/// axes as long as Bayes' information criterion, of as many points as the weights are worth, gets better.
/// `points`: n × d; `weights`: n, sum 1. Errors: UsageError for fewer than 2 points.
[[nodiscard]] std::vector<MixtureComponent> fit_mixture(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                                        const Eigen::Ref<const Eigen::VectorXd>& weights,
                                                        std::vector<MixtureComponent> start = {},
                                                        const MixtureFitOptions& options = {});

}  // namespace knothe::posterior
