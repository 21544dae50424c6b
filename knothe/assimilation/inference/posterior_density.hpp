#pragma once
/// @file The posterior of any forward model, as a log-density of standardised parameters.
#include <optional>
#include <vector>

#include "knothe/assimilation/inference/model_evaluator.hpp"
#include "knothe/likelihood/noise/joint_noise.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::assimilation {

/// Observations y = f(p) + noise.
struct Observations {
  Eigen::VectorXd values;  ///< m
  likelihood::JointNoise noise;
};

/// log π̄(z), p = F⁻¹(Φ(z)) per parameter.
///
/// With observations: log N(y; f(p(z)), R) + log N(z; 0, I), so that ∫ exp is the evidence. Second
/// derivatives are −Jᵀ R⁻¹ J, plus Σ (R⁻¹ r)_i ∇² f_i where the model has second derivatives; where it has
/// not, that is the Gauss–Newton matrix, which serves to find steps and spreads: values and gradients decide.
///
/// Without: f is one number, the complete log posterior density in p; then π̄(z) is that density carried to z:
/// f(p(z)) + Σ log dp_k/dz_k. The priors only say where p lies and on which scale.
class PosteriorDensity final : public posterior::LogDensity {
 public:
  /// `highest_derivative`: what `available_derivatives` says at most (samplers that pay for each derivative
  /// by model evaluations are better off without). Errors: UsageError where sizes disagree.
  PosteriorDensity(ModelEvaluator& evaluator, std::vector<posterior::Prior> priors,
                   std::optional<Observations> observations, int highest_derivative = 2);

  [[nodiscard]] Eigen::Index dimension() const override { return transform_.dimension(); }
  [[nodiscard]] int available_derivatives() const override { return highest_derivative_; }
  /// The model is never asked at a point that is not finite: the density is zero there.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                posterior::LogDensityBatch& out) override;

  /// log N(y; f(p), R) at points of p (n × d), with derivatives in p. Without observations f − log π₀, so
  /// that adding the prior gives the density again.
  void log_likelihood(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                      posterior::LogDensityBatch& out);

  /// χ² = (y − f(p))ᵀ R⁻¹ (y − f(p)) of the prediction f(p), m; nothing without observations.
  struct Misfit {
    double chi_squared;
    Eigen::VectorXd predicted;
  };
  [[nodiscard]] std::optional<Misfit> misfit(const Eigen::VectorXd& p);

  /// p(z), n × d.
  [[nodiscard]] Eigen::MatrixXd parameters(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  [[nodiscard]] const posterior::PriorTransform& transform() const { return transform_; }
  [[nodiscard]] bool is_density() const { return !observations_; }

 private:
  void model_part(int derivatives, Eigen::Index begin, posterior::LogDensityBatch& out);
  void density_part(int derivatives, Eigen::Index begin, posterior::LogDensityBatch& out);
  void add_change_of_variables(Eigen::Index k, const Eigen::Ref<const Eigen::VectorXd>& z, int derivatives,
                               posterior::LogDensityBatch& out) const;

  ModelEvaluator* evaluator_;
  posterior::PriorTransform transform_;
  std::optional<Observations> observations_;
  int highest_derivative_;
  Eigen::MatrixXd p_, first_, second_;               ///< n × d
  Eigen::MatrixXd points_, values_, sensitivities_;  ///< d × c, m × c, m × c
  Eigen::MatrixXd gradients_, jacobians_, hessians_, jacobian_, weighted_;
};

}  // namespace knothe::assimilation
