#pragma once
/// @file The page of the published study (studies/reproduction): a folder with reproduce.json.
#include <string>

namespace knothe::report {

[[nodiscard]] bool holds_study(const std::string& folder);

/// Reads FOLDER/reproduce.json and writes the page. Errors: DataError, IoError.
void write_study_report(const std::string& folder, const std::string& output);

}  // namespace knothe::report
