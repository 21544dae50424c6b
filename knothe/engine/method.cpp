#include "knothe/engine/method.hpp"

#include "knothe/base/error.hpp"
#include "knothe/engine/form_method.hpp"
#include "knothe/engine/ordered_method.hpp"

namespace knothe::engine {

std::unique_ptr<Method> make_method(const MethodSetup& setup) {
  if (!setup.baseline && !setup.robust.is_active()) return std::make_unique<FormMethod>(setup);
  if (setup.update.learn_bias || setup.update.bias_correction != assimilation::BiasCorrectionMode::off) {
    throw UsageError(
        "bias_correction and --redo go with method transport or grid and the Gaussian likelihood only");
  }
  return std::make_unique<OrderedMethod>(setup);
}

}  // namespace knothe::engine
