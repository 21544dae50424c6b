#pragma once
/// @file The prior at the weighted points of a posterior: by it several specimens' likelihoods are found
/// again.
#include <Eigen/Core>
#include <span>
#include <string>

#include "knothe/files/netcdf.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::record {

/// Into a group that has the dimensions `point` and `parameter`: `log_prior` [point, parameter] at the points
/// (n × d), `log_dependence` [point] where the priors are not independent, and each prior's family, mean and
/// standard deviation. `read_weighted_posterior` reads them.
void add_prior_values(const std::string& group, std::span<const posterior::Prior> priors,
                      const Eigen::MatrixXd& points, files::NetcdfWriter& out);

}  // namespace knothe::record
