#pragma once
/// @file Can the result be used? A verdict with its reasons and remedies (docs/explanation/verdict.md).
#include <Eigen/Core>
#include <array>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "knothe/base/enum_names.hpp"

namespace knothe::assimilation {

/// In rising order: use it; use it knowing this; do not use it.
enum class VerdictLevel { ok, caution, reject };

constexpr auto names_of(VerdictLevel /*level*/) {
  using Level = VerdictLevel;
  return std::to_array<Named<Level>>(
      {{Level::ok, "ok"}, {Level::caution, "caution"}, {Level::reject, "reject"}});
}

/// Which part of the verdict a reason belongs to.
enum class VerdictPart { computation, fit, prior, range, model, bias, outlier };

constexpr auto names_of(VerdictPart /*part*/) {
  using Part = VerdictPart;
  return std::to_array<Named<Part>>({{Part::computation, "computation"},
                                     {Part::fit, "fit"},
                                     {Part::prior, "prior"},
                                     {Part::range, "range"},
                                     {Part::model, "model"},
                                     {Part::bias, "bias"},
                                     {Part::outlier, "outlier"}});
}

/// What a misfit looks like.
enum class MisfitCause {
  sign,
  scale,
  time_shift,
  lost_frame,
  time_base,
  smoothing,
  component,
  sensor_order,
  single_sensor,
  few_steps,
  saturation,
  offset,
  noise_level,
  unknown
};

constexpr auto names_of(MisfitCause /*cause*/) {
  using Cause = MisfitCause;
  return std::to_array<Named<Cause>>({{Cause::sign, "sign"},
                                      {Cause::scale, "scale"},
                                      {Cause::time_shift, "time_shift"},
                                      {Cause::lost_frame, "lost_frame"},
                                      {Cause::time_base, "time_base"},
                                      {Cause::smoothing, "smoothing"},
                                      {Cause::component, "component"},
                                      {Cause::sensor_order, "sensor_order"},
                                      {Cause::single_sensor, "single_sensor"},
                                      {Cause::few_steps, "few_steps"},
                                      {Cause::saturation, "saturation"},
                                      {Cause::offset, "offset"},
                                      {Cause::noise_level, "noise_level"},
                                      {Cause::unknown, "unknown"}});
}

struct VerdictReason {
  VerdictPart part = VerdictPart::computation;
  VerdictLevel level = VerdictLevel::caution;
  double value = 0, limit = 0;       ///< what was found, and from where on it is a reason
  std::string message;               ///< what it is, and what to do
  std::optional<MisfitCause> cause;  ///< of a misfit
  bool is_about_noise =
      false;  ///< a misfit that says the noise is not as stated, not that the model is wrong
};

/// χ² of data under the whole likelihood: the noise of each datum, and all that is marginalised.
struct Misfit {
  double statistic = 0;
  Eigen::Index values = 0;
  double probability = 1;  ///< of as much or more, if the model is right
};

struct Verdict {
  VerdictLevel level = VerdictLevel::ok;
  std::vector<VerdictReason> reasons;  ///< none where the level is `ok`
  /// d: how far the reduced model's own error moves each posterior mean, in its standard deviation; empty
  /// where the model's file does not know its error.
  Eigen::VectorXd model_shift_std;
  double fit_probability = 1;  ///< of a misfit as large as that of all data so far, if the model is right
  Eigen::VectorXd edge_mass;   ///< d: posterior mass in the outer 2 % of the model's box, at either side
  Misfit latest;               ///< of the last step's data at the posterior mean, given all data before them

  /// Adds a reason; the level is that of the gravest.
  void add(VerdictReason reason);
  /// The reason that says the data do not fit the model; null where they do, or where only the noise is not
  /// as stated.
  [[nodiscard]] const VerdictReason* misfit() const;
};

/// The verdict of a run: the worst of the last tenth of its steps, with every reason that still stood there
/// (the last of each part and cause), and the numbers of the last step.
class RunVerdict {
 public:
  void add(Verdict verdict) { verdicts_.push_back(std::move(verdict)); }
  [[nodiscard]] Verdict verdict() const;
  /// The model has been refined, and all data are tested by it again: of the verdicts so far only what they
  /// said of rejected values stands.
  void forget_model();

 private:
  std::deque<Verdict> verdicts_;
};

/// The level in words, and each reason on a line of its own.
[[nodiscard]] std::string verdict_text(const Verdict& verdict);

}  // namespace knothe::assimilation
