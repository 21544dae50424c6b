#pragma once
/// @file The page of `knothe report` for `knothe infer --compare A,B`: both posteriors in one picture.
#include <string>

namespace knothe::report {

/// Whether the folder holds a comparison and nothing newer of its own.
[[nodiscard]] bool holds_comparison(const std::string& results_folder);

/// Reads RESULTS/comparison.json and the inference.json of both methods' folders, and writes the page.
/// Errors: DataError for files that are missing or not of that kind; IoError.
void write_comparison_report(const std::string& results_folder, const std::string& output);

}  // namespace knothe::report
