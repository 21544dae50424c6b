#pragma once
/// @file The same model with its parameters in another order.
#include <string>
#include <vector>

#include "knothe/reduction/model_file.hpp"

namespace knothe::reduction {

/// `contents` with its axes, and everything that is stored along them, in the order of `names`, a permutation
/// of the model's parameter names (asserted).
[[nodiscard]] ModelContents with_parameter_order(ModelContents contents,
                                                 const std::vector<std::string>& names);

}  // namespace knothe::reduction
