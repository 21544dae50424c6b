#pragma once
/// @file Nuisances of few states, integrated out of quadratic forms step by step.
#include <Eigen/Core>

#include "knothe/likelihood/step/step_form.hpp"

namespace knothe::likelihood {

/// x | v ~ N(mean − slope v, covariance): what data said of states that they depend on beside v.
struct ConditionalStates {
  Eigen::VectorXd mean;        ///< q, at v = 0
  Eigen::MatrixXd slope;       ///< q × r
  Eigen::MatrixXd covariance;  ///< q × q, given v

  /// Mean and standard deviation of each, q × 2, over v of mean `v` and covariance `factor` `factor`ᵀ.
  [[nodiscard]] Eigen::MatrixX2d moments(const Eigen::VectorXd& v, const Eigen::MatrixXd& factor) const;
};

/// A Kalman filter for states x on which data depend beside v, with a mean that is affine in v:
///   x | v, data so far ~ N(mean − slope v, covariance).
/// A datum whose misfit is a quadratic form in v and x then has, given the data before it, a form in v alone
/// (docs/explanation/assimilation.md, "Nuisances"). The covariance may be singular: a state that is known.
class ConditionalFilter {
 public:
  /// `functions`: r, numbers in v.
  explicit ConditionalFilter(Eigen::Index functions) : functions_(functions) { drop(0); }
  [[nodiscard]] Eigen::Index size() const { return mean_.size(); }

  /// Further states N(0, diag(variance)), independent of all others; the index of the first of them.
  Eigen::Index append(const Eigen::VectorXd& variance);
  /// Forgets the states from `size` on: no datum to come depends on them.
  void drop(Eigen::Index size);
  /// x ← ρ x + √(1 − ρ²) N(0, I) for the first `count` states.
  void relax(Eigen::Index count, double rho);
  /// x[to …] += map · x[0 … columns of map).
  void accumulate(Eigen::Index to, const Eigen::MatrixXd& map);

  /// The form of the next datum given those before, in v; takes the datum in. `form`: in base v + map x.
  [[nodiscard]] StepForm condition(const StepForm& form, const Eigen::MatrixXd& base,
                                   const Eigen::MatrixXd& map);
  /// The same of a form in (v, x).
  [[nodiscard]] StepForm condition(const StepForm& form);
  /// Of `count` states from `first` on.
  [[nodiscard]] ConditionalStates states(Eigen::Index first, Eigen::Index count) const;
  /// E[x | v, data so far].
  [[nodiscard]] Eigen::VectorXd expected(const Eigen::VectorXd& v) const { return mean_ - slope_ * v; }

 private:
  Eigen::Index functions_;
  Eigen::VectorXd mean_;        ///< at v = 0
  Eigen::MatrixXd slope_;       ///< size × r
  Eigen::MatrixXd covariance_;  ///< given v
};

/// `form` in (v, x), v of `functions` numbers, with x ~ N(0, I) integrated out (Woodbury's identity): the
/// noise R has become R + F Fᵀ where the datum depends on x by F.
[[nodiscard]] StepForm without_standard_normals(const StepForm& form, Eigen::Index functions);

}  // namespace knothe::likelihood
