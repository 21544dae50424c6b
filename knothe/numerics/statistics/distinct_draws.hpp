#pragma once
/// @file Draws from weighted points, no two of which are the same.
#include <Eigen/Core>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// `count` draws that weigh the same, count × d, in random order, from weighted points (n × d, weights ≥ 0
/// with a positive sum): those of `equal_draws`, but where several fall on one point only the first stays
/// there. Each of the others takes a normal step of the covariance of the 2d + 2 draws nearest to it,
/// shortened so that all steps add at most 1 % to the variance of any axis: local, so that modes stay apart
/// and curved shapes thin. A coordinate whose values many points share, as those of a lattice do, is moved
/// within its cell instead, which adds a twelfth of the square of the spacing. Reflected at the bounds of the
/// support (d each, infinite where there is none). The same for the same input.
[[nodiscard]] Eigen::MatrixXd distinct_draws(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                             const Eigen::Ref<const Eigen::VectorXd>& weights, Index count,
                                             const Eigen::Ref<const Eigen::VectorXd>& lower,
                                             const Eigen::Ref<const Eigen::VectorXd>& upper);

}  // namespace knothe::numerics
