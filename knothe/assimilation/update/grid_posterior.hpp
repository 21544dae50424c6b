#pragma once
/// @file The posterior by dense quadrature: the slow, plain answer that the fast ones are compared with.
#include <Eigen/Core>
#include <functional>
#include <vector>

#include "knothe/sampling/log_density.hpp"

namespace knothe::assimilation {

/// Moments, marginals and evidence of exp(log-density of z) by the trapezoidal rule on a tensor grid (d ≤ 3)
/// that zooms in on where the mass is. The density decays at the ends of the window, so the rule converges
/// faster than any power as long as the density is resolved; `resolved` tells.
struct GridPosterior {
  Eigen::MatrixXd nodes;     ///< points per axis × d, z
  Eigen::MatrixXd marginal;  ///< points per axis × d, density of z_k at the nodes
  double log_evidence = 0;
  bool resolved = true;  ///< the narrowest marginal spans at least 6 nodes per standard deviation

  /// Mean and covariance of f(z), f applied coordinate by coordinate: `transform(k, z)`.
  using Transform = std::function<double(Eigen::Index k, double z)>;
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  /// Quantile of z_k at `level`, by the integrated marginal.
  [[nodiscard]] double quantile(Eigen::Index k, double level) const;
};

/// Options of the grid; the defaults give about eight digits on the beam's posteriors.
struct GridOptions {
  int points = 0;       ///< per axis; 0: 2001, 301, 101 for d = 1, 2, 3
  double range = 8.5;   ///< |z| looked at first
  double depth = 45.0;  ///< what lies this far below the maximum of the log-density is left out
};

/// Nodes of a coarser grid on the same window with normalised weights, for what wants points: about 4,000 of
/// them.
struct GridPoints {
  Eigen::MatrixXd points;   ///< n × d, z
  Eigen::VectorXd weights;  ///< n, sum 1
};
[[nodiscard]] GridPoints grid_points(sampling::LogDensity& target, const GridPosterior& posterior);

/// Moments are those of `transform(k, z_k)` (identity by default). Throws ProjectError for d > 3.
[[nodiscard]] GridPosterior grid_posterior(sampling::LogDensity& target,
                                           const GridPosterior::Transform& transform,
                                           const GridOptions& options = {});

}  // namespace knothe::assimilation
