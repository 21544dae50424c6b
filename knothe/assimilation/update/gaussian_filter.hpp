#pragma once
/// @file Kalman filters of the separated model: extended, unscented, ensemble. For users who come from them,
/// and for comparison; not the answer where the posterior is not Gaussian.
#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "knothe/likelihood/step/step_form.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/posterior/method.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::assimilation {

/// A Gaussian N(mean, covariance) of the standardised parameters z, in which the prior is exactly N(0, I) and
/// nothing leaves the model's box. It never sees the measurements: with y = lift + (OU) C w(p(z)) every
/// product with R⁻¹ that a Kalman filter needs is one of G and g of the datum's form, so an update costs the
/// same for any number of them, and all kinds of noise are served.
///
/// - extended: w is linearised at the mean.
/// - unscented: 2d + 1 sigma points (Julier, Uhlmann 2004, κ = max(3 − d, 0)).
/// - ensemble: a deterministic square root of the ensemble (Bishop, Etherton, Majumdar 2001; symmetric).
class GaussianFilter {
 public:
  /// `kind`: one of the three filters. `central`: w₀ of the forms. `members`: of the ensemble.
  GaussianFilter(posterior::Method kind, std::shared_ptr<const model::ParameterFunctions> functions,
                 std::shared_ptr<const posterior::PriorTransform> transform, Eigen::VectorXd central,
                 Eigen::Index members, std::uint64_t seed);

  /// Takes a datum; returns the increment of the log-evidence, log N(innovation; 0, S).
  double update(const likelihood::StepForm& form);

  /// What all data so far have added to the prior, to the power `power`, in [0, 1].
  void raise(double power);

  [[nodiscard]] const Eigen::VectorXd& mean() const { return mean_; }              ///< d, z
  [[nodiscard]] const Eigen::MatrixXd& covariance() const { return covariance_; }  ///< d × d, z
  [[nodiscard]] const Eigen::MatrixXd& members() const { return members_; }        ///< n × d, ensemble only

 private:
  double update_extended(const likelihood::StepForm& form);
  double update_by_points(const likelihood::StepForm& form, const Eigen::MatrixXd& points,
                          const Eigen::VectorXd& weights);
  [[nodiscard]] Eigen::MatrixXd functions_at(const Eigen::MatrixXd& z) const;

  posterior::Method kind_;
  std::shared_ptr<const model::ParameterFunctions> functions_;
  std::shared_ptr<const posterior::PriorTransform> transform_;
  Eigen::VectorXd central_, mean_;
  Eigen::MatrixXd covariance_, members_;
};

/// `n` quasi-random points of N(0, I), n × d, made exactly of mean 0 and covariance I (n > d).
[[nodiscard]] Eigen::MatrixXd standardised_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed);

}  // namespace knothe::assimilation
