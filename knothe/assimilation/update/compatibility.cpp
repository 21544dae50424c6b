#include "knothe/assimilation/update/compatibility.hpp"

#include <fmt/format.h>

#include <vector>

#include "knothe/assimilation/update/update_options.hpp"
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
       {F::baseline},
       "method.kind",
       "models are compared by their evidence, which this method.kind does not give exactly: with [model] "
       "candidates it is \"auto\", \"transport\" or \"grid\""},
      {F::candidates,
       {F::gate, F::student_t},
       "method",
       "{0} judges the data by the model: models that are compared would see other data; leave out {0} or "
       "[model] candidates"},
      {F::verified,
       {F::known, F::candidates, F::truncation},
       "method.verify",
       "verify = \"full-order\" refines one model of the parameters that are inferred, by the full-order "
       "model: "
       "it cannot be combined with {} (`knothe offline --refine` makes a finer model of the results)"},
      {F::service,
       {F::clock},
       "data.clock",
       "data.clock is for `knothe assimilate`: streamed data must carry model times"},
      {F::service,
       {F::known},
       "parameters",
       "a known parameter without a value, or beside [model] candidates, is for `knothe assimilate`: data "
       "that "
       "come one by one do not bring it; give it a \"value\", which then holds for all of them"},
      {F::baseline,
       {F::gate, F::student_t, F::noise_level},
       "method.kind",
       "this method.kind does without likelihood = \"student-t\", gate and noise_level = \"unknown\": these "
       "need \"auto\", \"transport\" or \"grid\""},
      {F::changes,
       {F::baseline, F::gate, F::student_t},
       "method",
       "forgetting, change_points and on_alarm = \"restart\" need method auto, transport or grid and the "
       "Gaussian "
       "likelihood without a gate only"},
      {F::noise_level,
       {F::composed, F::student_t},
       "method.noise_level",
       "noise_level = \"unknown\" links all data: it takes form = \"collapsed\" and likelihood = "
       "\"gaussian\", "
       "not composed maps, which take the data one by one"},
      {F::truncation,
       {F::student_t, F::noise_level, F::bias, F::pictures, F::clock, F::known, F::series, F::reference},
       "method.truncation_error",
       "truncation_error = \"on\" makes the noise another one at each step, correlated and of known size: it "
       "takes displacements from a file, at model times, whose errors do not share those of a reference "
       "picture, and does without {} (bias_correction estimates the model's error from the data)"},
      {F::bias,
       {F::baseline, F::gate, F::student_t},
       "",
       "bias_correction and --redo need method auto, transport or grid and the Gaussian likelihood only"},
      {F::bias,
       {F::lasting},
       "",
       "bias_correction cannot be combined with {}: data cannot tell a bias from such an error"},
      {F::noise_level,
       {F::lasting},
       "",
       "noise_level = \"unknown\" cannot be combined with {}: one factor cannot be that of both errors"},
      {F::bias,
       {F::noise_level},
       "",
       "bias_correction cannot be combined with noise_level = \"unknown\": data cannot tell a bias from "
       "noise"},
      {F::bias,
       {F::scale},
       "",
       "bias_correction cannot be combined with a scale that is not known exactly (relative_scale_std, "
       "dic.scale_std): leave out one of them"},
      {F::extrapolated_bias,
       {F::reference, F::offsets},
       "",
       "an extrapolated bias cannot be combined with noise that steps share (shared_reference, "
       "offset_std): its likelihood replaces the noise of each step; take bias_extrapolation = \"joint\""},
      {F::joint_bias,
       {F::lasting_clock},
       "",
       "bias_correction cannot be combined with a clock or a known parameter that has a std beside noise "
       "that steps share (shared_reference, offset_std): the estimate of each clock would depend on the "
       "bias; leave out one of them"},
      {F::joint_bias,
       {F::composed},
       "",
       "composed maps take the data one by one, but a bias that is unknown together with the parameters "
       "links "
       "them: use the collapsed form, or bias_extrapolation = \"linear\""},
      {F::changes,
       {F::noise_level, F::composed, F::bias, F::reference, F::offsets, F::scale, F::lasting},
       "",
       "forgetting, change_points and on_alarm = \"restart\" cannot be combined with {}: these require "
       "that old data keep their full weight"},
      {F::student_t,
       {F::correlated, F::reference, F::offsets, F::scale, F::lasting},
       "",
       "a Student-t likelihood is for sensors whose noise is independent in space and time: use gating "
       "(method.gate) with noise/precision, shared_reference, offsets, a scale or shared_std"},
      {F::student_t,
       {F::step_error},
       "",
       "a Student-t likelihood judges sensors one by one, but an error of the clock (its std) is common to "
       "all: give the clock no std, or take a gate with likelihood = \"gaussian\""},
  };
  return rows;
}

std::string_view name_of(Feature feature) {
  switch (feature) {
    case F::baseline:
      return "method.kind = \"ekf\", \"ukf\", \"enkf\", \"smc\" or \"mcmc\"";
    case F::composed:
      return "form = \"composed\"";
    case F::gate:
      return "gate";
    case F::student_t:
      return "likelihood = \"student-t\"";
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
    case F::correlated:
      return "correlated noise (noise/precision)";
    case F::reference:
      return "errors that steps share (shared_reference)";
    case F::offsets:
      return "errors that steps share (offset_std)";
    case F::scale:
      return "a scale that is not known exactly (relative_scale_std, dic.scale_std)";
    case F::lasting:
      return "an error that a series shares (shared_std)";
    case F::step_error:
      return "a clock or a known parameter with a std";
    case F::lasting_clock:
      return "such a std beside errors that steps share";
    case F::pictures:
      return "pictures";
    case F::clock:
      return "data.clock";
    case F::known:
      return "known parameters";
    case F::series:
      return "forces, gauges";
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

Features features_of(const NoiseModel& noise) {
  Features features;
  const bool lasts = noise.shared_reference() > 0 || noise.offset_std() > 0;
  add(features, F::correlated, !noise.is_independent());
  add(features, F::reference, noise.shared_reference() > 0);
  add(features, F::offsets, noise.offset_std() > 0);
  add(features, F::scale, noise.scale_std() > 0);
  add(features, F::lasting, noise.lasting_count() > 0);
  add(features, F::step_error, noise.has_step_errors());
  add(features, F::lasting_clock, noise.has_step_errors() && lasts);
  return features;
}

Features features_of(const UpdateOptions& options) {
  Features features;
  const bool corrects = options.learn_bias || options.bias_correction != BiasCorrectionMode::off;
  const bool joint = options.bias.way == BiasOptions::Way::joint;
  add(features, F::composed, options.form == UpdateOptions::Form::composed);
  add(features, F::noise_level, options.noise_level.has_value());
  add(features, F::bias, corrects);
  add(features, F::joint_bias, corrects && joint);
  add(features, F::extrapolated_bias, corrects && !joint);
  add(features, F::changes,
      options.forgetting < 1 || !options.change_points.empty() || options.restart_on_alarm);
  return features;
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
