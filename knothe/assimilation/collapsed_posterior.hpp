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
#include <vector>

#include "knothe/assimilation/noise_model.hpp"
#include "knothe/assimilation/prior_transform.hpp"
#include "knothe/assimilation/quadratic_factor.hpp"
#include "knothe/reduction/observed_model.hpp"
#include "knothe/sampling/log_density.hpp"

namespace knothe::assimilation {

/// What one datum says about w: its quadratic form, kept per step so that a step can be taken out again.
struct StepForm {
  Eigen::MatrixXd quadratic;  ///< G_t, r × r
  Eigen::VectorXd linear;     ///< g_t, r
  double constant = 0;        ///< c_t
  double log_normaliser = 0;  ///< n_t log 2π + log det R_t
  Eigen::Index used = 0;      ///< values used
  Eigen::Index missing = 0;   ///< values missing (NaN)

  /// Makes a form of r functions that says nothing.
  [[nodiscard]] static StepForm zero(Eigen::Index r);
  void add(const StepForm& other);
};

/// Turns data into step forms. Owns what depends on model and noise only: products of Eq. above that no datum
/// changes.
class DatumProjector {
 public:
  /// `centre`: the point p at which w₀ = w(p) is taken, d values inside the model's box.
  DatumProjector(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
                 const Eigen::VectorXd& centre);

  [[nodiscard]] const reduction::ObservedModel& model() const { return *model_; }
  [[nodiscard]] const Eigen::VectorXd& central_functions() const { return central_; }  ///< w₀, r
  [[nodiscard]] Eigen::Index observation_count() const { return predicted_.rows(); }

  /// The form of the datum `values` (n_obs, NaN = missing) of model time index `time_index`, into `form`.
  /// With all values present nothing is allocated after the first call.
  void project(std::size_t time_index, const Eigen::Ref<const Eigen::VectorXd>& values, StepForm& form);

 private:
  void project_complete(std::size_t time_index, StepForm& form);
  void project_incomplete(std::size_t time_index, const std::vector<Eigen::Index>& kept, StepForm& form);

  std::shared_ptr<const reduction::ObservedModel> model_;
  NoiseModel noise_;
  Eigen::VectorXd central_;
  Eigen::MatrixXd predicted_;                       ///< lift_t + (OU) C_t w₀, n_obs × n_t
  Eigen::MatrixXd weighted_space_;                  ///< R⁻¹ (OU), n_obs × l
  std::vector<Eigen::MatrixXd> quadratic_;          ///< G_t of complete data, per model time
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
    Eigen::MatrixXd p, first, second;  ///< n × d
  };
  Workspace& workspace(Eigen::Index n);

  std::shared_ptr<const reduction::ParameterFunctions> functions_;
  std::shared_ptr<const PriorTransform> transform_;
  Eigen::VectorXd central_;
  Eigen::VectorXd magnitude_;  ///< bounds of |w − w₀|
  QuadraticFactor factor_;
  Eigen::MatrixXd combination_;  ///< A of the quadratic form, k × r
  Eigen::VectorXd shift_;        ///< b of it, k
  std::unique_ptr<reduction::QuadraticForm> likelihood_;
  std::map<Eigen::Index, Workspace> workspaces_;  ///< by number of points: few sizes occur, over and over
};

/// Adds log N(z; 0, I) and its derivatives to `out`.
void add_standard_normal(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                         sampling::LogDensityBatch& out);

}  // namespace knothe::assimilation
