#include "knothe/assimilation/update/compatibility.hpp"

#include <fmt/format.h>

#include <vector>

#include "knothe/assimilation/update/problem.hpp"
#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

using F = Feature;

/// `one` goes with none of `others`; {} in the message stands for the other one.
struct Row {
  Feature one;
  std::vector<Feature> others;
  std::string_view key, message;
};

const std::vector<Row>& table() {
  static const std::vector<Row> rows = {
      {F::candidates,
       {F::gate},
       "method.gate",
       "with a gate each candidate would use different data, and evidences of different data cannot be "
       "compared: leave out the gate or [model] candidates"},
      {F::verified,
       {F::candidates},
       "method.verify",
       "verify = \"full-order\" refines one model by the full-order model: it cannot be combined with {} "
       "(`knothe offline --refine` makes a finer model of the results)"},
      {F::service,
       {F::clock},
       "data.clock",
       "data.clock is for `knothe assimilate`: streamed data must carry model times"},
      {F::service,
       {F::known},
       "parameters",
       "a known parameter without a value, or beside [model] candidates, is for `knothe assimilate`: data "
       "that come one by one do not bring it; give it a \"value\", which then holds for all of them"},
      {F::noise_level,
       {F::student_t},
       "method.noise_level",
       "noise_level = \"unknown\" links all data by one factor of their Gaussian noise, and a Student-t "
       "likelihood has a scale of its own for each value: take likelihood = \"gaussian\""},
      {F::noise_level,
       {F::lasting},
       "",
       "noise_level = \"unknown\" cannot be combined with {}: one factor cannot be that of both errors"},
      {F::sequential,
       {F::linked},
       "",
       "composed maps and Kalman filters take the data one by one, but {} links all of them: use another "
       "method.kind with form = \"collapsed\" (or, for a bias, bias_extrapolation = \"linear\")"},
      {F::bias,
       {F::robust},
       "",
       "bias_correction and --redo cannot be combined with a gate or a Student-t likelihood: what the model "
       "gets wrong would be taken for outliers"},
      {F::bias,
       {F::bias_like},
       "",
       "bias_correction cannot be combined with noise_level = \"unknown\", a scale that is not known exactly "
       "(relative_scale_std, dic.scale_std) or an error that a series shares (shared_std): the data cannot "
       "tell a bias from these; leave out one of them"},
      {F::extrapolated_bias,
       {F::shared},
       "",
       "an extrapolated bias cannot be combined with noise that steps share (shared_reference, offset_std): "
       "its likelihood replaces the noise of each step; take bias_extrapolation = \"joint\""},
      {F::joint_bias,
       {F::shared_clock},
       "",
       "bias_correction cannot be combined with a clock, a known parameter that has a std or "
       "truncation_error = \"on\" beside noise that steps share (shared_reference, offset_std): the estimate "
       "of each step's error would depend on the bias; leave out one of them"},
      {F::changes,
       {F::bias, F::shared},
       "",
       "forgetting, change_points and on_alarm = \"restart\" cannot be combined with {}: these require that "
       "old data keep their full weight"},
      {F::student_t,
       {F::dependent},
       "",
       "a Student-t likelihood is for sensors whose errors are independent in space and time: with {} take a "
       "gate (method.gate) and likelihood = \"gaussian\""},
  };
  return rows;
}

std::string_view name_of(Feature feature) {
  switch (feature) {
    case F::sequential:
      return "composed maps and Kalman filters";
    case F::gate:
      return "gate";
    case F::student_t:
      return "likelihood = \"student-t\"";
    case F::robust:
      return "gate or likelihood = \"student-t\"";
    case F::linked:
      return "noise_level = \"unknown\", likelihood = \"student-t\" or a joint bias_correction";
    case F::noise_level:
      return "noise_level = \"unknown\"";
    case F::bias:
      return "bias_correction and --redo";
    case F::joint_bias:
      return "bias_correction, joint";
    case F::extrapolated_bias:
      return "bias_correction, extrapolated";
    case F::changes:
      return "forgetting, change_points and on_alarm";
    case F::truncation:
      return "truncation_error = \"on\"";
    case F::dependent:
      return "errors that sensors or steps share (noise/precision, shared_reference, offset_std, scales, "
             "clocks, truncation_error)";
    case F::shared:
      return "errors that steps share (shared_reference, offset_std, scales, shared_std)";
    case F::lasting:
      return "an error that a series shares (shared_std)";
    case F::bias_like:
      return "noise_level = \"unknown\"; a scale that is not known exactly; shared_std";
    case F::shared_clock:
      return "an error of each step beside errors that steps share";
    case F::clock:
      return "data.clock";
    case F::known:
      return "known parameters";
    case F::service:
      return "`knothe serve`";
    case F::candidates:
      return "`[model] candidates`";
    case F::verified:
      return "verify = \"full-order\"";
    case F::count:
      break;
  }
  return "";
}

bool has(const Features& features, Feature feature) {
  return features[static_cast<std::size_t>(feature)];
}

}  // namespace

Features features_of(const likelihood::NoiseModel& noise) {
  Features features;
  const bool of_dofs = noise.shared_reference() > 0 || noise.offset_std() > 0;
  add(features, F::dependent,
      !noise.measurement().is_independent() || likelihood::links_steps(noise) || noise.has_step_errors());
  add(features, F::shared, likelihood::links_steps(noise));
  add(features, F::lasting, likelihood::lasting_count(noise) > 0);
  add(features, F::bias_like, noise.scale_std() > 0 || likelihood::lasting_count(noise) > 0);
  add(features, F::shared_clock, noise.has_step_errors() && of_dofs);
  return features;
}

Features features_of(const UpdateOptions& options) {
  Features features;
  const bool corrects = options.learn_bias || options.bias_correction != likelihood::BiasCorrectionMode::off;
  const bool joint = options.bias.way == likelihood::BiasOptions::Way::joint;
  add(features, F::sequential,
      options.form == UpdateOptions::Form::composed || posterior::is_filter(options.kind));
  add(features, F::noise_level, options.noise_level.has_value());
  add(features, F::bias_like, options.noise_level.has_value());
  add(features, F::linked, options.noise_level.has_value() || (corrects && joint));
  add(features, F::bias, corrects);
  add(features, F::joint_bias, corrects && joint);
  add(features, F::extrapolated_bias, corrects && !joint);
  add(features, F::changes,
      options.forgetting < 1 || !options.change_points.empty() || options.restart_on_alarm);
  return features;
}

Features features_of(double gate, double degrees_of_freedom) {
  Features features;
  add(features, F::gate, gate > 0);
  add(features, F::student_t, degrees_of_freedom > 0);
  add(features, F::robust, gate > 0 || degrees_of_freedom > 0);
  add(features, F::linked, degrees_of_freedom > 0);
  return features;
}

Features features_of(const Problem& problem) {
  return features_of(problem.update) | features_of(problem.noise) |
         features_of(problem.robust.gate, problem.robust.degrees_of_freedom);
}

Conflict find_conflict(const Features& features) {
  for (const Row& row : table()) {
    if (!has(features, row.one)) continue;
    for (const Feature other : row.others) {
      if (has(features, other))
        return {std::string(row.key), fmt::format(fmt::runtime(row.message), name_of(other))};
    }
  }
  return {};
}

void require_compatible(const Features& features) {
  const Conflict found = find_conflict(features);
  if (!found.message.empty()) throw UsageError(found.message);
}

std::string compatibility_table() {
  std::string text = "| what | cannot be combined with | message |\n| --- | --- | --- |\n";
  for (const Row& row : table()) {
    std::string others;
    for (const Feature other : row.others) {
      if (!others.empty()) others += "; ";
      others += name_of(other);
    }
    text += fmt::format("| {} | {} | {} |\n", name_of(row.one), others,
                        fmt::format(fmt::runtime(row.message), "…"));
  }
  return text;
}

}  // namespace knothe::assimilation
