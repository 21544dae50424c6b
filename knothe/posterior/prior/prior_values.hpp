#pragma once
/// @file The prior at the points of a posterior: with it the prior can be divided out.
#include <Eigen/Core>
#include <span>
#include <vector>

#include "knothe/posterior/prior/prior.hpp"

namespace knothe::posterior {

struct PriorValues {
  std::vector<Prior::Family> families;  ///< d
  Eigen::VectorXd mean, std;            ///< d, before truncation; of log p for a lognormal prior
  Eigen::MatrixXd log_density;          ///< n × d, of each parameter's prior; −1e6 where it is zero
  Eigen::VectorXd log_dependence;       ///< n, of a joint prior beside these; empty: independent
};

/// Of points, n × d.
[[nodiscard]] PriorValues prior_values(std::span<const Prior> priors, const Eigen::MatrixXd& points);

}  // namespace knothe::posterior
