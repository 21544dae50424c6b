#pragma once
/// @file What `knothe population` says and leaves: a line of JSON, a table, and a folder whose posterior is
/// that of a new specimen.
#include <nlohmann/json.hpp>
#include <string>

#include "knothe/assimilation/population/population.hpp"

namespace knothe::record {

[[nodiscard]] nlohmann::ordered_json population_record(const assimilation::PopulationResult& result);

/// For people.
[[nodiscard]] std::string population_text(const assimilation::PopulationResult& result);

/// Writes FOLDER/population.json (the record) and FOLDER/samples.nc: the posterior of a new specimen's
/// parameters as `knothe infer` writes one, and in the group `population` the weighted points of mean, spread
/// and correlation. Atomic; IoError.
void write_population(const std::string& folder, const assimilation::PopulationResult& result);

}  // namespace knothe::record
