#pragma once
/// @file What a measurement is expected to tell, before it is made.
///
/// With C the covariance of the posterior, J_t(p) = (OU) C_t ∂w/∂p and R the noise of the measurement, a
/// datum of time t leaves the covariance (C⁻¹ + J_tᵀ R⁻¹ J_t)⁻¹, linearised at p. The expected information
/// about B p is the mean over the posterior of
///   ½ log det(B C Bᵀ) − ½ log det(B (C⁻¹ + J_tᵀ R⁻¹ J_t)⁻¹ Bᵀ)
/// (Chaloner and Verdinelli 1995). Exact where model and posterior are linear and Gaussian.
#include <Eigen/Core>
#include <memory>

#include "knothe/likelihood/noise/gaussian_noise.hpp"
#include "knothe/model/observe/observed_model.hpp"

namespace knothe::assimilation {

class ExpectedInformation {
 public:
  ExpectedInformation(std::shared_ptr<const model::ObservedModel> model,
                      const likelihood::GaussianNoise& noise);

  /// A posterior: points (n × d) that weigh the same, its covariance, and the rows B (k × d) of what is to be
  /// learnt. NumericalError where the covariance is not positive definite.
  void set(const Eigen::Ref<const Eigen::MatrixXd>& points, const Eigen::MatrixXd& covariance,
           const Eigen::MatrixXd& about);

  /// Nats, of a measurement at the model's time `step`.
  [[nodiscard]] double at(std::size_t step) const;

 private:
  std::shared_ptr<const model::ObservedModel> model_;
  Eigen::MatrixXd factor_;     ///< Lᵀ with L Lᵀ = (OU)ᵀ R⁻¹ (OU), l × l
  Eigen::MatrixXd tangents_;   ///< ∂w/∂p S of each point side by side, S Sᵀ = C: r × (n d)
  Eigen::MatrixXd about_;      ///< B S, k × d
  double before_ = 0;          ///< ½ log det(B C Bᵀ)
};

}  // namespace knothe::assimilation
