#pragma once
/// @file The answer of every way of inference: weighted points of the parameters, what follows from them, and
/// how good it is.
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/method.hpp"
#include "knothe/posterior/trust.hpp"

namespace knothe::posterior {

/// A coarser rule of the same posterior, for what is asked of every datum.
struct FewPoints {
  Eigen::MatrixXd points;   ///< n × d, p
  Eigen::VectorXd weights;  ///< n, sum 1
  Eigen::MatrixXd cell;     ///< d × d: edges of the cell, in p, that each point stands for; empty: of none
};

/// A posterior of d parameters p in the order of the priors. Moments, quantiles and evidence belong to the
/// weighted points, or are better than these where the method knows better (quadrature).
struct Posterior {
  Eigen::MatrixXd points;   ///< n × d, p: what a forecast is made of
  Eigen::VectorXd weights;  ///< n, sum 1
  FewPoints few;            ///< every other node of a lattice; empty without one

  Eigen::VectorXd mean;                  ///< d
  Eigen::MatrixXd covariance;            ///< d × d, symmetric to the bit
  Eigen::MatrixXd quantiles;             ///< d × levels (`numerics::k_quantile_levels`)
  Eigen::VectorXd maximum_a_posteriori;  ///< d, maximises the density in p
  Eigen::VectorXd map_mean;              ///< d, of the map alone where there is one
  Eigen::MatrixXd map_covariance;        ///< d × d, of the map alone where there is one
  std::optional<double> noise_level;     ///< mean of the factor of all variances, where it is inferred

  double log_evidence = 0;              ///< natural logarithm, all constants included
  double log_evidence_error = 0;        ///< its standard error, where the method states one
  double log_evidence_lower_bound = 0;  ///< of the map, Eq. 24: low by the Kullback-Leibler divergence

  Method method = Method::transport;  ///< that made the points; `grid` is quadrature
  int map_order = 0;                  ///< 0 without a map
  double variance_diagnostic =
      0;                          ///< Eq. 9, verified on points other than the training ones; 0 without a map
  bool tolerance_reached = true;  ///< without a map: converged
  double effective_sample_size = 1;  ///< fraction
  bool second_mode_found = false;
  bool trusted = true;  ///< the computation (posterior/trust.hpp)
  /// Points, moments and evidence are by a quadrature that has converged: right, whatever the map is.
  bool by_quadrature = false;
  std::string remark;  ///< why the tolerance was not reached or the result is not trusted; else empty

  /// `why_missed`: why the tolerance was missed, where it was; the remark says that first.
  void set_trust(const Trust& trust, const std::string& why_missed = "") {
    trusted = trust.trusted;
    remark = why_missed + (why_missed.empty() || trust.reason.empty() ? "" : "; ") + trust.reason;
  }
  /// Sets mean and covariance from points and weights.
  void summarise() { numerics::mean_and_covariance(points, weights, mean, covariance); }
  [[nodiscard]] Eigen::VectorXd standard_deviations() const {
    return covariance.diagonal().cwiseMax(0).cwiseSqrt();
  }
};

}  // namespace knothe::posterior
