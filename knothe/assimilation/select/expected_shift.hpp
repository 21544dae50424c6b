#pragma once
/// @file How far an interpolation's error moves the posterior that planned sensors will give.
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "knothe/numerics/functions/sparse_interpolation.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::assimilation {

/// Shift of the posterior mean by errors of the prediction, largest over the parameters, in posterior
/// standard deviations. For predictions y(p) in units of their noise with slope J and an error e of them
///
///   δ = C Jᵀ e,  C = (JᵀJ + diag 1/v)⁻¹,  shift = max_i |δ_i| / √C_ii,
///
/// which is exact for predictions linear in p, a constant error and normal priors of variance v.
/// `information`: JᵀJ, d × d; `pull`: Jᵀe, d × k, one column for each error. Returns k values.
[[nodiscard]] Eigen::VectorXd linear_posterior_shift(const Eigen::MatrixXd& information,
                                                     const Eigen::VectorXd& prior_variance,
                                                     const Eigen::MatrixXd& pull);

/// The shift at truths that the priors make likely, for an interpolation y(p) = Σ_ν s_ν H_ν(p) of all
/// predictions in units of their noise: those of every sensor at every time.
class ExpectedShift {
 public:
  /// `truths` Sobol points of the priors, which are truncated to the box. `prior_variance` is theirs.
  explicit ExpectedShift(std::vector<posterior::Prior> priors, Eigen::Index truths = 64,
                         std::uint64_t seed = 5);

  /// Points of the priors in the same way, n × d.
  [[nodiscard]] Eigen::MatrixXd draw(Eigen::Index n, std::uint64_t seed) const;
  [[nodiscard]] const Eigen::VectorXd& prior_variance() const { return variance_; }

  /// An interpolation and its surpluses s, |Λ| × N. Keeps of them what the members below need.
  void set(const numerics::SparseInterpolation& interpolation, const Eigen::MatrixXd& surpluses);

  /// If one term s_ν H_ν were missing: root mean square over the truths; |Λ| values.
  [[nodiscard]] Eigen::VectorXd of_each() const;
  /// If all terms together that `chosen` [|Λ|] marks were missing, likewise.
  [[nodiscard]] double of_all(const std::vector<bool>& chosen) const;
  /// An error Σ_ν s_ν g_ν(p), where `factors` gives g at a truth, |Λ|, likewise.
  [[nodiscard]] double of_factors(
      const std::function<Eigen::VectorXd(const Eigen::VectorXd& truth)>& factors) const;
  /// An `error` [N] of the predictions at a truth that is `p`.
  [[nodiscard]] double at(const Eigen::VectorXd& p, const Eigen::VectorXd& error) const;

 private:
  struct Truth {
    Eigen::VectorXd p;
    Eigen::MatrixXd information;  ///< d × d
    Eigen::MatrixXd pull;         ///< Jᵀ s_ν, d × |Λ|
    Eigen::VectorXd basis;        ///< H_ν
  };

  std::vector<posterior::Prior> priors_;
  Eigen::VectorXd variance_;
  std::vector<Truth> truths_;
  const numerics::SparseInterpolation* interpolation_ = nullptr;
  Eigen::MatrixXd surpluses_;
};

}  // namespace knothe::assimilation
