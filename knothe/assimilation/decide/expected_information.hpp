#pragma once
/// @file What measurements are expected to tell, before they are made, and which to make.
///
/// At a point p of the posterior the data so far leave the precision Λ = P₀ + (∂w/∂p)ᵀ H ∂w/∂p, with P₀ that
/// of the prior and H the sum of the data's quadratic forms, and a measurement of time t adds F_t = J_tᵀ R⁻¹
/// J_t, J_t = (OU) C_t ∂w/∂p. What measurements S tell about B p is the mean over the posterior of ½ log
/// det(B Λ⁻¹ Bᵀ) − ½ log det(B (Λ + Σ_S F_t)⁻¹ Bᵀ), in nats (Chaloner and Verdinelli 1995; Long et al. 2013).
/// Exact where model and prior are linear and Gaussian. Λ is that of the point: where the posterior is bent
/// its covariance is wide in directions that the data have long determined.
#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "knothe/likelihood/noise/gaussian_noise.hpp"
#include "knothe/model/observe/observed_model.hpp"

namespace knothe::assimilation {

/// A measurement that is worth making, with what it tells beside those chosen before it.
struct PlannedMeasurement {
  std::size_t step = 0;    ///< of the model
  double information = 0;  ///< nats
};

class ExpectedInformation {
 public:
  ExpectedInformation(std::shared_ptr<const model::ObservedModel> model,
                      const likelihood::GaussianNoise& noise);

  [[nodiscard]] Index functions() const { return model_->functions->count(); }

  /// A posterior: points (n × d) that weigh the same; `known`: P₀, d × d, and H, r × r (empty: none, and P₀
  /// is all that is known); the rows B (k × d) of what is to be learnt. NumericalError where Λ is not finite
  /// or, later, Λ or B Λ⁻¹ Bᵀ not positive definite.
  void set(const Eigen::Ref<const Eigen::MatrixXd>& points, const Eigen::MatrixXd& prior_precision,
           const Eigen::MatrixXd& data, const Eigen::MatrixXd& about);

  /// Of one measurement at the model's time `step`, nats.
  [[nodiscard]] double of(std::size_t step) const;
  /// Measurements at some of the model's times `steps`, the most informative first, each given those before
  /// it: until none tells `least` nats, at most `k_max_planned`. One time may come several times.
  [[nodiscard]] std::vector<PlannedMeasurement> plan(std::span<const std::size_t> steps, double least) const;

  static constexpr std::size_t k_max_planned = 64;

 private:
  [[nodiscard]] bool is_of_all() const { return about_.rows() == about_.cols(); }
  using Matrices = std::vector<Eigen::MatrixXd>;  ///< d × d, one for each point
  [[nodiscard]] Matrices fisher(std::size_t step) const;
  [[nodiscard]] double half_log_variance(const Matrices& precision) const;

  std::shared_ptr<const model::ObservedModel> model_;
  Eigen::MatrixXd factor_;    ///< Lᵀ with L Lᵀ = (OU)ᵀ R⁻¹ (OU), l × l
  Eigen::MatrixXd tangents_;  ///< ∂w/∂p of each point side by side, r × (n d)
  Eigen::MatrixXd about_;     ///< B
  Matrices known_;            ///< Λ
};

}  // namespace knothe::assimilation
