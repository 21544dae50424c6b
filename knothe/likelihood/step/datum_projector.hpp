#pragma once
/// @file From a datum to its quadratic form (collapsed_posterior.hpp says which).
#include <Eigen/Core>
#include <map>
#include <memory>
#include <vector>

#include "knothe/likelihood/discrepancy/model_bias.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/likelihood/noise/nuisance_filter.hpp"
#include "knothe/likelihood/step/step_form.hpp"
#include "knothe/model/observe/observed_model.hpp"

namespace knothe::likelihood {

/// Turns data into step forms. Owns what depends on model and noise only: products of Eq. above that no datum
/// changes. With errors that steps share (`nuisance_filter.hpp`) the form is that of the datum given the data
/// projected before it.
class DatumProjector {
 public:
  /// `centre`: the point p at which w₀ = w(p) is taken, d values inside the model's box.
  DatumProjector(std::shared_ptr<const model::ObservedModel> model, NoiseModel noise,
                 const Eigen::VectorXd& centre);

  [[nodiscard]] const model::ObservedModel& model() const { return *model_; }
  [[nodiscard]] const NoiseModel& noise() const { return noise_; }
  [[nodiscard]] const Eigen::VectorXd& central_functions() const { return central_; }  ///< w₀, r
  [[nodiscard]] Eigen::Index observation_count() const { return predicted_.rows(); }
  /// What the data projected so far say of the noise's `lasting_errors`, each in its standard deviations,
  /// given v = w − w₀; without any, no states.
  [[nodiscard]] ConditionalStates lasting_errors() const {
    return lasting_count(noise_) == 0 ? ConditionalStates{} : nuisances_->lasting_errors();
  }
  /// Whether a form depends on the data before it: then data are projected again (`restart`) where one of
  /// them is taken out or comes late.
  [[nodiscard]] bool depends_on_order() const { return links_steps(noise_); }
  void restart();
  /// The noise of step `step` from now on (of as many dofs).
  void set_noise_of(std::size_t step, GaussianNoise noise);

  /// The form of the datum `values` (n_obs, NaN = missing) of step `step` and model time index `time_index`,
  /// into `form`. With all values present and noise that is independent from step to step nothing is
  /// allocated after the first call. A datum that is refused (DataError) leaves no trace. `moved`, where
  /// forms depend on the order: also the form in (v, u, z), for a datum that is off by u in the space modes
  /// and data before it that are by z in all (`JointDiscrepancy`).
  void project(std::size_t step, std::size_t time_index, const Eigen::Ref<const Eigen::VectorXd>& values,
               StepForm& form, MovedForm* moved = nullptr);
  /// The same with the corrected likelihood of Rubio et al. 2019, Eq. 18: the residual less the mean of the
  /// bias, and in place of R the covariance of the bias, S R S + F Fᵀ, which changes G_t too. Not where
  /// forms depend on the order (asserted).
  void project(std::size_t step, std::size_t time_index, const Eigen::Ref<const Eigen::VectorXd>& values,
               const BiasCorrection& correction, StepForm& form);

 private:
  const model::RowMatrix& space_rows();
  void find_measured(std::size_t step, const Eigen::Ref<const Eigen::VectorXd>& values);
  void project_complete(std::size_t time_index, StepForm& form);
  const NoiseGroup& group_of(std::size_t step);
  const Eigen::MatrixXd& complete_quadratic(std::size_t time_index);

  std::shared_ptr<const model::ObservedModel> model_;
  NoiseModel noise_;
  Eigen::VectorXd central_;
  Eigen::MatrixXd predicted_;  ///< lift_t + (OU) C_t w₀, n_obs × n_t
  NoiseGroup complete_;        ///< all values present
  NoiseGroup recent_;          ///< the last other set of values present: masks tend to stay
  std::map<std::size_t, Eigen::MatrixXd> quadratic_;  ///< G_t of complete data, of the model times used last
  std::unique_ptr<NuisanceFilter> nuisances_;         ///< null: there are none
  std::vector<Eigen::Index> kept_;                    // of the datum at hand
  Eigen::VectorXd residual_, weighted_, in_space_;    // workspace
  // Of the corrected likelihood; one row per dof, so that rows of R⁻¹ meet contiguous memory.
  model::RowMatrix space_rows_;           ///< (OU) of `space_kept_`
  std::vector<Eigen::Index> space_kept_;  ///< empty: of none yet
  model::RowMatrix columns_, weighted_columns_;
};

}  // namespace knothe::likelihood
