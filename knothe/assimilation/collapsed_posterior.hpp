#pragma once
/// @file All data in one quadratic form: the collapsed posterior.
///
/// With y_t(p) = lift_t + (OU) C_t w(p) and Gaussian noise of known covariance R_t, the misfit of a datum is
/// a quadratic form in w, and w does not depend on time. With v = w(p) − w₀ (w₀ at a central point, so that
/// few digits cancel)
///   −2 log π(d_t | p) = vᵀ G_t v − 2 g_tᵀ v + c_t + n_t log 2π + log det R_t,
///   G_t = C_tᵀ (OU)ᵀ R_t⁻¹ (OU) C_t,   g_t = C_tᵀ (OU)ᵀ R_t⁻¹ r_t,   c_t = r_tᵀ R_t⁻¹ r_t,
/// r_t = d_t − lift_t − (OU) C_t w₀. Sums over t are the whole likelihood of Rubio et al. 2019, Eq. 13, at
/// the cost of one datum.
#include <Eigen/Core>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "knothe/assimilation/model_bias.hpp"
#include "knothe/assimilation/noise_level.hpp"
#include "knothe/assimilation/noise_model.hpp"
#include "knothe/assimilation/prior_transform.hpp"
#include "knothe/assimilation/quadratic_factor.hpp"
#include "knothe/assimilation/shared_error.hpp"
#include "knothe/assimilation/step_form.hpp"
#include "knothe/reduction/observed_model.hpp"
#include "knothe/sampling/log_density.hpp"

namespace knothe::assimilation {

/// Turns data into step forms. Owns what depends on model and noise only: products of Eq. above that no datum
/// changes. With errors that steps share (`shared_error.hpp`) the form is that of the datum given the data
/// projected before it.
class DatumProjector {
 public:
  /// `centre`: the point p at which w₀ = w(p) is taken, d values inside the model's box.
  DatumProjector(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
                 const Eigen::VectorXd& centre);

  [[nodiscard]] const reduction::ObservedModel& model() const { return *model_; }
  [[nodiscard]] const NoiseModel& noise() const { return noise_; }
  [[nodiscard]] const Eigen::VectorXd& central_functions() const { return central_; }  ///< w₀, r
  [[nodiscard]] Eigen::Index observation_count() const { return predicted_.rows(); }
  /// Whether a form depends on the data before it: then data are projected anew (`restart`) where one of them
  /// is taken out or comes late.
  [[nodiscard]] bool depends_on_order() const { return shared_ || constant_ || noise_.scale_std() > 0; }
  void restart();
  /// The noise of step `step` from now on (of as many dofs).
  void set_noise_of(std::size_t step, NoiseModel noise);

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
  void take_measured(std::size_t step, const Eigen::Ref<const Eigen::VectorXd>& values);
  void project_complete(std::size_t time_index, StepForm& form);
  void project_incomplete(std::size_t step, std::size_t time_index, StepForm& form);
  void project_constant(std::size_t step, std::size_t time_index, StepForm& form, MovedForm* moved);
  void project_scaled(std::size_t step, std::size_t time_index,
                      const Eigen::Ref<const Eigen::VectorXd>& values, StepForm& form);
  [[nodiscard]] StepForm without_scale(const StepForm& joint) const;
  const NoiseGroup& group_of(std::size_t step);
  void take_step_error(const NoiseGroup& group, const Eigen::MatrixXd& factor, const Eigen::MatrixXd& core,
                       StepForm& form);

  std::shared_ptr<const reduction::ObservedModel> model_;
  NoiseModel noise_;
  Eigen::VectorXd central_;
  Eigen::MatrixXd predicted_;               ///< lift_t + (OU) C_t w₀, n_obs × n_t
  NoiseGroup complete_;                     ///< all values present
  NoiseGroup recent_;                       ///< the last other set of values present: masks tend to stay
  std::vector<Eigen::MatrixXd> quadratic_;  ///< G_t of complete data, per model time
  std::unique_ptr<SharedReferenceError> shared_;
  std::unique_ptr<ConstantSensorError> constant_;
  StepForm joint_;                  ///< of all data so far, in v and ε: where the scale is not known exactly
  std::vector<Eigen::Index> kept_;  // of the datum at hand
  Eigen::VectorXd residual_, weighted_, in_space_;  // workspace
};

/// log π̄(z | d₀ … d_i) on the standardised parameters: the collapsed likelihood plus log N(z; 0, I). A
/// transport target whose cost depends neither on the number of data nor on that of steps.
class CollapsedLogDensity final : public sampling::LogDensity {
 public:
  CollapsedLogDensity(std::shared_ptr<const reduction::ParameterFunctions> functions,
                      std::shared_ptr<const PriorTransform> transform, Eigen::VectorXd central_functions);

  /// The data from now on.
  void set_form(const StepForm& form);
  /// From the next `set_form` on the level of the noise is not known: it is integrated out.
  void infer_noise_level(NoiseLevel level) { noise_level_ = level; }
  [[nodiscard]] const std::optional<NoiseLevel>& noise_level() const { return noise_level_; }
  /// A mixture: the likelihood is Σ_k exp(log_weights[k]) L_k, L_k that of forms[k] (one per size of the
  /// model's discrepancy, `joint_discrepancy.hpp`). At least one; as many weights. `shares`: what is known of
  /// how probable each is (empty: nothing); a part below 1e-3 is not evaluated but for `component_shares`.
  void set_mixture(std::span<const StepForm* const> forms, std::span<const double> log_weights,
                   std::span<const double> shares = {});

  /// Of a mixture: how probable each of its parts is, at weighted points p of the posterior (n × d and n, sum
  /// 1).
  [[nodiscard]] Eigen::VectorXd component_shares(const Eigen::Ref<const Eigen::MatrixXd>& p,
                                                 const Eigen::Ref<const Eigen::VectorXd>& weights);

  [[nodiscard]] Eigen::Index dimension() const override { return transform_->dimension(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                sampling::LogDensityBatch& out) override;

  /// The log-likelihood alone as a function of z: what a composed map is made for (Rubio et al. 2019, Eq.
  /// 11).
  void evaluate_standardised_likelihood(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                                        sampling::LogDensityBatch& out);

  /// The log-likelihood alone, at points p of the box (n × d), with derivatives in p.
  void evaluate_likelihood(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                           sampling::LogDensityBatch& out);

 private:
  struct Workspace {
    Eigen::MatrixXd p, first, second;     ///< n × d
    sampling::LogDensityBatch component;  ///< of a mixture
  };
  struct Component {
    bool is_felt = true;
    QuadraticFactor factor;
    Eigen::MatrixXd combination;  ///< A of the quadratic form, k × r
    Eigen::VectorXd shift;        ///< b of it, k
    std::unique_ptr<reduction::QuadraticForm> likelihood;
  };
  Workspace& workspace(Eigen::Index n);
  void set_component(Component& component, const StepForm& form, double log_weight);
  void evaluate_mixture(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                        sampling::LogDensityBatch& out);

  std::shared_ptr<const reduction::ParameterFunctions> functions_;
  std::shared_ptr<const PriorTransform> transform_;
  Eigen::VectorXd central_;
  Eigen::VectorXd magnitude_;  ///< bounds of |w − w₀|
  std::vector<Component> components_;
  std::size_t count_ = 1;  ///< components in use, the first ones
  std::optional<NoiseLevel> noise_level_;
  std::map<Eigen::Index, Workspace> workspaces_;  ///< by number of points: few sizes occur, over and over
};

/// Adds log N(z; 0, I) and its derivatives to `out`.
void add_standard_normal(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                         sampling::LogDensityBatch& out);

}  // namespace knothe::assimilation
