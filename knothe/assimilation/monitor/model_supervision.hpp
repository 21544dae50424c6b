#pragma once
/// @file What watches over the model while data come in: its bias, its evidence, and whether to correct.
#include <Eigen/Core>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "knothe/assimilation/monitor/evidence_monitor.hpp"
#include "knothe/assimilation/update/milestones.hpp"
#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/likelihood/discrepancy/joint_discrepancy.hpp"
#include "knothe/likelihood/discrepancy/model_bias.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/likelihood/step/collapsed_posterior.hpp"
#include "knothe/likelihood/step/step_store.hpp"

namespace knothe::assimilation {

/// The state of the watch after some data, in order. All of it follows from the data and from which of them
/// were corrected by hand.
class ModelSupervision {
 public:
  struct DriftAlarm {
    int steps = 0;       ///< data since the drift began
    std::string notice;  ///< in words
    MonitorReport report;
  };

  ModelSupervision(std::shared_ptr<const model::ObservedModel> model, const likelihood::NoiseModel& noise,
                   std::shared_ptr<const posterior::PriorTransform> transform, const UpdateOptions& options);

  /// Whether the bias is estimated from residuals, without which nothing can be corrected.
  [[nodiscard]] bool learns() const { return learns_; }
  /// The bias is unknown together with the parameters (`JointDiscrepancy`).
  [[nodiscard]] bool is_joint() const { return learns_ && is_joint_; }

  /// No data; what is to be corrected by hand stays.
  void restart();
  /// Remembers the state before `step`; the last `k_remembered` of them are kept, and milestones of those
  /// before where no step is changed by later ones.
  void save(std::size_t step);
  /// Whether `restore` finds the state before `step`, before the first step after it that was saved, or
  /// before an earlier one.
  [[nodiscard]] bool remembers(std::size_t step) const;
  /// The state before `step`, or before the first step after it that is remembered, or, further back, of a
  /// milestone before it; that step. The posterior before it is that state's too.
  std::size_t restore(std::size_t step);

  /// Goes back to the state before `onset`, or, where the bias is unknown together with the parameters and
  /// may be there before it shows, at no harm, to the oldest remembered; from there on the model is
  /// corrected, at least until `step` is through. The step before which that is.
  std::size_t begin_correction(std::size_t onset, std::size_t step);
  /// Steps `from` to `to` are corrected, whenever they come.
  void correct_by_hand(std::size_t from, std::size_t to) { by_hand_.emplace_back(from, to); }
  /// Sets the forms of a datum as they will be assimilated, from the one without correction.
  void correct(std::size_t step, likelihood::StoredStep& stored, likelihood::DatumProjector& projector);
  /// Whether an alarm at `step` asks for the correction: where it is on already and had nothing to go by,
  /// doing it again would change nothing.
  [[nodiscard]] bool asks_for_correction(std::size_t step) const;

  /// Takes in how the datum of `step` was predicted, before it is assimilated and after `correct`. `central`:
  /// w₀. The alarm, if it has just gone off.
  [[nodiscard]] std::optional<DriftAlarm> check_prediction(std::size_t step,
                                                           const likelihood::StoredStep& stored,
                                                           const Eigen::VectorXd& central);
  /// Takes in the posterior with the datum in it, learns the datum's residual, and reports in `result`.
  /// `shares`: joint, how probable each size of the discrepancy is given the data so far, none first; else
  /// empty.
  void learn(const likelihood::StoredStep& stored, Eigen::VectorXd shares, UpdateResult& result);

  /// The posterior before the next datum is this one (a step came late or was taken out where nothing is
  /// learnt, or data have grown old).
  void set_posterior(const posterior::Posterior& posterior);
  /// … is the prior.
  void forget_posterior();
  /// … is not known: that datum is not judged.
  void lose_posterior() { is_known_ = false; }
  /// The structure changed: what the monitor has added up speaks of another one.
  void restart_sums();

  /// Joint: how probable each size is given the data so far.
  [[nodiscard]] const Eigen::VectorXd& shares() const { return state_.shares; }
  /// Joint: what is to be added to w at the last datum, under the posterior of parameters and sizes, r.
  /// `central`: w₀.
  [[nodiscard]] Eigen::VectorXd expected_discrepancy(const Eigen::VectorXd& central) const;
  /// w over the posterior before the next datum, where that is known.
  [[nodiscard]] const likelihood::PosteriorFunctions& functions() const { return current_; }
  /// The residuals learnt so far; null where none are.
  [[nodiscard]] const likelihood::ModelBias* bias() const { return state_.bias ? &*state_.bias : nullptr; }

  static constexpr std::size_t k_remembered = 256;

 private:
  [[nodiscard]] bool corrects(std::size_t step) const;
  [[nodiscard]] std::vector<likelihood::StepForm> condition(const likelihood::StoredStep& stored);
  void set_shares(Eigen::VectorXd shares);
  bool add_scores(const PredictiveCheck& check);
  void learn_residual(const likelihood::StoredStep& stored);
  struct State {
    std::optional<likelihood::ModelBias> bias;
    std::vector<likelihood::JointDiscrepancy> joint;
    Eigen::VectorXd shares;   ///< of no discrepancy, and of each size
    std::vector<Cusum> sums;  ///< of the misfit; of each parameter, up and down
    int drift = 0;            ///< steps of the largest sum
    bool corrected = false;
    std::optional<std::size_t> corrected_until;
    double without = 0;  ///< cumulative sum of the log Bayes factors for the model without correction
    std::deque<double> increments;
    MonitorReport report;
    std::string notice;
  };

  std::shared_ptr<const model::ObservedModel> model_;
  std::shared_ptr<const posterior::PriorTransform> transform_;
  likelihood::BiasCorrectionMode mode_;
  MonitorOptions options_;
  bool learns_, is_joint_;
  std::vector<double> sizes_;
  std::vector<std::pair<std::size_t, std::size_t>> by_hand_;  ///< ranges of steps to correct
  struct Saved {
    State state;
    posterior::FewPoints points;  ///< that current_ was made at; empty: the prior
    bool is_known = true;
  };
  likelihood::PosteriorFunctions prior_, current_;
  posterior::FewPoints points_;  ///< as of `Saved`
  bool is_known_ = true;         ///< current_ is the posterior before the next datum
  State initial_, state_;
  [[nodiscard]] bool is_far_back(std::size_t step) const;
  void set_state(const Saved& saved);
  std::map<std::size_t, Saved> saved_;
  std::optional<std::size_t> forgotten_;  ///< the last step that was saved and is so no longer
  bool has_milestones_;
  Milestones<Saved> milestones_;
};

}  // namespace knothe::assimilation
