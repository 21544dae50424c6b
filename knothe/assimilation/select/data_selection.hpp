#pragma once
/// @file Which dofs to measure: greedy D-optimal and information-gain selection by rank-one updates.
///
/// With v the parameters in units of the prior's standard deviation, the information about v in the dofs s of
/// all steps is, linearised at a point p,
///   F_s = Σ_t J_tᵀ R_ss⁻¹ J_t,    J_t = (OU)_s C_t ∂w/∂p · diag(prior std),
/// and the posterior covariance is (I + F_s)⁻¹. A dof k adds Σ_t a aᵀ with the conditional row
///   a = (J_tk − R_ks R_ss⁻¹ J_ts)/√(R_kk − R_ks R_ss⁻¹ R_sk),
/// which a pivoted Cholesky factorisation of R, one column per chosen dof, keeps up to date for all dofs at
/// once. The noise of a reference picture that all steps share makes the covariance R ⊗ T with
/// T = (k I + 1 1ᵀ)/(k + 1): the rows are whitened in time beforehand. Time itself is compressed to the few
/// directions in which the rows differ.
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::assimilation {

/// Dofs in the order in which they were chosen, with what each adds.
struct Selection {
  std::vector<Eigen::Index> dofs;
  std::vector<double> gain;  ///< increase of the criterion, nats: mean over the points of ½ log det(I + F)
  std::vector<Eigen::MatrixXd> information;  ///< F of the dofs so far at the first point, d × d
};

class SensorDesign {
 public:
  /// `points`: parameters at which the model is linearised, one a row, inside the box: one for a D-optimal
  /// choice, several draws of the prior for the expected information gain. `prior_std`: d. `positions`: of
  /// the dofs, n × 3, m. Noise of single steps is not taken into account. Errors: UsageError for noise in
  /// which a dof is not measured at all.
  SensorDesign(const model::ObservedModel& model, const likelihood::NoiseModel& noise,
               const Eigen::VectorXd& prior_std, const Eigen::MatrixXd& points,
               Eigen::Matrix<double, Eigen::Dynamic, 3> positions);
  ~SensorDesign();

  /// Greedy choice of `count` dofs, any two at least `min_distance` apart (m). Fewer where there are no more.
  [[nodiscard]] Selection choose(std::size_t count, double min_distance = 0) const;
  /// What the dofs of a given order add, one after the other.
  [[nodiscard]] Selection along(const std::vector<Eigen::Index>& order) const;
  /// F of all dofs together at the first point, d × d; nothing is inverted: R⁻¹ is what is given.
  [[nodiscard]] const Eigen::MatrixXd& information_of_all() const { return all_; }
  /// Marginal standard deviation of the noise of each dof, m.
  [[nodiscard]] const Eigen::VectorXd& noise_std() const { return noise_std_; }

 private:
  struct Covariance;
  class Progress;
  void add_point(const model::ObservedModel& model, const likelihood::NoiseModel& noise,
                 const Eigen::VectorXd& prior_std, const Eigen::VectorXd& p);

  Eigen::Index dimension_;
  Eigen::Matrix<double, Eigen::Dynamic, 3> positions_;
  std::unique_ptr<const Covariance> covariance_;  ///< columns of R for correlated noise, else null
  Eigen::VectorXd noise_std_;
  Eigen::MatrixXd rows_;  ///< n × Σ_points d q: rows J_k over the directions of time, point by point
  std::vector<Eigen::Index> width_;  ///< q of each point
  Eigen::MatrixXd all_;
};

/// `count` quasi-random draws of the priors, one a row, the first their medians.
[[nodiscard]] Eigen::MatrixXd prior_points(const std::vector<posterior::Prior>& priors, Eigen::Index count);

}  // namespace knothe::assimilation
