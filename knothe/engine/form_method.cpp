#include "knothe/engine/form_method.hpp"

namespace knothe::engine {

FormMethod::FormMethod(const MethodSetup& setup)
    : update_(setup.model, setup.noise, setup.priors, setup.update) {
  if (setup.corrected_steps) update_.redo((*setup.corrected_steps)[0], (*setup.corrected_steps)[1]);
}

}  // namespace knothe::engine
