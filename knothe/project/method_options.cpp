#include "knothe/project/method_options.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/project/project_values.hpp"

namespace knothe::project {
namespace {

/// A whole number between two others, both included.
int read_between(Values& values, const std::string& key, int otherwise, int least, int most) {
  const auto value = values.integer(key, otherwise);
  if (value < least || value > most)
    values.complain(key, fmt::format("\"{}\" must be from {} to {}", key, least, most));
  return static_cast<int>(value);
}

void read_bias(Values& values, MethodOptions& method) {
  method.bias_correction = values.text("method.bias_correction", method.bias_correction);
  method.bias_extrapolation = values.text("method.bias_extrapolation", method.bias_extrapolation);
  method.bias_memory = values.number("method.bias_memory", method.bias_memory);
  method.bias_rank = read_between(values, "method.bias_rank", method.bias_rank, 1, 20);
  method.bias_order = read_between(values, "method.bias_order", method.bias_order, 0, 3);
  method.bias_window = read_between(values, "method.bias_window", method.bias_window, 1, 32);
}

void read_change(Values& values, MethodOptions& method) {
  method.forgetting = values.number("method.forgetting", method.forgetting);
  if (method.forgetting > 1)
    values.complain("method.forgetting", "\"method.forgetting\" must be at most 1, which forgets nothing");
  for (const double step : values.numbers("method.change_points")) {
    if (!(step >= 0 && step == std::floor(step) && step < 1e9)) {
      values.complain("method.change_points", "\"method.change_points\" must be steps, 0, 1, 2 …");
      break;
    }
    method.change_points.push_back(static_cast<std::size_t>(step));
  }
  method.change_retention = values.number("method.change_retention", method.change_retention);
  if (method.change_retention > 1)
    values.complain("method.change_retention", "\"method.change_retention\" must be from 0 to 1");
  method.restart_on_alarm = values.text("method.on_alarm", "none") == "restart";
}

}  // namespace

MethodOptions read_method(Values& values) {
  values.at_least("method.max_order", 1);
  if (values.integer("method.max_order", 1) > 23) {
    values.complain("method.max_order", "\"method.max_order\" must be at most 23");
  }
  MethodOptions method;
  method.kind = values.text("method.kind", method.kind);
  method.form = values.text("method.form", method.form);
  method.tolerance = values.number("method.tolerance", method.tolerance);
  method.max_order = static_cast<int>(values.integer("method.max_order", method.max_order));
  method.minimiser = values.text("method.minimiser", method.minimiser);
  method.mode_search = values.text("method.mode_search", method.mode_search);
  values.at_least("method.samples", 100);
  values.at_least("method.verification_points", 64);
  method.samples = static_cast<int>(values.integer("method.samples", method.samples));
  method.verification_points =
      static_cast<int>(values.integer("method.verification_points", method.verification_points));
  method.seed = static_cast<std::uint64_t>(values.integer("method.seed", 1));
  method.likelihood = values.text("method.likelihood", method.likelihood);
  method.degrees_of_freedom = values.number("method.degrees_of_freedom", method.degrees_of_freedom);
  method.gate = values.number("method.gate", method.gate);
  method.unknown_noise_level = values.text("method.noise_level", "known") == "unknown";
  method.noise_level_shape = values.number("method.noise_level_shape", method.noise_level_shape);
  method.noise_level_scale = values.number("method.noise_level_scale", method.noise_level_scale);
  method.offset_std = values.number("method.offset_std", method.offset_std);
  method.truncation_error = values.text("method.truncation_error", "off") == "on";
  read_change(values, method);
  read_bias(values, method);
  return method;
}

}  // namespace knothe::project
