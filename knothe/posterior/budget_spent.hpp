#pragma once
/// @file What a density says that may not be asked any more: a method ends with the answer that it has.
#include "knothe/base/error.hpp"

namespace knothe::posterior {

class BudgetSpent : public NumericalError {
 public:
  using NumericalError::NumericalError;
};

}  // namespace knothe::posterior
