#pragma once
/// @file What watches over the model while data come in: its bias, its evidence, and whether to correct.
#include <Eigen/Core>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "knothe/assimilation/bias/evidence_monitor.hpp"
#include "knothe/assimilation/bias/joint_discrepancy.hpp"
#include "knothe/assimilation/bias/model_bias.hpp"
#include "knothe/assimilation/noise/noise_model.hpp"
#include "knothe/assimilation/update/collapsed_posterior.hpp"

namespace knothe::assimilation {

/// The state of the watch after some data, in order. All of it follows from the data and from which of them
/// were corrected by hand.
class ModelSupervision {
 public:
  /// `learns`: residuals are learnt from, without which nothing can be corrected.
  ModelSupervision(std::shared_ptr<const reduction::ObservedModel> model, const NoiseModel& noise,
                   std::shared_ptr<const PriorTransform> transform, BiasCorrectionMode mode, bool learns,
                   const BiasOptions& bias, const MonitorOptions& monitor);

  [[nodiscard]] BiasCorrectionMode mode() const { return mode_; }
  [[nodiscard]] bool learns() const { return learns_; }

  /// No data.
  void restart();
  /// Remembers the state before `step`; the last `k_remembered` of them are kept.
  void save(std::size_t step);
  [[nodiscard]] std::size_t oldest_saved() const { return saved_.begin()->first; }
  /// Whether `restore` finds the state before `step`, or before the first step after it that was saved.
  [[nodiscard]] bool remembers(std::size_t step) const;
  /// The state before `step`, or before the first step after it that is remembered; that step. The posterior
  /// before it is that state's too.
  std::size_t restore(std::size_t step);
  /// From now on the model is corrected, at least until `step` is through.
  void correct_until(std::size_t step);

  /// Whether the next datum is to be corrected: by hand (`by_hand`), or by the mode.
  [[nodiscard]] bool corrects(std::optional<bool> by_hand) const;
  /// The bias is unknown together with the parameters (`JointDiscrepancy`).
  [[nodiscard]] bool is_joint() const { return is_joint_; }
  /// Joint: the forms of a datum, corrected with each size of the discrepancy; takes it in.
  /// `moved`: where steps share an error; else null.
  [[nodiscard]] std::vector<StepForm> condition(const StepForm& form, const MovedForm* moved,
                                                std::size_t time_index);
  /// Joint: how probable each size is given the data so far, none first.
  void set_shares(Eigen::VectorXd shares);
  [[nodiscard]] const Eigen::VectorXd& shares() const { return state_.shares; }
  /// The most probable of them.
  [[nodiscard]] Eigen::Index likeliest() const;
  /// Joint: what is to be added to w at the last datum, under the posterior of parameters and sizes, r.
  /// `central`: w₀.
  [[nodiscard]] Eigen::VectorXd expected_discrepancy(const Eigen::VectorXd& central) const;
  /// Otherwise: the correction of the datum at `time`; none while nothing was learnt.
  [[nodiscard]] std::optional<BiasCorrection> extrapolate(double time) const;

  /// Takes in how the datum of `step` was predicted, before it is assimilated. `used`: its form as it will be
  /// assimilated; `uncorrected`: its form without correction, if `used` is corrected, else null. Whether the
  /// alarm has just gone off.
  bool judge(std::size_t step, const StepForm& used, const StepForm* uncorrected,
             const Eigen::VectorXd& central);
  /// Data since the drift began.
  [[nodiscard]] int steps_of_drift() const { return state_.drift; }
  /// Takes in the posterior with the datum in it (weighted points), and learns the residual of `values`.
  void learn(double time, std::size_t time_index, const Eigen::VectorXd& values, double increment,
             const Eigen::MatrixXd& points, const Eigen::VectorXd& weights);
  /// The posterior is another one now (a step came late or was taken out where nothing is learnt).
  void set_posterior(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights);
  void forget_posterior();
  /// The posterior before the next datum is not known: that datum is not judged.
  void lose_posterior() { is_known_ = false; }
  /// The structure changed: what the monitor has added up speaks of another one.
  void restart_sums();

  [[nodiscard]] const MonitorReport& report() const { return state_.report; }
  /// What happened at the last step, in words; else empty.
  [[nodiscard]] const std::string& notice() const { return state_.notice; }
  [[nodiscard]] const ModelBias* bias() const { return state_.bias ? &*state_.bias : nullptr; }

  static constexpr std::size_t k_remembered = 256;

 private:
  bool take_scores(const PredictiveCheck& check);
  struct State {
    std::optional<ModelBias> bias;
    std::vector<JointDiscrepancy> joint;
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

  std::shared_ptr<const reduction::ObservedModel> model_;
  std::shared_ptr<const PriorTransform> transform_;
  BiasCorrectionMode mode_;
  MonitorOptions options_;
  bool learns_, is_joint_;
  std::vector<double> sizes_;
  struct Saved {
    State state;
    Eigen::MatrixXd points;  ///< that current_ was made at; empty: the prior
    bool is_known = true;
  };
  PosteriorFunctions prior_, current_;
  Eigen::MatrixXd points_;  ///< as of `Saved`
  bool is_known_ = true;    ///< current_ is the posterior before the next datum
  State initial_, state_;
  std::map<std::size_t, Saved> saved_;
  std::optional<std::size_t> forgotten_;  ///< the last step that was saved and is so no longer
};

}  // namespace knothe::assimilation
