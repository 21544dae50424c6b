#pragma once
/// @file Sequential assimilation of values with Student-t noise: the exact posterior, by a quadratic form
/// near it and importance weights, or by quadrature.
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/monitor/model_supervision.hpp"
#include "knothe/assimilation/update/posterior_solver.hpp"
#include "knothe/assimilation/update/structure_changes.hpp"
#include "knothe/likelihood/step/student_likelihood.hpp"

namespace knothe::assimilation {

/// A t-likelihood is no quadratic form of w, and a value that looked like an outlier need not look so after
/// the next datum. So all values are kept, and after each datum the likelihood of all of them is
///  1. replaced by the quadratic form of `StudentLikelihood::linearise`, about the posterior before, then
///     about the one that this gives, until it stays;
///  2. put back: the points of the posterior that the form has are weighted by what it leaves out, exp(ℓ −
///     form). Moments, quantiles and evidence are those of the exact t posterior; the effective sample size
///     says how far the form was off. Where that is much, quadrature of the exact density takes over with few
///     parameters, and weighted draws from it with more.
/// A posterior is a function of the data up to it. The cost of a step grows with the number of values. Data
/// that grow old count to a power (`StructureChanges`); a change that is found begins again from the first.
class StudentUpdate {
 public:
  /// `degrees`: ν. Errors: UsageError for options or noise that do not go with it. One map of all data is
  /// made, also where the options ask for composed ones.
  StudentUpdate(std::shared_ptr<const model::ObservedModel> model, const likelihood::NoiseModel& noise,
                std::vector<posterior::Prior> priors, UpdateOptions options, double degrees);

  /// Assimilates a datum, of the last step or a later one; `scale`: σ of its values, n, > 0. Increments and
  /// counts of the result are those of its step.
  const UpdateResult& update(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values,
                             const Eigen::Ref<const Eigen::VectorXd>& scale);
  [[nodiscard]] const UpdateResult& result() const { return result_; }
  /// Changes of the structure, known or found so far.
  [[nodiscard]] const StructureChanges& changes() const { return changes_; }
  [[nodiscard]] const std::vector<posterior::Prior>& priors() const;  ///< truncated
  /// The last datum as one of Gaussian noise of the precisions found.
  [[nodiscard]] const likelihood::StepForm& latest_form() const { return latest_.form; }
  /// Expected precision factors of the last datum's values, n; NaN where missing.
  [[nodiscard]] const Eigen::VectorXd& precision_factors() const { return precision_factors_; }

 private:
  struct Entry {
    std::size_t step, time_index;
    Eigen::VectorXd values, scale;
  };
  void restart();
  std::optional<ModelSupervision::DriftAlarm> assimilate(const Entry& entry);
  void forget(std::size_t step);
  void compute();
  [[nodiscard]] bool find_change(std::size_t last, const ModelSupervision::DriftAlarm& alarm);
  [[nodiscard]] likelihood::StepForm linearised(const likelihood::PosteriorFunctions& about) const;
  [[nodiscard]] Eigen::VectorXd left_out(const Eigen::MatrixXd& deviation) const;
  void solve(likelihood::StepForm form);
  void approach();
  void correct();
  double weigh(const Eigen::VectorXd& left_out);
  void replace(bool by_quadrature, double share);
  void set_most_probable();
  [[nodiscard]] std::optional<ModelSupervision::DriftAlarm> watch(std::size_t step);

  std::shared_ptr<const model::ObservedModel> model_;
  std::shared_ptr<const posterior::PriorTransform> transform_;
  Eigen::VectorXd central_;  ///< w₀
  likelihood::StudentLikelihood likelihood_;
  posterior::Method kind_;
  PosteriorSolver solver_;
  ModelSupervision supervision_;
  likelihood::PosteriorFunctions functions_;  ///< of the posterior before the datum, or of the last solve
  likelihood::StepForm form_;                 ///< of the last solve, in v
  Eigen::VectorXd left_out_;                  ///< ℓ − form at the points of `functions_`
  StructureChanges changes_;
  std::vector<Entry> entries_;  ///< all data, where a change may be found
  bool restarts_on_alarm_;
  double forgotten_ = 0;  ///< log-evidence of what counts no longer
  double before_ = 0;     ///< log-evidence of the steps before the last
  bool first_ = true;
  likelihood::StoredStep latest_;
  UpdateResult result_;
  Eigen::VectorXd precision_factors_;
};

}  // namespace knothe::assimilation
