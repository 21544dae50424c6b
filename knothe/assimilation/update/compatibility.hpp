#pragma once
/// @file What cannot be combined: one table, with the reasons.
#include <bitset>
#include <string>
#include <string_view>

#include "knothe/likelihood/noise/noise_model.hpp"

namespace knothe::assimilation {

/// What a user may ask for, or what data may bring, as far as something else does not go with it.
enum class Feature {
  sequential,         ///< composed maps and Kalman filters, which go on from the datum before
  gate,               ///< values are rejected
  student_t,          ///< Student-t likelihood
  robust,             ///< one of these two
  noise_level,        ///< unknown noise level
  linked,             ///< what links all data: unknown noise level, Student-t, a joint bias
  bias,               ///< correction of bias, one of the two below
  joint_bias,         ///< unknown together with the parameters
  extrapolated_bias,  ///< the paper's
  changes,            ///< data that grow old
  truncation,         ///< the model's own error
  dependent,          ///< errors that sensors of a datum have together
  shared,             ///< errors that steps share: reference pictures, offsets, scale, a series' own
  lasting,            ///< an error that a series has at all steps
  bias_like,          ///< what data cannot tell from a bias: unknown noise level or scale, lasting errors
  shared_clock,       ///< an error of each step beside `shared` ones of each dof
  clock,              ///< a measured quantity that tells the time
  known,              ///< a known parameter
  service,            ///< data that come one by one
  candidates,         ///< several models
  verified,           ///< the full-order model is asked
  count
};

using Features = std::bitset<static_cast<std::size_t>(Feature::count)>;

struct UpdateOptions;

/// Those of a noise model, or of a sequential update.
[[nodiscard]] Features features_of(const likelihood::NoiseModel& noise);
[[nodiscard]] Features features_of(const UpdateOptions& options);
/// Of a gate and a Student-t likelihood (`RobustOptions`); 0: without.
[[nodiscard]] Features features_of(double gate, double degrees_of_freedom);
/// `features` and `feature`, if it `is_there`.
inline void add(Features& features, Feature feature, bool is_there = true) {
  if (is_there) features.set(static_cast<std::size_t>(feature));
}

/// Two features that do not go together.
struct Conflict {
  std::string key;      ///< the key of the project file that is to blame; empty: known only with the data
  std::string message;  ///< what does not go together, why, and what to do
};

/// The first conflict in the table among `features`; an empty message if there is none.
[[nodiscard]] Conflict find_conflict(const Features& features);
/// Throws UsageError with its message if there is one.
void require_compatible(const Features& features);
/// The table as Markdown, as it stands in docs/explanation/assimilation.md.
[[nodiscard]] std::string compatibility_table();

}  // namespace knothe::assimilation
