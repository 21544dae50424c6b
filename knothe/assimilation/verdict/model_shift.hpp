#pragma once
/// @file How far the reduced model's own error moves a posterior.
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::assimilation {

/// Of full-order solutions u(p_j) = û(p_j) + e_j that are known: each is taken for data without noise, and
/// the reduced model is fitted to it,
///
///   p̂_j = argmin ½ |û(p) − u(p_j)|²_{R⁻¹} + ½ |p − p_j|²_Λ,   Λ: precision of the prior,
///
/// so p̂_j − p_j is what the model's error does to a posterior there. By the quadratic form of the data this
/// is ½ vᵀ G v − vᵀ h_j with v = w(p) − w(p_j) and h_j = Σ (U C_t)ᵀ R⁻¹ e_j(t). A linear formula is right for
/// small shifts only: a model that is too coarse is not linear over the shift it causes.
class ModelShift {
 public:
  /// `errors.points`: k × d, not empty.
  ModelShift(const model::ObservedModel& model, const model::ObservedErrors& errors,
             const posterior::PriorTransform& priors);

  /// (p̂_j − p_j) in posterior standard deviations there, d × k. `quadratic`: G of the data so far, r × r;
  /// `projected`: h_j, r × k. Cost: O(k r² d), and some Gauss–Newton steps of a point where the linear
  /// formula gives more than `k_linear`.
  [[nodiscard]] Eigen::MatrixXd of(const Eigen::MatrixXd& quadratic, const Eigen::MatrixXd& projected) const;

 private:
  struct Point {
    Eigen::VectorXd p, w;
    Eigen::MatrixXd slope;  ///< ∂w/∂p, r × d
  };
  [[nodiscard]] Point at(const Eigen::VectorXd& p) const;
  [[nodiscard]] Eigen::VectorXd shift(const Point& known, const Eigen::MatrixXd& quadratic,
                                      const Eigen::Ref<const Eigen::VectorXd>& projected) const;

  std::shared_ptr<const model::ParameterFunctions> functions_;
  Eigen::VectorXd lower_, upper_;    ///< d
  Eigen::MatrixXd prior_precision_;  ///< d × d
  std::vector<Point> known_;         ///< k
};

}  // namespace knothe::assimilation
