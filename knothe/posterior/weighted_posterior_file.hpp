#pragma once
/// @file The weighted points of a posterior in a file of results.
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "knothe/posterior/prior/prior_values.hpp"

namespace knothe::posterior {

struct WeightedPosterior {
  std::vector<std::string> parameters;  ///< d
  Eigen::MatrixXd points;               ///< n × d
  Eigen::VectorXd weights;              ///< n, sum 1
  std::optional<PriorValues> prior;     ///< files before 0.2, and those of a density, have none
};

/// Of `posterior.nc`, where it is that of the last step, or of `samples.nc`; `path`: the file, or a folder
/// that has one of them. Errors: DataError where there is none, or it is damaged.
[[nodiscard]] WeightedPosterior read_weighted_posterior(const std::string& path);

}  // namespace knothe::posterior
