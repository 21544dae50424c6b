#pragma once
/// @file Other ways of sequential assimilation with the same model, priors and data, and the same result:
/// `knothe assimilate --method ekf|ukf|enkf|smc|mcmc`.
#include <memory>
#include <optional>

#include "knothe/assimilation/update/gaussian_filter.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"

namespace knothe::assimilation {

struct BaselineOptions {
  Method kind = Method::extended_kalman;  ///< one that `is_baseline`
  Eigen::Index samples =
      10000;  ///< draws of the chain; a fifth as many particles, a fiftieth as many members
  std::uint64_t seed = 1;
};

/// Kalman filters report their own Gaussian of z, carried to p by the priors' transform: moments, quantiles
/// and evidence are theirs, uncorrected. `variance_diagnostic` and `effective_sample_size` compare it with
/// the exact posterior, so that `trusted` means the same as for a map. Monte Carlo methods sample the exact
/// collapsed posterior from scratch at each step; their effective sample size is that of the draws, trusted
/// means that they converged. The evidence of a chain is an importance estimate from the Gaussian of its
/// draws.
class BaselineUpdate {
 public:
  /// As SequentialUpdate's.
  BaselineUpdate(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
                 std::vector<Prior> priors, BaselineOptions options);

  /// Assimilates a datum later than all before: UsageError otherwise.
  const UpdateResult& update(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values);
  /// From now on step `step`, which is not assimilated yet, has this noise.
  void set_step_noise(std::size_t step, GaussianNoise noise) {
    projector_.set_noise_of(step, std::move(noise));
  }
  [[nodiscard]] const UpdateResult& result() const { return result_; }
  [[nodiscard]] const Posterior& posterior() const { return result_; }

 private:
  void by_filter(const StepForm& form);
  void by_particles();
  void by_chain();
  void set_points(const Eigen::MatrixXd& z, const Eigen::VectorXd& weights);
  /// log weights of the points of N(mean, covariance) against the posterior.
  [[nodiscard]] Eigen::VectorXd log_weights(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance,
                                            Eigen::MatrixXd& z);

  BaselineOptions options_;
  std::shared_ptr<const PriorTransform> transform_;
  DatumProjector projector_;
  CollapsedLogDensity target_;
  std::optional<GaussianFilter> filter_;
  Eigen::MatrixXd reference_;  ///< points of N(0, I)
  StepForm sum_;
  std::optional<std::size_t> last_;
  double log_evidence_ = 0;
  UpdateResult result_;
};

}  // namespace knothe::assimilation
