#pragma once
/// @file The sequential Bayesian update (Rubio et al. 2019, §2.1 and §2.2.3): data in, one by one; posterior
/// out, each time.
#include <Eigen/Core>
#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "knothe/assimilation/bias/model_supervision.hpp"
#include "knothe/assimilation/noise/noise_model.hpp"
#include "knothe/assimilation/update/collapsed_posterior.hpp"
#include "knothe/assimilation/update/datum_projector.hpp"
#include "knothe/assimilation/update/prior.hpp"
#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/reduction/observe/observed_model.hpp"
#include "knothe/transport/solve/map_solver.hpp"

namespace knothe::assimilation {

/// Levels at which posterior quantiles are given.
inline constexpr std::array<double, 5> k_quantile_levels = {0.025, 0.25, 0.5, 0.75, 0.975};

/// Wall-clock time of each phase of an update, µs.
struct UpdateTimes {
  double projection = 0;  ///< datum → quadratic form
  double map = 0;         ///< maximum, pre-map, adaptive map, verification
  double correction = 0;  ///< importance weights, moments, quantiles, evidence
  double watch = 0;       ///< monitor of the evidence, bias
  [[nodiscard]] double total() const { return projection + map + correction + watch; }
};

/// What an update did, and the posterior it found. Parameters p in the order of the priors. Moments,
/// quantiles and evidence are importance-corrected; where the map is not to be trusted and there are at most
/// two parameters they are by quadrature instead
/// (`remark` says so).
struct UpdateResult {
  std::size_t step = 0;
  double time = 0;  ///< model time

  Eigen::VectorXd mean;                  ///< d, importance-corrected
  Eigen::MatrixXd covariance;            ///< d × d, importance-corrected
  Eigen::MatrixXd quantiles;             ///< d × levels, importance-corrected
  Eigen::VectorXd maximum_a_posteriori;  ///< d, maximises the density in p
  Eigen::VectorXd map_mean;              ///< d, of the map alone
  Eigen::MatrixXd map_covariance;        ///< d × d, of the map alone

  double log_evidence = 0;              ///< log p(d₀ … d_i), all constants included
  double log_evidence_increment = 0;    ///< log p(d_i | d₀ … d_{i−1})
  double log_evidence_lower_bound = 0;  ///< of the map, Eq. 24: low by the Kullback-Leibler divergence

  int map_order = 0;               ///< 0 for the grid
  double variance_diagnostic = 0;  ///< Eq. 9, verified on points other than the training ones
  bool tolerance_reached = true;
  double effective_sample_size = 1;  ///< fraction
  bool second_mode_found = false;
  bool trusted = true;  ///< diagnostic ≤ 0.05, effective sample size ≥ 0.9, no second mode
  std::string remark;   ///< why the tolerance was not reached or the result is not trusted; else empty

  std::optional<double> noise_level;  ///< posterior mean of the factor of all variances, where it is inferred
  Eigen::Index used = 0, rejected = 0, missing = 0;  ///< values of this datum

  bool bias_corrected = false;  ///< this datum was assimilated with the corrected model
  MonitorReport monitor;        ///< how well the data before predicted this one
  /// What the monitor found or did at this step, in words: the alarm, correction switched on or off, steps
  /// that were taken out and put back. Mostly empty.
  std::string notice;
  UpdateTimes elapsed_us;
};

/// Weighted points of the posterior: what a forecast is made of.
struct WeightedPosterior {
  Eigen::MatrixXd points;   ///< n × d, p
  Eigen::VectorXd weights;  ///< n, sum 1
};

struct MapComposition;  // composed_density.hpp

/// Sequential assimilation. The posterior is a function of the set of data alone: each map depends only on
/// the collapsed form (and, for composed maps, on the data in the order of their steps), so a replay is
/// bit-identical, and a step that is taken out leaves no trace.
class SequentialUpdate {
 public:
  /// `priors`: one per parameter, in the order of the model's functions; each is truncated to the model's box
  /// here. Throws ProjectError for a prior with too little mass in the box.
  SequentialUpdate(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
                   std::vector<Prior> priors, UpdateOptions options = {});
  ~SequentialUpdate();

  /// Assimilates the datum `values` (n_obs; NaN = missing) as step `step`, measured at model time index
  /// `time_index`. A step that is there already is refused (UsageError): take it out first. A step earlier
  /// than the last is put in its place; the result is then that of the last step, as if all had come in
  /// order.
  const UpdateResult& update(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values);

  /// From now on step `step`, which is not assimilated yet, has this noise: a picture from which elements
  /// were taken out, known only when it is there.
  void set_step_noise(std::size_t step, NoiseModel noise) { projector_.set_noise_of(step, std::move(noise)); }

  /// Takes a step out: result and posterior are then bit-identical to never having assimilated it; with no
  /// step left they are empty. Throws UsageError for a step that is not there.
  const UpdateResult& remove(std::size_t step);

  /// The point p at which w₀ is taken (`DatumProjector`): the priors' medians. Forms for `put` are made
  /// there.
  [[nodiscard]] Eigen::VectorXd centre() const;

  /// The two halves of `update`, for who holds many data at once (a journal that is replayed, several data of
  /// one time). `put` sets the form of a step, in place of what was there; no posterior is made. `conclude`
  /// makes that of all steps up to `step`, as if nothing later had come; result() and posterior() are then
  /// those. UsageError for a step that is not there.
  /// `values` (may be empty) are what a correction learns from that does not go by the form alone.
  /// `moved` (`DatumProjector::project`): what a joint correction needs where steps share an error; a step
  /// without it is not corrected there.
  void put(std::size_t step, std::size_t time_index, StepForm form, Eigen::VectorXd values = {},
           std::optional<MovedForm> moved = {});
  /// Whether a correction wants the moved forms.
  [[nodiscard]] bool wants_moved_forms() const;
  const UpdateResult& conclude(std::size_t step);
  /// `conclude` may leave out the maps of earlier steps, and then the monitor does not judge this one.
  /// `follow` does not: what it says of `step` is to the bit what `update` says when all data up to it come
  /// in order. After a change it goes on from the first step changed, whose state before is remembered (the
  /// last 256 steps'; otherwise from the first step). `preview` is `conclude` in the middle of that: it
  /// leaves alone what is to be followed.
  const UpdateResult& follow(std::size_t step);
  const UpdateResult& preview(std::size_t step);

  /// Takes the steps `from` to `to` (both included) out and puts them back with the corrected model, and all
  /// later ones as they follow from that. Result and posterior are bit-identical to a run in which these
  /// steps were corrected when they came; steps that come later fall under it too. Throws UsageError where
  /// data are not kept (`UpdateOptions::learn_bias`), and for an empty range.
  const UpdateResult& redo(std::size_t from, std::size_t to);

  [[nodiscard]] const UpdateResult& result() const { return result_; }
  [[nodiscard]] const WeightedPosterior& posterior() const { return posterior_; }
  [[nodiscard]] std::vector<Prior> priors() const;       ///< truncated
  [[nodiscard]] std::vector<std::size_t> steps() const;  ///< assimilated, increasing
  /// The collapsed form of all data (without discrepancy).
  [[nodiscard]] const StepForm& collapsed() const { return sum_; }
  /// The target of the last map, in z; evaluates the whole posterior.
  [[nodiscard]] CollapsedLogDensity& target() { return target_; }
  [[nodiscard]] const PriorTransform& transform() const { return *transform_; }
  /// Where the bias is unknown together with the parameters, after the last step: what is to be added to w(p)
  /// there, so that U C_t of it is the bias as a field. Empty where it is not.
  [[nodiscard]] Eigen::VectorXd discrepancy() const {
    return supervision_.is_joint() && supervision_.learns()
               ? supervision_.expected_discrepancy(projector_.central_functions())
               : Eigen::VectorXd();
  }
  /// The residuals learnt so far; null where none are.
  [[nodiscard]] const ModelBias* bias() const { return supervision_.bias(); }
  /// Steps at which the structure was found, by alarms, to have changed.
  [[nodiscard]] const std::vector<std::size_t>& changes() const { return changes_; }
  /// Power to which the likelihood of all data before `step` is raised when `step` comes: the option's, or
  /// that of a change, known or found so far.
  [[nodiscard]] double power_before(std::size_t step) const;
  /// Which of the assimilated steps were corrected.
  [[nodiscard]] std::vector<std::size_t> corrected_steps() const;

 private:
  struct Datum {
    StepForm form;
    std::optional<MovedForm> moved;  ///< where a discrepancy meets errors that steps share
    std::size_t time_index = 0;
    Eigen::VectorXd values;  ///< kept where the form depends on other data
    double time = 0;
    bool corrected = false;                  ///< assimilated with the corrected model
    std::optional<StepForm> corrected_form;  ///< in place of `form`, which is without correction
    std::vector<StepForm> levels;            ///< or one for each size of a discrepancy
    std::optional<double> log_evidence;      ///< of all data up to this one, for the increment of the next
  };

  // changing_structure.cpp
  struct Aged {
    StepForm sum;
    double forgotten = 0;
    std::vector<std::size_t> changes;
  };
  [[nodiscard]] bool may_change() const;
  [[nodiscard]] bool changes_before(std::size_t step) const;
  void save_before(std::size_t step);
  void restore_sums(std::size_t step);
  void forget(std::size_t step);
  bool restart_at_change(std::size_t step);

  // supervised_update.cpp
  [[nodiscard]] std::optional<bool> by_hand(std::size_t step) const;
  void correct(std::size_t step, Datum& datum);
  void assimilate(std::size_t step);
  void assimilate_again(std::size_t from, std::size_t step);
  void go_back_before(std::size_t step);
  void clear_sums();
  void add_to_sums(const Datum& datum);
  void set_target();

  void project(std::size_t step, const Eigen::Ref<const Eigen::VectorXd>& values, Datum& datum);
  void project_again();
  void forget_from(std::size_t step);
  void rewind(std::size_t step);
  const UpdateResult& conclude(std::size_t step, bool every);
  void begin_anew();
  void restart_composition();
  void recompute(std::size_t step);
  void by_grid();
  void average_noise_level();
  void by_collapsed_map();
  void by_composed_maps(std::size_t step);
  void integrate();
  void take(const transport::MapResult& map);
  void set_map_moments(const Eigen::MatrixXd& p);
  void set_moments(const Eigen::MatrixXd& z, const Eigen::VectorXd& weights);
  void set_moments(const Eigen::VectorXd& weights);
  void set_quantiles(const Eigen::MatrixXd& z_quantiles);

  UpdateOptions options_;
  std::shared_ptr<const PriorTransform> transform_;
  DatumProjector projector_;
  CollapsedLogDensity target_;
  transport::MapSolver solver_;
  transport::MapResult map_;
  transport::ImportanceCorrection correction_;
  std::unique_ptr<MapComposition> composition_;  ///< for Form::composed
  std::map<std::size_t, Datum> data_;
  ModelSupervision supervision_;
  std::vector<std::pair<std::size_t, std::size_t>> by_hand_;  ///< ranges of steps to correct
  std::vector<StepForm> level_sums_;      ///< per size of a discrepancy; empty while there is none
  StepForm sum_;                          ///< of the steps up to `summed_`
  std::optional<std::size_t> summed_;     ///< the step that result_ and posterior_ are of
  bool followed_ = true;                  ///< the monitor has judged every step up to `summed_`
  bool previewed_ = false;                ///< result_ and posterior_ are of another step than `summed_`
  std::optional<std::size_t> redone_at_;  ///< the step that had those before it assimilated again
  double forgotten_ = 0;                  ///< log-evidence of what is no longer in the sums
  std::vector<std::size_t> changes_;      ///< steps at which an alarm was taken for a change, increasing
  std::map<std::size_t, Aged> aged_;      ///< the sums before the steps that the supervision remembers
  UpdateResult result_;
  WeightedPosterior posterior_;
  std::optional<Eigen::VectorXd> shares_;  ///< of a mixture's parts, where quadrature has given them
  Eigen::MatrixXd no_derivatives_, map_points_;
};

}  // namespace knothe::assimilation
