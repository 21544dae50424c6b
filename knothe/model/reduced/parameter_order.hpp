#pragma once
/// @file A model's parameters by their names: the project file's order is the order everywhere.
#include <span>
#include <string>
#include <vector>

#include "knothe/model/reduced/model_file.hpp"

namespace knothe::model {

/// `contents` with axes in the order of `names`, which must be the names of its parameters: else ProjectError
/// that says which is missing or unknown.
[[nodiscard]] ModelContents with_parameter_order(ModelContents contents, std::span<const std::string> names);

/// A point as a command line has it, "NAME=V,NAME=V" after --at → the values in the order of `names`.
/// UsageError for a name or number that is none, is missing or comes twice.
[[nodiscard]] std::vector<double> point_at(const std::string& text, const std::vector<std::string>& names);

}  // namespace knothe::model
