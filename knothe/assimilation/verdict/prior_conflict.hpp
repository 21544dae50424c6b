#pragma once
/// @file What prior and data say of each other: do they contradict each other, and what rests on the prior
/// alone? No residual shows it where parameters compensate.
#include <Eigen/Core>
#include <optional>
#include <span>

#include "knothe/assimilation/verdict/verdict.hpp"
#include "knothe/model/compress/snapshots.hpp"
#include "knothe/posterior/posterior.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::assimilation {

/// All in z, in which each prior is N(0, 1).
struct PriorConflict {
  /// d: how far the data's own value lies from the prior, in standard deviations of what both leave open;
  /// 0 for a parameter on which the data say (almost) nothing.
  Eigen::VectorXd distance;
  Eigen::VectorXd estimate, std;  ///< d: the value that the data give with the priors of the others
  Eigen::VectorXd pull;           ///< d: from there to the posterior mean, in posterior standard deviations
  double probability = 1;         ///< that chance brings all parameters together as far from the prior
  Eigen::MatrixXd covariance;     ///< d × d: C below
};

/// Prior predictive check (Box 1980; Evans and Moshonov 2006) of what the data say of the parameters. In z a
/// linear model with Gaussian noise has a posterior mean m and covariance C with
///
///   m ~ N(0, I − C)   if the truth is a draw from the prior,
///
/// and the data alone give the value m_a / (1 − C_aa) with the variance C_aa / (1 − C_aa) for parameter a. So
/// |m_a| / √(1 − C_aa) is its distance, and mᵀ (I − C)⁻¹ m of χ² distribution (with the correlations of a
/// joint prior in place of I). Directions in which the data
/// say less than a tenth of what the prior says do not count: there a curved model is not as this one. Only a
/// mean that has moved by more than one does, whatever C says.
/// Cost: O(d), and O(n d) in the points where a look at mean and covariance alone is not clear.
[[nodiscard]] PriorConflict find_prior_conflict(const posterior::PriorTransform& priors,
                                                const posterior::Posterior& posterior);

/// Of that: a reason where chance does it once in a thousand, or fifteen times where the prior moves the
/// answer by more than three standard deviations: there it matters, and the data cannot say it louder. Its
/// value is the distance. `axes`: d, the parameters' names, and what 1.0 means.
[[nodiscard]] std::optional<VerdictReason> conflict_reason(const PriorConflict& conflict,
                                                           const posterior::PriorTransform& priors,
                                                           std::span<const model::Axis> axes);

/// Where the data fix a combination of two parameters (correlation of 0.95 or more, of the prior's own freed)
/// and leave another one nine tenths of the prior's variance: a reason that names them, at most a caution.
/// Its value is the standard deviation along that combination, as a share of the prior's.
[[nodiscard]] std::optional<VerdictReason> not_told_apart(const PriorConflict& conflict,
                                                          const posterior::PriorTransform& priors,
                                                          std::span<const model::Axis> axes);

}  // namespace knothe::assimilation
