#pragma once
/// @file The data of a sequential update, each as a quadratic form: added in any order, withdrawn without a
/// trace, projected again where one depends on those before it.
#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/likelihood/data/data_set.hpp"
#include "knothe/likelihood/step/datum_projector.hpp"
#include "knothe/likelihood/step/step_form.hpp"

namespace knothe::likelihood {

/// A datum and what was made of it.
struct ProjectedForm {
  DatumPointer datum;
  StepForm form;  ///< G only where it is its own, beside others: `StoredStep`
};

/// The data of a step: their form, and how it is assimilated.
struct StoredStep {
  std::size_t time_index = 0;
  double time = 0;
  std::map<DatumKey, ProjectedForm> data;
  Eigen::MatrixXd
      complete_quadratic;  ///< G of complete data with the sensors' noise, where there were several data
  StepForm form;  ///< sum of the data's in the order of their keys; of one datum its G, kept here alone
  /// Of the step's one datum, where a discrepancy meets errors that steps share.
  std::optional<MovedForm> moved;
  ConditionalStates lasting_errors;  ///< given all data up to this step (`DatumProjector`)
  bool own_noise = false;            ///< the projector has another noise at this step than the sensors'

  bool corrected = false;                  ///< assimilated with the corrected model
  std::optional<StepForm> corrected_form;  ///< in place of `form`, which is without correction
  std::vector<StepForm> levels;            ///< or one for each size of a discrepancy
  std::optional<double> log_evidence;      ///< of all data up to this one, for the increment of the next

  /// The form as it is assimilated; with sizes of a discrepancy, that of none.
  [[nodiscard]] const StepForm& assimilated() const { return corrected_form ? *corrected_form : form; }
  /// The values of the step's one datum, which a correction goes by; null where there are several.
  [[nodiscard]] const Eigen::VectorXd* values() const;
};

/// The forms of steps, summed up in the order of the steps.
struct FormSums {
  StepForm form;
  std::vector<StepForm> levels;  ///< per size of a discrepancy; empty while there is none
  FormBlocks blocks;             ///< of the steps since the likelihood of those before was raised
  double forgotten = 0;          ///< log-evidence of what is no longer in the sums

  /// Of r functions, no steps.
  [[nodiscard]] static FormSums zero(Eigen::Index r) { return {StepForm::zero(r), {}, {}, 0}; }
  void add(const StoredStep& step);
  /// The likelihood of all steps so far to the power `power`.
  void raise(double power);
};

/// Steps that are seldom asked for may be let go: their forms are made again from their data, to the bit.
class StepStore {
 public:
  using Steps = std::map<std::size_t, StoredStep>;
  /// Gives the data of a step again, by key.
  using Recall = std::function<std::vector<DatumPointer>(std::size_t step)>;

  /// `centre`: the point at which w₀ is taken (`DatumProjector`).
  StepStore(std::shared_ptr<const model::ObservedModel> model, NoiseModel noise,
            const Eigen::VectorXd& centre);

  /// Whether `MovedForm`s are made of data added from now on, where forms depend on the order.
  void make_moved_forms(bool wanted) { moved_forms_ = wanted; }

  /// Adds a datum, in place of one with its key, at model time index `time_index` of this store's model.
  /// Errors: those of `DatumProjector::project`, and then nothing has changed.
  void add(DatumPointer datum, std::size_t time_index);
  /// Errors: UsageError for a datum that is not there.
  void withdraw(std::size_t step, const DatumKey& key);
  /// Makes the forms that have changed, once for many data: before this `steps` are not up to date. The first
  /// step that has changed since it was last called.
  std::optional<std::size_t> update_forms();

  /// Where data come from again: without it nothing is let go.
  void set_recall(Recall recall) { recall_ = std::move(recall); }
  [[nodiscard]] bool has_recall() const { return recall_ != nullptr; }
  /// Lets all steps go that are not in [`from`, `to`], but the last two, and those whose forms follow from
  /// more than their own data and the sensors' noise. Pointers to them are no longer valid.
  void keep_in_memory(std::size_t from, std::size_t to);

  /// Those in memory.
  [[nodiscard]] Steps& steps() { return steps_; }
  [[nodiscard]] const Steps& steps() const { return steps_; }
  [[nodiscard]] bool empty() const { return index_.empty(); }
  [[nodiscard]] std::size_t last() const { return index_.back().step; }
  /// The first step ≥ `step`, and the last one before it; absent where there is none.
  [[nodiscard]] std::optional<std::size_t> step_from(std::size_t step) const;
  [[nodiscard]] std::optional<std::size_t> step_before(std::size_t step) const;
  [[nodiscard]] bool contains(std::size_t step) const { return step_from(step) == step; }
  /// `back` steps before this one, or the first.
  [[nodiscard]] std::size_t before(std::size_t step, std::ptrdiff_t back) const;
  /// The step that is there: UsageError otherwise. It is in memory then.
  [[nodiscard]] StoredStep& at(std::size_t step);
  /// Its `log_evidence`, wherever it is.
  [[nodiscard]] std::optional<double> log_evidence(std::size_t step) const;
  /// Calls `visit` for the steps in [`from`, `end`), in order; those not in memory are made for it alone.
  void for_each(std::size_t from, std::size_t end,
                const std::function<void(std::size_t, const StoredStep&)>& visit);
  [[nodiscard]] DatumProjector& projector() { return projector_; }
  [[nodiscard]] const DatumProjector& projector() const { return projector_; }

 private:
  struct Projected {
    StepForm form;
    std::optional<MovedForm> moved;
  };
  [[nodiscard]] Projected project(StoredStep& step, const Datum& datum);
  [[nodiscard]] bool shares_quadratic(const ProjectedForm& projected) const;
  void separate_quadratic(StoredStep& step);
  void store(StoredStep& step, DatumPointer datum, Projected projected);
  void project_again();
  void set_noise(std::size_t index, StoredStep& step, const std::optional<GaussianNoise>& noise);
  void restore_noise(std::size_t index, StoredStep& step);
  void mark_changed(std::size_t step);
  /// What stays in memory of a step.
  struct Known {
    std::size_t step = 0, time_index = 0;
    double log_evidence = std::numeric_limits<double>::quiet_NaN();  ///< of one that was let go; NaN: none
  };
  using Index = std::vector<Known>;
  [[nodiscard]] Index::const_iterator first_from(std::size_t step) const;
  [[nodiscard]] StoredStep made_again(const Known& known);

  NoiseModel noise_;  ///< of the sensors
  DatumProjector projector_;
  Steps steps_;
  Index index_;  ///< all steps
  Recall recall_;
  std::optional<std::size_t> changed_;  ///< the first
  bool out_of_order_ = false;  ///< forms depend on data before them that were added later, or withdrawn
  bool moved_forms_ = false;
};

}  // namespace knothe::likelihood
