#pragma once
/// @file The sequential Bayesian update (Rubio et al. 2019, §2.1 and §2.2.3): data in, one by one; posterior
/// out, each time.
#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/monitor/model_supervision.hpp"
#include "knothe/assimilation/update/posterior_solver.hpp"
#include "knothe/assimilation/update/structure_changes.hpp"
#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/likelihood/data/datum.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/likelihood/step/step_store.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::assimilation {

/// Sequential assimilation. The posterior is a function of the set of data alone: each map depends only on
/// the collapsed form (and, for composed maps, on the data in the order of their steps), so a replay is
/// bit-identical, and a step that is taken out leaves no trace.
///
/// The data are in a `StepStore`, a `PosteriorSolver` finds the posterior of their sum, a `ModelSupervision`
/// watches whether the model explains them and corrects it, `StructureChanges` lets them grow old; this class
/// takes the steps through these in order, and back where one comes late or is taken out.
class SequentialUpdate {
 public:
  /// `priors`: one per parameter, in the order of the model's functions; each is truncated to the model's box
  /// here. Throws ProjectError for a prior with too little mass in the box.
  SequentialUpdate(std::shared_ptr<const model::ObservedModel> model, likelihood::NoiseModel noise,
                   std::vector<posterior::Prior> priors, UpdateOptions options = {});

  /// Adds the datum `values` (n_obs; NaN = missing), the only one of step `step`, measured at model time
  /// index `time_index`, and gives the posterior of all data: that of the last step, as if all had come in
  /// order. A step that is there already is refused (UsageError).
  const UpdateResult& update(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values);
  /// Withdraws the only datum of a step: result and posterior are then bit-identical to never having
  /// assimilated it; with no step left they are empty. UsageError for a step that is not there.
  const UpdateResult& remove(std::size_t step);

  /// From now on steps that are more than `kept` from the last one assimilated need not be in memory, where
  /// they are no more than their data: `recall` gives these again.
  void set_recall(likelihood::StepStore::Recall recall, std::size_t kept) {
    store_.set_recall(std::move(recall));
    kept_ = kept;
  }
  /// The halves of `update`, for batches of data (a journal that is replayed, several data of one
  /// step). `add` makes no posterior; a datum takes the place of one with its key. Errors: DataError for one
  /// that cannot be assimilated, and then nothing has changed. `time_index`: of this update's model.
  void add(likelihood::DatumPointer datum, std::size_t time_index);
  /// UsageError for a datum that is not there.
  void withdraw(std::size_t step, const likelihood::DatumKey& key);
  /// The posterior of all data up to `step`, as if nothing later had come: to the bit what `update` gives
  /// when all came in order, and result() is then that. After a change it goes on from the first step
  /// changed, or a little before it where that is further back than 256 steps; where posteriors follow from
  /// earlier ones, it may begin again from the first.
  /// UsageError for a step that is not there.
  const UpdateResult& posterior_at(std::size_t step);
  /// The same without the posteriors of earlier steps, where none depends on them: the monitor then does not
  /// judge this step.
  const UpdateResult& posterior_without_monitor(std::size_t step);
  /// `posterior_without_monitor` in the middle of steps that are followed one by one: leaves these alone.
  const UpdateResult& preview(std::size_t step);

  /// Takes the steps `from` to `to` (both included) out and puts them back with the corrected model, and all
  /// later ones as they follow from that. The result is bit-identical to a run in which these
  /// steps were corrected when they came; steps that come later fall under it too. Throws UsageError where
  /// data are not kept (`UpdateOptions::learn_bias`), and for an empty range.
  const UpdateResult& correct_bias(std::size_t from, std::size_t to);

  /// The form of a step's data given those before, as it is assimilated; null for a step that is not there.
  [[nodiscard]] const likelihood::StepForm* form_of(std::size_t step) const;
  /// The quadratic form of all data of steps ≤ `step`, of functions centred at the priors'
  /// medians.
  [[nodiscard]] likelihood::StepForm form_up_to(std::size_t step);

  [[nodiscard]] const UpdateResult& result() const { return result_; }
  [[nodiscard]] const posterior::PriorTransform& transform() const {
    return *transform_;
  }  ///< of the truncated priors
  /// The target of the last map, in z; evaluates the whole posterior.
  [[nodiscard]] likelihood::CollapsedLogDensity& target() { return solver_.target(); }
  /// The correction of the model's bias after the last step: where it is unknown together with the parameters
  /// as what is to be added to w(p), so that U C_t of it is the bias as a field; else, where residuals are
  /// learnt, at the sensors (m).
  [[nodiscard]] EstimatedBias bias() const;
  /// The errors that all data have together, in their standard deviations, by what the data up to the step of
  /// `result` say (before the first datum: their prior); v is w itself here.
  [[nodiscard]] likelihood::ConditionalStates lasting_errors() const;
  /// Changes of the structure, known or found so far.
  [[nodiscard]] const StructureChanges& changes() const { return changes_; }
  /// After `posterior_at`: w over that posterior, and the forms of all its data (as they were assimilated:
  /// with a correction, or grown old, their sum is another than `form_up_to`).
  [[nodiscard]] const likelihood::PosteriorFunctions& functions() const { return supervision_.functions(); }
  [[nodiscard]] const likelihood::FormSums& sums() const { return sums_; }
  /// Which of the steps up to that of `result` were assimilated with the corrected model.
  [[nodiscard]] std::vector<std::size_t> corrected_steps() const;

 private:
  void apply_changes();
  void release_memory();
  void sum_ahead();
  [[nodiscard]] std::size_t first_to_solve(std::size_t step) const;
  const UpdateResult& compute(std::size_t step, bool every);
  void assimilate(std::size_t step);
  void assimilate_from(std::size_t from, std::size_t to);
  void solve(std::size_t step);
  void forget(std::size_t step);
  void note(const ModelSupervision::DriftAlarm& alarm);
  void correct_since_drift(std::size_t step, const ModelSupervision::DriftAlarm& alarm);
  bool restart_at_change(std::size_t step, const ModelSupervision::DriftAlarm& alarm);
  [[nodiscard]] bool posteriors_depend_on_earlier() const;
  void rewind(std::size_t step);
  void go_back_before(std::size_t step);
  void restore_sums(std::size_t step);
  void restart_sums();
  void restart();

  std::shared_ptr<const posterior::PriorTransform> transform_;
  likelihood::StepStore store_;
  PosteriorSolver solver_;
  ModelSupervision supervision_;
  StructureChanges changes_;
  bool restart_on_alarm_;

  likelihood::FormSums sums_;  ///< of the steps up to `summed_`
  Milestones<likelihood::FormSums> sums_before_;
  std::optional<std::size_t> summed_;  ///< the step that result_ is of
  bool followed_ = true;               ///< the monitor has judged every step up to `summed_`
  bool previewed_ = false;             ///< result_ is of another step than `summed_`
  /// The sums of the steps before one, which a preview goes on from.
  struct Shown {
    std::size_t before = 0;
    likelihood::FormSums sums;
  };
  std::optional<Shown> shown_;
  std::size_t kept_ = 512;
  std::size_t release_from_ = 0;          ///< steps in memory, from which on old ones are let go
  std::optional<std::size_t> redone_at_;  ///< the step that had those before it assimilated again
  UpdateResult result_;
};

}  // namespace knothe::assimilation
