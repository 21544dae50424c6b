#include "knothe/project/serve_limits.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/text.hpp"

namespace knothe::project {
namespace {

constexpr const char* k_displacement = "displacement";

}  // namespace

assimilation::PlausibleRange serve_limits(const Project& project, const UpdateSetup& setup) {
  const reduction::Sensors& sensors = setup.measurements.sensors;
  assimilation::PlausibleRange range(*setup.observed, sensors,
                                     setup.measurements.noise.standard_deviations());
  std::vector<std::string> names = {k_displacement};
  names.insert(names.end(), sensors.scalars.begin(), sensors.scalars.end());
  for (const auto& [name, limit] : project.serve.limits) {
    const auto place = static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
    if (place == names.size())
      throw project.error_at("serve.limits." + name,
                             fmt::format("\"{}\" in [serve.limits] is not measured{}; there are: {}", name,
                                         did_you_mean(name, names), fmt::join(names, ", ")));
    place == 0 ? range.limit_displacements(limit) : range.limit_scalar(place - 1, limit);
  }
  return range;
}

}  // namespace knothe::project
