#pragma once
/// @file All data in one quadratic form: the collapsed posterior.
///
/// With y_t(p) = lift_t + (OU) C_t w(p) and Gaussian noise of known covariance R_t, the misfit of a datum is
/// a quadratic form in w, and w does not depend on time. With v = w(p) − w₀ (w₀ at a central point, so that
/// few digits cancel)
///   −2 log π(d_t | p) = vᵀ G_t v − 2 g_tᵀ v + c_t + n_t log 2π + log det R_t,
///   G_t = C_tᵀ (OU)ᵀ R_t⁻¹ (OU) C_t,   g_t = C_tᵀ (OU)ᵀ R_t⁻¹ r_t,   c_t = r_tᵀ R_t⁻¹ r_t,
/// r_t = d_t − lift_t − (OU) C_t w₀ (datum_projector.hpp). Sums over t are the whole likelihood of Rubio et
/// al. 2019, Eq. 13, at the cost of one datum.
#include <Eigen/Core>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "knothe/likelihood/noise/noise_level.hpp"
#include "knothe/likelihood/step/quadratic_factor.hpp"
#include "knothe/likelihood/step/step_form.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/numerics/integrate/grid_evaluator.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::likelihood {

/// log π̄(z | d₀ … d_i) on the standardised parameters: the collapsed likelihood plus log N(z; 0, I), and what
/// priors are known to be together. A transport target whose cost depends neither on the number of data nor
/// on that of steps.
class CollapsedLogDensity final : public posterior::LogDensity, public numerics::GridEvaluator {
 public:
  CollapsedLogDensity(std::shared_ptr<const model::ParameterFunctions> functions,
                      std::shared_ptr<const posterior::PriorTransform> transform,
                      Eigen::VectorXd central_functions);

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

  /// From now on, until other data are set, the density is that of one part of the mixture with its weight;
  /// that of all again with nothing.
  void single_out(std::optional<std::size_t> part) { alone_ = part; }
  /// Whether a part is evaluated.
  [[nodiscard]] bool is_felt(std::size_t part) const {
    return alone_ ? *alone_ == part : components_[part].contributes;
  }

  /// Of a mixture: how probable each of its parts is, at weighted points p of the posterior (n × d and n, sum
  /// 1).
  [[nodiscard]] Eigen::VectorXd component_shares(const Eigen::Ref<const Eigen::MatrixXd>& p,
                                                 const Eigen::Ref<const Eigen::VectorXd>& weights);
  /// The same at nodes of the grid.
  [[nodiscard]] Eigen::VectorXd component_shares(std::span<const numerics::GridRun> runs,
                                                 const Eigen::Ref<const Eigen::VectorXd>& weights);
  /// How many parts the likelihood has.
  [[nodiscard]] std::size_t component_count() const { return count_; }

  [[nodiscard]] Eigen::Index dimension() const override { return transform_->dimension(); }
  [[nodiscard]] const posterior::PriorTransform& prior() const { return *transform_; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                posterior::LogDensityBatch& out) override;
  /// log π̄ on a grid of z.
  void set_grid(const Eigen::Ref<const Eigen::MatrixXd>& axes) override;
  void evaluate_runs(std::span<const numerics::GridRun> runs, Eigen::Ref<Eigen::VectorXd> value) override;

  /// Of a density of z what stands beside log N(z; 0, I).
  enum class Factor { likelihood, likelihood_and_dependence };
  /// The log-likelihood as a function of z: what a composed map is made for (Rubio et al. 2019, Eq. 11), the
  /// first one with what priors are known to be together.
  void evaluate_standardised(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives, Factor factor,
                             posterior::LogDensityBatch& out);

  /// The log-likelihood alone, at points p of the box (n × d), with derivatives in p.
  void evaluate_likelihood(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                           posterior::LogDensityBatch& out);

 private:
  struct Workspace {
    Eigen::MatrixXd p, first, second;      ///< n × d
    posterior::LogDensityBatch component;  ///< of a mixture
  };
  struct Component {
    bool contributes = true;
    QuadraticFactor factor;
    Eigen::MatrixXd combination;  ///< A of the quadratic form, k × r
    Eigen::VectorXd shift;        ///< b of it, k
    std::unique_ptr<model::QuadraticForm> likelihood;
  };
  Workspace& workspace(Eigen::Index n);
  void set_component(Component& component, const StepForm& form, double log_weight);
  void evaluate_component(Component& component, std::span<const numerics::GridRun> runs,
                          Eigen::Ref<Eigen::VectorXd> value);
  void add_dependence(std::span<const numerics::GridRun> runs, Eigen::Ref<Eigen::VectorXd> value) const;
  [[nodiscard]] std::size_t first_felt() const;
  void evaluate_mixture(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                        posterior::LogDensityBatch& out);

  std::shared_ptr<const model::ParameterFunctions> functions_;
  std::shared_ptr<const posterior::PriorTransform> transform_;
  Eigen::VectorXd central_;
  Eigen::VectorXd magnitude_;  ///< bounds of |w − w₀|
  std::vector<Component> components_;
  std::size_t count_ = 1;  ///< components in use, the first ones
  std::optional<std::size_t> alone_;
  std::optional<NoiseLevel> noise_level_;
  Eigen::MatrixXd axes_;                          ///< of the grid, p
  Eigen::ArrayXXd prior_;                         ///< −log N(z; 0, 1) there
  Eigen::VectorXd next_values_;                   ///< of a mixture's next part
  std::map<Eigen::Index, Workspace> workspaces_;  ///< by number of points: few sizes occur, over and over
};

/// Adds log N(z; 0, I) and its derivatives to `out`.
void add_standard_normal(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                         posterior::LogDensityBatch& out);

}  // namespace knothe::likelihood
