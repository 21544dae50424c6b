#pragma once
/// @file Makes the verdict of a step from the posterior, the data and what is known of the model's own error.
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "knothe/assimilation/update/milestones.hpp"
#include "knothe/assimilation/update/robust_update.hpp"
#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/assimilation/verdict/assessed_data.hpp"
#include "knothe/assimilation/verdict/misfit_diagnosis.hpp"
#include "knothe/assimilation/verdict/model_shift.hpp"
#include "knothe/assimilation/verdict/residual_tests.hpp"
#include "knothe/assimilation/verdict/verdict.hpp"
#include "knothe/likelihood/step/posterior_functions.hpp"
#include "knothe/likelihood/step/step_store.hpp"
#include "knothe/model/reduced/truncation_error.hpp"

namespace knothe::assimilation {

struct VerdictOptions {
  double fit_caution = 3e-5, fit_reject = 1e-12;  ///< probabilities of a residual test
  /// Shift by the model's own error, in standard deviations: of errors carried to the posterior, and of fits
  /// to the known solutions, which see more.
  double carried_caution = 0.6, carried_reject = 2, fitted_caution = 1, fitted_reject = 3;
  /// How steeply a marginal falls from an edge of the box (`edge_pressure`): 0.65 for a normal
  /// density whose mean is a standard deviation beyond it, 0.69 for one that falls exponentially.
  double edge_caution = 0.672, edge_reject = 0.68;
  double outside_caution = 2e-4;  ///< probability of a truth inside the box (`probability_inside`)
  double rejected_values = 0.1;   ///< share of a datum's values
  std::size_t examined = 128;     ///< data whose residuals are looked at: the last
};

/// What a verdict is made from beside the data.
struct AssessedPosterior {
  const UpdateResult& update;
  const likelihood::PosteriorFunctions& functions;  ///< w over the posterior
  /// The forms of all data that the posterior is of, where it is made of forms and nothing in them is
  /// corrected or forgotten; null otherwise.
  const likelihood::FormSums* all_data = nullptr;
  /// The form of the last step's data given those before, as it was assimilated; null: not known.
  const likelihood::StepForm* latest = nullptr;
  bool corrected = false;  ///< some of the data were assimilated with the corrected model
  std::span<const Eigen::Index> stuck = {};
  std::span<const EstimatedError> lasting_errors = {};  ///< those of the noise, or none
};

/// The verdict of one posterior. Cost at 60 dofs: some 50 µs, and milliseconds where the data do not fit.
class Assessor {
 public:
  /// `priors`: truncated to the model's box. `errors` may be empty. `axes`: what 1.0 of a parameter means, or
  /// empty.
  Assessor(std::shared_ptr<const model::ObservedModel> model, likelihood::NoiseModel noise,
           const std::vector<posterior::Prior>& priors, model::Sensors sensors,
           likelihood::RobustOptions robust, model::ObservedErrors errors, const MonitorOptions& monitor,
           std::vector<model::Axis> axes = {}, VerdictOptions options = {});

  /// `data`: as many at hand as `VerdictOptions::examined`, or all.
  [[nodiscard]] Verdict assess(const AssessedPosterior& posterior, const AssessedData& data);
  /// Data of steps from this one on have changed.
  void forget_from(std::size_t step);

 private:
  void assess_computation(const UpdateResult& update, Verdict& verdict) const;
  void assess_fit(const AssessedPosterior& posterior, const AssessedData& data, Verdict& verdict);
  [[nodiscard]] Misfit misfit_of(const likelihood::StepForm& form, const AssessedPosterior& posterior) const;
  [[nodiscard]] ResidualReport examine(const AssessedPosterior& posterior,
                                       std::span<const likelihood::DatumPointer> data);
  void test_constancy(const AssessedPosterior& posterior, const AssessedData& data,
                      ResidualReport& report) const;
  void test_agreement(const AssessedPosterior& posterior, std::span<const likelihood::DatumPointer> examined,
                      ResidualReport& report) const;
  [[nodiscard]] std::vector<likelihood::DatumPointer> without_lasting_errors(
      const AssessedPosterior& posterior, std::span<const likelihood::DatumPointer> data) const;
  [[nodiscard]] std::string misfit_in_words(const ResidualReport& report,
                                            std::span<const likelihood::DatumPointer> data) const;
  void assess_range(const UpdateResult& update, Verdict& verdict) const;
  void assess_model(const AssessedPosterior& posterior, const AssessedData& data, Verdict& verdict);
  void sum_errors(const AssessedData& data);
  [[nodiscard]] Eigen::VectorXd mean_shift(const Eigen::MatrixXd& shifts, const UpdateResult& update) const;
  void add_model_reason(const Eigen::VectorXd& shift, double caution, double reject, Verdict& verdict) const;
  void assess_sensors(const AssessedPosterior& posterior, Verdict& verdict) const;
  [[nodiscard]] Eigen::VectorXd relevance_of_errors(const UpdateResult& update) const;
  [[nodiscard]] Eigen::MatrixXd projected_errors(const likelihood::Datum& datum) const;
  [[nodiscard]] const std::string& name_of_parameter(Eigen::Index a) const { return axes_[a].name; }

  std::shared_ptr<const model::ObservedModel> model_;
  posterior::PriorTransform priors_;
  std::vector<model::Axis> axes_;  ///< d
  Eigen::VectorXd central_;        ///< w₀ of forms
  likelihood::RobustOptions robust_;
  model::ObservedErrors errors_;
  MonitorOptions monitor_;
  VerdictOptions options_;
  ResidualTests tests_;
  std::optional<ModelShift> shift_;         ///< where it is known of which parameters the errors are
  std::vector<Eigen::MatrixXd> projected_;  ///< per model time: (U C_t)ᵀ R⁻¹ e(t), r × k, of complete data
  struct Sum {
    std::optional<std::size_t> last_step;
    Eigen::MatrixXd errors;  ///< r × k
  };
  Sum sum_;  ///< of the errors of the data up to a step
  Milestones<Sum> sums_before_;
};

}  // namespace knothe::assimilation
