#pragma once
/// @file The data of a sequential update, each as a quadratic form: put in any order, taken out without a
/// trace, projected anew where one depends on those before it.
#include <Eigen/Core>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/update/datum_projector.hpp"
#include "knothe/assimilation/update/step_form.hpp"

namespace knothe::assimilation {

/// A datum: its form, and how it is assimilated.
struct StoredStep {
  StepForm form;
  std::optional<MovedForm> moved;  ///< where a discrepancy meets errors that steps share
  std::size_t time_index = 0;
  Eigen::VectorXd values;  ///< kept where the form depends on other data
  double time = 0;
  bool corrected = false;                  ///< assimilated with the corrected model
  std::optional<StepForm> corrected_form;  ///< in place of `form`, which is without correction
  std::vector<StepForm> levels;            ///< or one for each size of a discrepancy
  std::optional<double> log_evidence;      ///< of all data up to this one, for the increment of the next

  /// The form as it is assimilated; with sizes of a discrepancy, that of none.
  [[nodiscard]] const StepForm& assimilated() const { return corrected_form ? *corrected_form : form; }
};

/// The forms of steps, summed up in the order of the steps.
struct FormSums {
  StepForm form;
  std::vector<StepForm> levels;  ///< per size of a discrepancy; empty while there is none
  double forgotten = 0;          ///< log-evidence of what is no longer in the sums

  /// Of r functions, no steps.
  [[nodiscard]] static FormSums zero(Eigen::Index r) { return {StepForm::zero(r), {}, 0}; }
  void add(const StoredStep& step);
};

class StepStore {
 public:
  using Steps = std::map<std::size_t, StoredStep>;

  /// `centre`: the point at which w₀ is taken (`DatumProjector`).
  StepStore(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
            const Eigen::VectorXd& centre);

  /// Whether values are kept of steps added from now on (they are where forms depend on the order), and
  /// `MovedForm`s made, where they depend on it.
  void keep(bool values, bool moved_forms) { values_ = values, moved_forms_ = moved_forms; }
  [[nodiscard]] bool makes_moved_forms() const { return moved_forms_ && projector_.depends_on_order(); }

  /// Projects the datum `values` (n_obs; NaN = missing) of step `step`, measured at model time index
  /// `time_index`, and adds it. Errors: UsageError for a step that is there; those of
  /// `DatumProjector::project`, and then nothing has changed.
  void add(std::size_t step, std::size_t time_index, const Eigen::Ref<const Eigen::VectorXd>& values);
  /// Sets the form of a step, in place of what was there. `values`, `moved`: may be empty.
  void put(std::size_t step, std::size_t time_index, StepForm form, Eigen::VectorXd values,
           std::optional<MovedForm> moved);
  /// Errors: UsageError for a step that is not there.
  void remove(std::size_t step);

  [[nodiscard]] Steps& steps() { return steps_; }
  [[nodiscard]] const Steps& steps() const { return steps_; }
  [[nodiscard]] std::size_t last() const { return steps_.rbegin()->first; }
  /// The step that is there: UsageError otherwise.
  [[nodiscard]] Steps::iterator find(std::size_t step);
  /// `back` steps before this one, or the first.
  [[nodiscard]] Steps::iterator before(std::size_t step, int back);
  [[nodiscard]] DatumProjector& projector() { return projector_; }
  [[nodiscard]] const DatumProjector& projector() const { return projector_; }

 private:
  void project(std::size_t step, const Eigen::Ref<const Eigen::VectorXd>& values, StoredStep& stored);
  void project_again();
  void forget_evidence_from(std::size_t step);

  DatumProjector projector_;
  Steps steps_;
  bool values_ = false, moved_forms_ = false;
};

}  // namespace knothe::assimilation
