#pragma once
/// @file The same model with its parameters in another order: the project file's order is the order
/// everywhere.
#include <span>
#include <string>

#include "knothe/reduction/model/model_file.hpp"

namespace knothe::reduction {

/// `contents` with axes in the order of `names`, which must be the names of its parameters: else ProjectError
/// that says which is missing or unknown.
[[nodiscard]] ModelContents with_parameter_order(ModelContents contents, std::span<const std::string> names);

}  // namespace knothe::reduction
