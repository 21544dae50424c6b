#pragma once
/// @file The report of `knothe infer`: what was found, whether to trust it, and how it was found.
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace knothe::report {

/// Whether the folder holds the results of an inference, newer than those of an assimilation if it has both.
[[nodiscard]] bool holds_inference(const std::string& results_folder);

/// The page, from the content of inference.json. `where` names the file in messages. Errors: DataError for a
/// member that is missing or of the wrong kind.
[[nodiscard]] std::string inference_report(const nlohmann::json& content, const std::string& where);

/// Reads RESULTS/inference.json and writes the page. Errors: DataError, IoError.
void write_inference_report(const std::string& results_folder, const std::string& output);

}  // namespace knothe::report
