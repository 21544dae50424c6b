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

/// Draws of the parameters (n × d, chain after chain) into a group of a results file, [chain, draw], with
/// their units, and as attributes `reference` and `reference_units`, the physical value of 1, if they are
/// known.
void add_draws(const std::string& group, std::span<const model::Axis> axes, const Eigen::MatrixXd& draws,
               Eigen::Index chains, files::NetcdfWriter& out);
/// The dimensions `chain` and `draw` of a group: every `stride`-th draw, `draws` of them a chain.
void add_chains(const std::string& group, Eigen::Index chains, Eigen::Index draws, Eigen::Index stride,
                files::NetcdfWriter& out);
/// The attributes by which ArviZ says who made a group, and when.
void add_creator(std::initializer_list<const char*> groups, files::NetcdfWriter& out);

/// "2026-11-23T12:44:06.123Z" (ISO 8601).
[[nodiscard]] std::string utc_text(std::chrono::system_clock::time_point time);

}  // namespace knothe::record
