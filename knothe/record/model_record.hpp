#pragma once
/// @file A reduced model as other programs read it: lines of JSON.
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::record {

/// The line of `knothe model info --json`.
[[nodiscard]] nlohmann::ordered_json model_record(const model::SeparatedModel& model);

/// The line of `knothe model import --json`; `file`: where the model was written to.
[[nodiscard]] nlohmann::ordered_json import_record(const std::string& file,
                                                   const model::ModelContents& model);

}  // namespace knothe::record
