#pragma once
/// @file The engine of the program: data in, one by one and in any order; posterior, forecasts and warnings
/// out. `knothe assimilate`, `knothe serve`, `knothe replay` and the package for Python are thin over it.
#include <map>
#include <set>
#include <string>
#include <vector>

#include "knothe/assimilation/decide/decider.hpp"
#include "knothe/assimilation/engine/input_errors.hpp"
#include "knothe/assimilation/engine/method.hpp"
#include "knothe/assimilation/engine/step_result.hpp"
#include "knothe/assimilation/update/milestones.hpp"
#include "knothe/assimilation/verdict/assessor.hpp"
#include "knothe/likelihood/data/sensor_watch.hpp"

namespace knothe::assimilation {

struct CandidateModel;

/// What an engine is made of: the problem, and what is asked besides. `engine_setup` (project_engine.hpp)
/// makes it from a project file.
struct EngineSetup : Problem {
  std::optional<Forecaster> forecaster;
  std::optional<Decider> decider;
  ForecastScores scores;                   ///< forecasts to be scored when they come true
  bool watches_sensors = false;            ///< tells sensors that are stuck or silent
  model::Sensors sensors;                  ///< places and names for the verdict; may be empty
  model::ObservedErrors known_errors;      ///< of the model, at the sensors; may be empty
  std::vector<model::Axis> axes;           ///< what 1.0 of a parameter means; may be empty
  std::string name;                        ///< of the model, where several are compared
  std::size_t model_version = 0;           ///< how often it has been refined
  std::vector<CandidateModel> candidates;  ///< models to compare with it on the same data
  std::string archive = {};                ///< folder for a file of old data; empty: all stay in memory
  std::size_t kept_in_memory = 512;        ///< steps before and after the one at hand, if there is an archive
};

/// The same data seen by another model: `time_indices` are its own, by those of the first; beyond its times
/// where it has no such time.
struct CandidateModel {
  std::string name;
  Problem problem;
  std::vector<std::size_t> time_indices;
};

/// The result of a step is a function of the set of data up to it: whatever their order of arrival, whatever
/// was computed before, to the bit.
class Engine {
 public:
  /// ProjectError for a prior with too little mass in the model's box, UsageError for options that do not go
  /// together.
  explicit Engine(EngineSetup setup);

  /// An engine of another setup, for instance with a refined model, that has this one's data and
  /// options of the update.
  [[nodiscard]] Engine with_setup(EngineSetup setup) const;

  /// Adds a datum and gives the posterior of all data up to its step. The same as `add` and `posterior_at`.
  StepResult assimilate(const likelihood::Datum& datum);

  /// Adds a datum; no posterior is made. One whose key is there at this step already is ignored. DataError
  /// for values that are infinite or whose misfit overflows, UsageError for a datum of the wrong size or
  /// time: nothing has changed then.
  void add(const likelihood::Datum& datum);
  void add(const likelihood::DatumPointer& datum);
  /// Takes a datum out: from then on everything is, to the bit, as if it had never come. False where it is
  /// not there.
  bool withdraw(std::size_t step, const likelihood::DatumKey& key);

  /// Steps whose result has changed since it was last concluded, increasing.
  [[nodiscard]] const std::set<std::size_t>& stale() const { return stale_; }
  /// The result of a step with data: posterior of all data of steps ≤ `step`, and what its monitor says. Goes
  /// on from the first step that has changed. `step` is not stale afterwards, even if this throws
  /// (NumericalError): the same would come again.
  StepResult posterior_at(std::size_t step);
  /// The posterior alone, at once, whatever is stale before it. `step` stays stale.
  StepResult preview(std::size_t step);

  /// What these errors would do to the posterior of all data, which has the mean `mean`.
  [[nodiscard]] std::vector<InputShift> shifts_by(std::span<const InputError> errors,
                                                  const Eigen::VectorXd& mean) const {
    return assimilation::shifts_by(errors, setup_, data_->all(), mean);
  }

  /// Beside a result's forecasts of crack lengths: those of Eq. 33 with the predicted field as a normal one.
  [[nodiscard]] std::vector<NamedForecast> published_forecasts(const StepResult& result);

  [[nodiscard]] const likelihood::DataSet& data() const { return *data_; }
  [[nodiscard]] std::optional<std::size_t> last_step() const { return data_->last_step(); }
  /// The last datum of a step (by key) with the noise it was measured with; UsageError without data.
  [[nodiscard]] likelihood::Datum last_datum(std::size_t step) const;
  /// The quadratic form of all data of steps ≤ `step`, of functions centred at `centre`; none for methods
  /// without.
  [[nodiscard]] std::optional<likelihood::StepForm> form_up_to(std::size_t step);

  [[nodiscard]] const model::ObservedModel& model() const { return *setup_.model; }
  [[nodiscard]] const std::vector<posterior::Prior>& priors() const {
    return priors_;
  }                                                                        ///< truncated to the box
  [[nodiscard]] const Eigen::VectorXd& centre() const { return centre_; }  ///< medians of the priors

 private:
  void require_fits(const likelihood::Datum& datum) const;
  void mark_changed(std::size_t step);
  void release_memory();
  [[nodiscard]] StepResult result_of(const UpdateResult& update);
  void watch_sensors(std::size_t step, StepResult& result);
  void compare_models(std::size_t step, StepResult& result);
  [[nodiscard]] std::span<const likelihood::DatumPointer> recent_data(std::size_t step);
  void assess(std::size_t step, StepResult& result);
  void decide(StepResult& result);

  EngineSetup setup_;
  std::vector<posterior::Prior> priors_;
  Eigen::VectorXd centre_;
  std::unique_ptr<PosteriorMethod> method_;
  std::vector<std::unique_ptr<PosteriorMethod>> candidates_;
  std::size_t release_from_ = 0;  ///< steps in memory, from which on old data are put away
  std::shared_ptr<likelihood::DataSet> data_ = std::make_shared<likelihood::DataSet>();
  std::set<std::size_t> stale_;
  likelihood::SensorWatch watch_;
  Milestones<likelihood::SensorWatch> watch_before_;
  Assessor assessor_;
  std::vector<likelihood::DatumPointer> examined_;  ///< of `recent_data`, kept from step to step
  std::optional<std::size_t> watched_;              ///< last step that `watch_` has seen
};

}  // namespace knothe::assimilation
