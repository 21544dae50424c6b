#pragma once
/// @file The fields of a posterior and of a step: one list each, from which lines of JSON, NetCDF, the schema
/// of the service and the reading of a results folder are made. A new number of a result is an entry here.
#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "knothe/assimilation/inference/inference.hpp"
#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/files/netcdf.hpp"
#include "knothe/record/json_object.hpp"

namespace knothe::record {

/// An entry that is made elsewhere, of a JSON type.
struct Made {
  const char* type;
};

/// A field of a result: its key in every file, where it is kept, and what it means.
template <class Result>
struct Field {
  using Member = std::variant<bool Result::*, int Result::*, std::size_t Result::*, Index Result::*,
                              double Result::*, Eigen::VectorXd Result::*, Eigen::MatrixXd Result::*, Made>;
  const char* key;
  Member member;
  const char* meaning;
};

/// What every line of a step, and what the line of an inference has, in the order of its keys.
[[nodiscard]] std::span<const Field<assimilation::UpdateResult>> step_fields();
[[nodiscard]] std::span<const Field<assimilation::InferenceResult>> inference_fields();

/// The fields as an object: those that are made elsewhere are null, but for `method` and `quantiles`.
[[nodiscard]] nlohmann::ordered_json fields_record(const assimilation::UpdateResult& step);
[[nodiscard]] nlohmann::ordered_json fields_record(const assimilation::InferenceResult& result);

/// The fields of a line, and the levels of its quantiles. DataError for one that is missing or has the wrong
/// kind or shape.
void read_fields(const JsonObject& line, assimilation::UpdateResult& step, std::vector<double>& levels);

/// JSON Schemas of the lines, {"step", "inference", "verdict"}: their properties, and which every line has.
[[nodiscard]] nlohmann::ordered_json line_schemas();

/// Adds the numbers among the fields to a group, over its dimension `step`, which is there.
void add_statistics(const std::string& group, std::span<const assimilation::UpdateResult* const> steps,
                    files::NetcdfWriter& out);
void add_statistics(const std::string& group, const assimilation::InferenceResult& result,
                    files::NetcdfWriter& out);

}  // namespace knothe::record
