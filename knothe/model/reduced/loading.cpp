#include "knothe/model/reduced/loading.hpp"

#include <algorithm>
#include <functional>

namespace knothe::model {

std::optional<double> Loading::at(double time) const {
  const std::size_t after = std::lower_bound(times.begin(), times.end(), time) - times.begin();
  const bool rises = std::adjacent_find(values.begin(), values.end(), std::greater_equal<>()) == values.end();
  if (values.size() != times.size() || after == times.size() || !rises || (after == 0 && time < times[0]))
    return std::nullopt;
  if (after == 0) return values[0];
  return values[after] -
         (values[after] - values[after - 1]) * (times[after] - time) / (times[after] - times[after - 1]);
}

Loading loading_of(const SeparatedModel& model, const std::string& clock, std::vector<double> p) {
  const std::string name = clock.empty() ? "imposed_displacement" : clock;
  const auto names = model.output_names();
  const ModelContents& contents = model.contents();
  if (std::find(names.begin(), names.end(), name) == names.end())
    return {{}, {}, contents.time, {}, contents.time_units};
  for (std::size_t k = 0; k < p.size(); ++k)
    p[k] = std::clamp(p[k], contents.axes[k].nodes.front(), contents.axes[k].nodes.back());
  return {name, output_units(contents, name), contents.time, model.evaluate_output(name, p).value,
          contents.time_units};
}

}  // namespace knothe::model
