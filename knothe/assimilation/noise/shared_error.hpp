#pragma once
/// @file Errors that all steps share: the noise of the reference picture, constant offsets of sensors.
///
/// y_t = model_t + own_t + s with own_t ~ N(0, Q_t⁻¹) new at each step and s ~ N(0, K⁻¹) the same at all.
/// The likelihood of a datum given the data before it stays a quadratic form in v = w − w₀, so the forms of
/// the steps still add up to that of all data, and nothing about the collapsed posterior changes; but the
/// form of a step depends on the steps before it. With the same precision M/γ² of own errors at n complete
/// steps and k reference pictures the sum is
///   γ⁻² [Σ yᵀMy − (Σy)ᵀM(Σy)/(n + k)].
#include <Eigen/Core>
#include <vector>

#include "knothe/assimilation/noise/noise_model.hpp"
#include "knothe/assimilation/update/step_form.hpp"

namespace knothe::assimilation {

/// One noise matrix and one set of dofs, with what no datum changes, and the sums over the data that came
/// with both.
struct NoiseGroup {
  std::size_t step = 0;            ///< where the noise is that of one step only
  bool of_one_step = false;        ///< noise/precision_steps
  std::vector<Eigen::Index> kept;  ///< dofs, increasing
  NoiseModel noise;                ///< R_s⁻¹ of the dofs kept: own and shared part together
  Eigen::MatrixXd space;           ///< (OU)_s
  Eigen::MatrixXd weighted_space;  ///< R_s⁻¹ (OU)_s
  Eigen::MatrixXd gram;            ///< (OU)_sᵀ R_s⁻¹ (OU)_s
  Eigen::Index count = 0;          ///< n_g, data so far
  Eigen::VectorXd sum_residual;    ///< Σ r_t
  Eigen::MatrixXd sum_core;        ///< Σ C_t
  Eigen::VectorXd sum_extra;       ///< Σ of the further columns; empty where there are none

  /// The form of a datum with residual r and core C, its covariance R_s / factor. `extra` (may be null): how
  /// the datum depends on one more unknown, which becomes the last of the form.
  void project(const Eigen::MatrixXd& core, const Eigen::VectorXd& residual, double factor, StepForm& form,
               const Eigen::VectorXd* extra = nullptr) const;
};

/// The noise of k reference pictures shared by correlated data: K = k Q, Q = R⁻¹ (k + 1)/k.
///
/// While all data come with the same noise and the same dofs, the conditional law of a datum is that of
/// r_n − Σ_{i<n} r_i/(k + n − 1), of precision Q (k + n − 1)/(k + n): no factorisation, no cancellation.
/// Otherwise s is integrated out by a sparse factorisation of K + Σ S_tᵀ Q_t S_t, in which the errors of
/// missing dofs stay as variables, so that their Schur complements are never formed; it costs one
/// factorisation and r + 1 solves per datum.
class SharedReferenceError {
 public:
  /// `functions`: unknowns of the forms, r, and one more where data come with an `extra` column.
  SharedReferenceError(const NoiseModel& noise, Eigen::Index functions);
  void restart();
  void set_noise(const NoiseModel& noise) { noise_ = noise; }  ///< the same, with further steps
  /// The form of the next datum given those before it. `group` becomes one of the groups if the datum is
  /// taken (`take`).
  [[nodiscard]] StepForm condition(const NoiseGroup& group, const Eigen::MatrixXd& core,
                                   const Eigen::VectorXd& residual,
                                   const Eigen::VectorXd* extra = nullptr) const;
  /// The same for a model with a discrepancy.
  [[nodiscard]] MovedForm condition_moved(const NoiseGroup& group, const Eigen::MatrixXd& core,
                                          const Eigen::VectorXd& residual) const;
  /// Adds the datum.
  void take(const NoiseGroup& group, const Eigen::MatrixXd& core, const Eigen::VectorXd& residual,
            const Eigen::VectorXd* extra = nullptr);

 private:
  struct Shared {
    StepForm form;  ///< −(b − B v)ᵀ A⁻¹ (b − B v) and log det A − log det K
  };
  [[nodiscard]] bool is_uniform(const NoiseGroup& group) const;
  [[nodiscard]] StepForm integrated(const std::vector<NoiseGroup>& groups) const;

  NoiseModel noise_;  ///< of all steps but those with their own
  double pictures_;   ///< k
  Eigen::Index functions_;
  std::vector<NoiseGroup> groups_;
};

/// Constant errors of independent sensors, s_j ~ N(0, 1/K_j): offsets, or the noise of a shared reference.
class ConstantSensorError {
 public:
  /// `precision`: K_j, n; `functions`: r.
  ConstantSensorError(Eigen::VectorXd precision, Eigen::Index functions);
  void restart();
  /// The form of the next datum given those before it, in which sensor j has the own precision q_j (0:
  /// missing), residual r_j and the row of `design` (n × r) as its sensitivity to w.
  [[nodiscard]] StepForm condition(const Eigen::VectorXd& own_precision, const Eigen::MatrixXd& design,
                                   const Eigen::VectorXd& residual) const;
  /// The same for a model with a discrepancy; `space` · `core` is the design.
  [[nodiscard]] MovedForm condition_moved(const Eigen::VectorXd& own_precision, const Eigen::MatrixXd& space,
                                          const Eigen::MatrixXd& core, const Eigen::VectorXd& residual) const;
  void take(const Eigen::VectorXd& own_precision, const Eigen::MatrixXd& design,
            const Eigen::VectorXd& residual);

 private:
  Eigen::VectorXd initial_, precision_, weighted_residual_;  ///< K; K + Σ q; Σ q r
  Eigen::MatrixXd weighted_design_;                          ///< Σ q · design
  std::vector<Eigen::VectorXd> kinds_;                       ///< own precisions with which data came so far
};

}  // namespace knothe::assimilation
