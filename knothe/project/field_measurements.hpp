#pragma once
/// @file From the fields of a project to measurements: displacement sensors at their points.
#include <string>
#include <vector>

#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

struct FieldMeasurements {
  likelihood::Measurements measurements;
  std::vector<std::string> read;  ///< a line for each file: what was found in it
};

/// Reads the fields of [data.fields], two sensors a point, x then y, in the model's frame. Errors: DataError
/// for files, and for what neither they nor the project say: it names the key to give.
[[nodiscard]] FieldMeasurements measure_fields(const Project& project, const model::ModelContents& model);

/// The noise with a rigid motion of each field besides, `motion_std` of the project; `m` may have series
/// behind the displacements.
[[nodiscard]] likelihood::NoiseModel with_motion(const FieldOptions& fields,
                                                 const likelihood::Measurements& m);

}  // namespace knothe::project
