#pragma once
/// @file Numeric arrays of MATLAB's .mat files, version 5 (`save -v6`, `-v7`).
#include <map>
#include <string>
#include <vector>

namespace knothe::files {

/// The full, real, numeric arrays by name, in MATLAB's (column-major) order; other variables are left out.
/// DataError for what is not such a file or ends early.
[[nodiscard]] std::map<std::string, std::vector<double>> read_mat_arrays(const std::string& path);

}  // namespace knothe::files
