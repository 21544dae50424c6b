#pragma once
/// @file Draws weighted with the help of a density close to the target whose moments are known.
#include <Eigen/Core>
#include <functional>
#include <optional>

#include "knothe/posterior/draws/mixture_product.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {

/// Functions of the draws whose means over all draws that there might be are 0, but for the error of how they
/// were found.
struct ControlVariates {
  Eigen::MatrixXd values;               ///< n × c
  Eigen::MatrixXd covariance_of_means;  ///< c × c
};

/// h(x)/q(x) times 1, v_k and v_k² for draws x of q, less the means of these functions over h, which 200,000
/// draws of h give: they cost no value of the target. `points`: n × d; `log_q`: n; v: the variables (n × k)
/// of points.
[[nodiscard]] ControlVariates control_variates(
    const MixtureProduct& h, const Eigen::MatrixXd& points, const Eigen::VectorXd& log_q,
    const std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>& variables, RandomNumbers& random);

struct CalibratedWeights {
  Eigen::VectorXd weights;  ///< n, sum 1
  MomentErrors errors;      ///< the largest of all variables
};

/// Weights with which the controls have the mean 0: what they have by chance is taken from all moments by
/// linear regression (Owen, Zhou 2000; Deville, Särndal 1992). The errors are those of the residuals, and no
/// less than two thirds of what they were.
/// `weights`: n, sum 1; `variables`: n × k. Nothing where a weight would be negative.
[[nodiscard]] std::optional<CalibratedWeights> calibrate(const ControlVariates& controls,
                                                         const Eigen::VectorXd& weights,
                                                         const Eigen::MatrixXd& variables);

}  // namespace knothe::posterior
