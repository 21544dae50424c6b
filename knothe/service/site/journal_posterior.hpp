#pragma once
/// @file The posterior as a function of the journal's entries: whatever their order of arrival, whatever was
/// computed before, to the bit.
///
/// A datum is a quadratic form (docs/assimilation.md). The form of a step is the sum of its data's in the
/// order of their keys; the posterior after a step is that of the sum of the steps' up to it, in order.
#include <Eigen/Core>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/forecast/forecaster.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/service/journal/datum.hpp"

namespace knothe::service {

class JournalPosterior {
 public:
  /// ProjectError and DataError as `knothe assimilate` has them.
  JournalPosterior(const project::Project& project, const project::UpdateSetup& setup);

  /// Adds a datum. No posterior is made. `datum.step` is a step of the model, the number of values that of
  /// the sensors; a datum that is there already is ignored. DataError for a misfit that overflows: nothing
  /// has changed then.
  void add(const Datum& datum);

  /// Steps whose posterior has changed since it was last concluded, increasing.
  [[nodiscard]] const std::set<std::size_t>& stale() const { return stale_; }
  [[nodiscard]] std::optional<std::size_t> last_step() const;
  [[nodiscard]] std::size_t data_of(std::size_t step) const;

  struct Conclusion {
    const assimilation::UpdateResult& result;
    const assimilation::Posterior& posterior;
    std::vector<forecast::NamedForecast> forecasts;
    double forecast_us = 0;
    bool followed = true;  ///< the monitor of the evidence has judged every step before; else it says nothing
  };
  /// The posterior of all data of steps ≤ `step`, one of `last_step` or before with data, and what the
  /// monitor says of it: all as `knothe assimilate` has it. Goes on from the first step that has changed
  /// (`SequentialUpdate::follow`). `step` is not stale afterwards, even if this throws (NumericalError): the
  /// same would come again.
  [[nodiscard]] Conclusion conclude(std::size_t step);
  /// The posterior alone, at once, whatever is stale before it. `step` stays stale.
  [[nodiscard]] Conclusion preview(std::size_t step);

  /// The sum of the forms of all steps ≤ `step`.
  [[nodiscard]] assimilation::StepForm form_up_to(std::size_t step) const;
  /// The values of the last datum of a step (by key): NaN where missing. Empty without data.
  [[nodiscard]] std::span<const double> last_values(std::size_t step) const;

  /// When the last datum of a step to arrive did, Unix time.
  [[nodiscard]] std::int64_t received_ms(std::size_t step) const;

  [[nodiscard]] const assimilation::SequentialUpdate& update() const { return update_; }

 private:
  /// What is kept of a datum; G only where values were missing: all others of the step share theirs.
  struct Contribution {
    Eigen::VectorXd linear;
    double constant = 0, log_normaliser = 0;
    Eigen::Index used = 0, missing = 0;
    std::unique_ptr<Eigen::MatrixXd> quadratic;
    Eigen::VectorXd values;  ///< kept where forms depend on the data before (errors that steps share)
  };
  struct Step {
    std::map<DatumKey, Contribution> data;
    Eigen::MatrixXd complete_quadratic;  ///< G of a datum without missing values; empty if there was none
    assimilation::StepForm sum;
    /// Of the step's one datum, until it is put, where a correction wants it (steps that share an error).
    std::optional<assimilation::MovedForm> moved;
    std::vector<double> last_values;
    std::int64_t received_ms = 0;
  };
  void keep(Step& step, const DatumKey& key, const assimilation::StepForm& form, Eigen::VectorXd values);
  [[nodiscard]] assimilation::StepForm project(std::size_t index, const Eigen::VectorXd& values,
                                               std::optional<assimilation::MovedForm>& moved);
  void project_again();
  void put_changes();
  [[nodiscard]] Conclusion with_forecasts(const assimilation::UpdateResult& result, bool followed);

  assimilation::SequentialUpdate update_;
  assimilation::DatumProjector projector_;
  forecast::Forecaster forecaster_;
  bool keeps_values_;
  std::map<std::size_t, Step> steps_;
  std::set<std::size_t> unput_, stale_;
  bool out_of_order_ = false;  ///< data have come that others' forms depend on
};

}  // namespace knothe::service
