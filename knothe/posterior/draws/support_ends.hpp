#pragma once
/// @file Where the support of a density ends along its coordinates: a positive parameter, a cube.
#include <Eigen/Core>

#include "knothe/posterior/checked_density.hpp"

namespace knothe::posterior {

/// d each; infinite where the support does not end, or ends elsewhere at other values of the other
/// coordinates.
struct SupportEnds {
  Eigen::VectorXd lower, upper;

  [[nodiscard]] static SupportEnds none(Eigen::Index d);
  [[nodiscard]] bool any() const;
  [[nodiscard]] bool at(Eigen::Index k) const;
  /// x, or its mirror image at the end that it is beyond.
  [[nodiscard]] double folded(double x, Eigen::Index k) const;
};

/// Ends that the draws (n × d, with their log π̄ [n]) suggest, and that lines along the coordinate through
/// four of them confirm, to a ten-thousandth of their distance from the draws' middle. Evaluates the target
/// at most 64 times for each end that is suggested.
[[nodiscard]] SupportEnds find_support_ends(CheckedDensity& target, const Eigen::MatrixXd& points,
                                            const Eigen::VectorXd& log_target);

}  // namespace knothe::posterior
