#pragma once
/// @file Draws from weighted points, no two of which are the same.
#include <Eigen/Core>

namespace knothe::numerics {

/// `count` draws that weigh the same, count × d, from weighted points (n × d, weights ≥ 0 with a positive
/// sum): those of `equal_draws`, but where several fall on one point only the first stays there. The others
/// are drawn from a normal kernel about it, shrunk towards the mean so that the covariance is kept (M. West,
/// J. R. Stat. Soc. B 55, 1993), of Silverman's width for the points that were drawn, and reflected at the
/// bounds of the support (d each, infinite where there is none). The same for the same input.
[[nodiscard]] Eigen::MatrixXd distinct_draws(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                             const Eigen::Ref<const Eigen::VectorXd>& weights,
                                             Eigen::Index count,
                                             const Eigen::Ref<const Eigen::VectorXd>& lower,
                                             const Eigen::Ref<const Eigen::VectorXd>& upper);

}  // namespace knothe::numerics
