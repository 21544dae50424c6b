#pragma once
/// @file The model's functions w(p) over a posterior: what is predicted at any time, and how surely, follows.
#include <Eigen/Core>
#include <memory>

#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/posterior.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::likelihood {

/// w over a few weighted points of a distribution of p. The prediction at time t, lift_t + (OU) C_t w,
/// has mean (OU) C_t `mean` + lift_t and covariance (OU) C_t F Fᵀ C_tᵀ (OU)ᵀ with F = `factor`.
struct PosteriorFunctions {
  Eigen::VectorXd mean;       ///< w̄, r
  Eigen::MatrixXd deviation;  ///< r × n, w(p_k) − w̄
  Eigen::VectorXd weights;    ///< n, of the points, sum 1
  Eigen::MatrixXd cell;       ///< r × d: edges, in w, of the cell that each point stands for; or empty
  Eigen::MatrixXd factor;     ///< r × q, F: covariance of w up to 1e-8 of its trace
  /// r × d: where w goes when a parameter increases by a standard deviation (of what those before it leave
  /// open), by regression.
  Eigen::MatrixXd tangent;
};

/// Points that the functions are evaluated at: mean and spread of a prediction are wanted to a few per cent
/// of the spread.
inline constexpr Eigen::Index k_prediction_points = 256;

/// `k_prediction_points` × d equally likely points in place of weighted ones (n × d and n, sum 1): systematic
/// resampling.
[[nodiscard]] Eigen::MatrixXd equally_likely(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                             const Eigen::Ref<const Eigen::VectorXd>& weights);

/// The posterior's rule of few points where it has one, else `equally_likely` points.
[[nodiscard]] posterior::FewPoints few_points(const posterior::Posterior& posterior);

[[nodiscard]] PosteriorFunctions functions_at(const model::ParameterFunctions& functions,
                                              posterior::FewPoints few);

/// From weighted points (n × d and n, sum 1), thinned by `equally_likely`.
[[nodiscard]] PosteriorFunctions posterior_functions(const model::ParameterFunctions& functions,
                                                     const Eigen::Ref<const Eigen::MatrixXd>& points,
                                                     const Eigen::Ref<const Eigen::VectorXd>& weights);

/// From the prior, at Sobol points.
[[nodiscard]] PosteriorFunctions prior_functions(const model::ParameterFunctions& functions,
                                                 const posterior::PriorTransform& transform);

}  // namespace knothe::likelihood
