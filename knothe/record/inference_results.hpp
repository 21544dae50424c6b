#pragma once
/// @file What `knothe infer` says and leaves: its line of JSON, and the folder with inference.json and
/// samples.nc.
#include <nlohmann/json.hpp>
#include <string>

#include "knothe/assimilation/inference/comparison.hpp"
#include "knothe/project/inference_setup.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::record {

/// The line of `knothe infer --json`: the keys of a step of an assimilation that make sense for one step, and
/// skewness, kurtosis, model_evaluations, samples_file, verdict. `axes`: of the parameters, for their names
/// and physical values.
[[nodiscard]] nlohmann::ordered_json inference_record(const assimilation::InferenceResult& result,
                                                      std::span<const model::Axis> axes,
                                                      const std::string& samples_file);

[[nodiscard]] nlohmann::ordered_json comparison_record(const assimilation::Comparison& comparison,
                                                       const std::string& first, const std::string& second);

/// Where the draws are written in a folder of results.
[[nodiscard]] std::string samples_path(const std::string& folder);

/// Writes FOLDER/inference.json (the record, and what the report shows) and FOLDER/samples.nc: NetCDF-4 with
/// ArviZ's groups `posterior` (equally weighted draws, [chain, draw]), `weighted_posterior` (points [point,
/// parameter] and weights [point]) and `sample_stats`; attributes project, seed, created_by, method; with a
/// map also FOLDER/map.h5 (transport/map_file.hpp; its metadata name parameters and priors). Atomic; IoError.
void write_inference(const std::string& folder, const project::Project& project,
                     const project::InferenceSetup& setup, const assimilation::InferenceResult& result);

}  // namespace knothe::record
