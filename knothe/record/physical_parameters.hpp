#pragma once
/// @file Parameters as a person measures them: 216 J/m3 × 1.001. Parameters of a model are multiples of their
/// reference values.
#include <Eigen/Core>
#include <chrono>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "knothe/files/netcdf.hpp"
#include "knothe/model/compress/snapshots.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::record {

[[nodiscard]] std::vector<std::string> parameter_names(std::span<const model::Axis> axes);

using model::reference_units;

/// [lower, upper] of a prior; null for an infinite end.
[[nodiscard]] nlohmann::ordered_json support_of(const posterior::Prior& prior);

/// By name: `mean` and `std` times the reference value, and their `units` ("1" for a pure number) where they
/// are known.
[[nodiscard]] nlohmann::ordered_json physical_record(std::span<const model::Axis> axes,
                                                     const Eigen::VectorXd& mean,
                                                     const Eigen::MatrixXd& covariance);

/// Unit and name in words of a parameter's variable in a results file.
[[nodiscard]] files::Labels labels_of(const model::Axis& axis);

/// Draws of a parameter into the group `posterior` of a results file, with its unit, and as attributes
/// `reference` and `reference_units`, the physical value of 1, if they are known.
void add_draws_of(const model::Axis& axis, const std::vector<std::string>& dimensions,
                  std::span<const double> draws, files::NetcdfWriter& out);

/// "2026-11-23T12:44:06.123Z" (ISO 8601).
[[nodiscard]] std::string utc_text(std::chrono::system_clock::time_point time);

}  // namespace knothe::record
