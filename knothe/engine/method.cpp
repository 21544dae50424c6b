#include "knothe/engine/method.hpp"

#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/engine/form_method.hpp"
#include "knothe/engine/ordered_method.hpp"

namespace knothe::engine {

std::unique_ptr<Method> make_method(const MethodSetup& setup) {
  using assimilation::Feature;
  assimilation::Features features = features_of(setup.update);
  add(features, Feature::baseline, setup.baseline.has_value());
  add(features, Feature::gate, setup.robust.gate > 0);
  add(features, Feature::student_t, setup.robust.degrees_of_freedom > 0);
  assimilation::require_compatible(features);
  if (!setup.baseline && !setup.robust.is_active()) return std::make_unique<FormMethod>(setup);
  return std::make_unique<OrderedMethod>(setup);
}

}  // namespace knothe::engine
