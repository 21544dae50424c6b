#pragma once
/// @file Data that grow old: a forgetting factor, and changes of the structure, known or found by the
/// monitor.
///
/// With S the sum of the forms so far and λ the power, the posterior before a datum becomes ∝ π₀ L_S^λ. The
/// evidence of a datum is that under this wider posterior, p(d_i | d before) = Z(λS + form)/Z(λS), so that
///   log p(d₀ … d_i) = log Z(sum) + forgotten,   forgotten += log Z(S) − log Z(λS).
#include <cstddef>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/likelihood/step/step_store.hpp"

namespace knothe::assimilation {

/// When the data before a step count less, and the sums from which such a step can be put back (they are no
/// longer those of the forms that are kept).
class StructureChanges {
 public:
  explicit StructureChanges(const UpdateOptions& options);

  /// Whether data may grow old at all.
  [[nodiscard]] bool possible() const;
  /// Whether the structure changed before this step, as far as known or found.
  [[nodiscard]] bool before(std::size_t step) const;
  /// Power to which the likelihood of all data before `step` is raised when `step` comes.
  [[nodiscard]] double power_before(std::size_t step) const;
  /// How many of the first of `steps` (increasing) count less than half at the last.
  [[nodiscard]] std::size_t count_forgotten(std::span<const std::size_t> steps) const;
  /// Steps at which the structure was found, by alarms, to have changed, increasing.
  [[nodiscard]] const std::vector<std::size_t>& found() const { return found_; }
  void set_found(std::vector<std::size_t> steps) { found_ = std::move(steps); }
  /// What is said where the alarm `alarm` was taken for a change at step `onset`; `more`: of the step itself.
  [[nodiscard]] std::string notice(const std::string& alarm, std::size_t onset,
                                   const std::string& more) const;

  /// No data.
  void restart();
  /// Remembers the sums before `step`, and those before as many earlier ones as `ModelSupervision` does.
  void save(std::size_t step, const likelihood::FormSums& sums);
  /// The sums before `step`, which are remembered; what was found later is so no longer.
  [[nodiscard]] likelihood::FormSums restore(std::size_t step);

 private:
  struct Saved {
    likelihood::FormSums sums;
    std::vector<std::size_t> found;
  };
  double forgetting_, retention_;
  bool on_alarm_;
  std::vector<std::size_t> known_, found_;
  std::map<std::size_t, Saved> saved_;
};

}  // namespace knothe::assimilation
