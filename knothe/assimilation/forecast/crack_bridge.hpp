#pragma once
/// @file From damage to a crack: the distribution of the crack length at the horizon (Rubio et al. 2019,
/// §6.3.2, Eq. 14 and 33).
#include <Eigen/Core>
#include <algorithm>

#include "knothe/assimilation/forecast/crack_meta_model.hpp"
#include "knothe/assimilation/forecast/horizon.hpp"
#include "knothe/assimilation/forecast/length_curve.hpp"
#include "knothe/assimilation/forecast/nearest_crack.hpp"
#include "knothe/assimilation/forecast/scalar_forecast.hpp"
#include "knothe/base/index.hpp"

namespace knothe::assimilation {

struct CrackBridgeOptions {
  double prior_mean =
      0.04;  ///< m; of Eq. 33: the paper's prior on l_T is N(0.04, 0.013²), here truncated to the lengths
  double prior_std = 0.013;  ///< m
  double threshold = 0.04;   ///< m, of the crack that is meant; P(l_T > threshold) is reported
  double error_std = 0.0;    ///< m; how far the crack that is meant may be from the curve
  LengthCurve curve = {};    ///< from the elastic crack to the one that is meant
};

struct CrackForecast {
  ScalarForecast length;  ///< m
  /// m; how far the elastic crack is from the predicted field, dof by dof: δ of greatest evidence, the length
  /// integrated out. Root mean square over the posterior.
  double discrepancy_std = 0.0;
};

/// The elastic crack whose sensor displacements match the damaged beam, u_imp u_SVD(l) ≈ u = lift + A w(p).
/// Everything that does not depend on the posterior is done once: one orthonormal basis of
/// span{σ_k u_k, lift, A} turns all observed fields into at most N_SVD + r + 1 coordinates. The cost of an
/// update does not depend on the number of dofs.
class CrackBridge {
 public:
  /// `imposed_displacement` is u_imp(T) [m], by which the unit solutions are multiplied.
  /// Errors: ProjectError for options out of range, DataError where the shapes disagree or a number is not
  /// finite.
  CrackBridge(CrackMetaModel meta_model, const LinearPrediction& prediction, double imposed_displacement,
              const CrackBridgeOptions& options = {});

  /// The forecast: the posterior carried through p ↦ l(p), the length whose field is nearest (Eq. 14), and
  /// the curve, plus an independent N(0, error_std²). `functions`: w at the posterior's points, n × r. No
  /// second prior, on the length, enters: that of the parameters already says how likely each length is. Of
  /// more than 1,024 points so many draws are taken, in the order of their length to first order about the
  /// mean. Errors: NumericalError for weights that are negative or add up to nothing.
  [[nodiscard]] CrackForecast update(const Eigen::Ref<const model::RowMatrix>& functions,
                                     const Eigen::Ref<const Eigen::VectorXd>& weights) const;

  /// Of each sample (n × r) the elastic length whose field is nearest, m, and the square of what is left, m²
  /// summed over the dofs.
  struct Nearest {
    Eigen::VectorXd length, square;  ///< n
  };
  [[nodiscard]] Nearest nearest(const Eigen::Ref<const model::RowMatrix>& functions) const;
  /// The forecast from these, for samples of `weights` (n).
  [[nodiscard]] CrackForecast forecast(const Eigen::Ref<const Eigen::VectorXd>& lengths,
                                       const Eigen::Ref<const Eigen::VectorXd>& squares,
                                       const Eigen::Ref<const Eigen::VectorXd>& weights) const;

  /// Eq. 33 with a normal π_u: π(l_T) ∝ N(u_imp u_SVD(l); E[u], Cov[u] + discrepancy_std² I) π₀(l), from the
  /// moments of w (r, r × r). In the coordinates the covariance is C Cov[w] Cᵀ + discrepancy_std² I; outside
  /// of them it is discrepancy_std² I and the misfit is zero. (This is Woodbury's identity without its
  /// cancellation.) Right only where u is close to normal: docs/explanation/forecast.md.
  /// Errors: NumericalError for moments that are not finite, or a discrepancy that is not positive.
  [[nodiscard]] ScalarForecast published(const FunctionMoments& moments, double discrepancy_std) const;

  /// Eq. 33 with π_u from the inverse transport map of the predicted field (§6.3.2): S takes the points'
  /// fields plus N(0, discrepancy_std² I) to N(0, I), and π_u(u) = ρ(S(u)) |det ∇S(u)|. The map is of the
  /// axes of Cov[u] along which the posterior, not the discrepancy, decides; along the others u is taken as
  /// normal. For a field whose distribution is not normal. Made from at most 1,024 points; tenths of a
  /// second. Errors: as of `update` and `published`.
  [[nodiscard]] ScalarForecast published_by_map(const Eigen::Ref<const model::RowMatrix>& functions,
                                                const Eigen::Ref<const Eigen::VectorXd>& weights,
                                                double discrepancy_std) const;

  [[nodiscard]] const CrackMetaModel& meta_model() const { return meta_model_; }
  [[nodiscard]] const CrackBridgeOptions& options() const { return options_; }

 private:
  /// `coordinates`: upper triangular, k × (N_SVD + 1 + r).
  CrackBridge(CrackMetaModel&& meta_model, const Eigen::MatrixXd& coordinates,
              const CrackBridgeOptions& options);
  /// Rows of `crack_` that are not zero.
  [[nodiscard]] Index crack_rows() const { return std::min(crack_.rows(), crack_.cols()); }
  /// Predicted displacements of each sample (n × r) in the coordinates of the basis, k × n.
  [[nodiscard]] Eigen::MatrixXd fields_of(const Eigen::Ref<const model::RowMatrix>& functions) const;
  /// Each sample's length to first order about that of the mean field, but for a factor and a shift.
  [[nodiscard]] Eigen::VectorXd along_crack(const Eigen::Ref<const model::RowMatrix>& functions,
                                            const Eigen::Ref<const Eigen::VectorXd>& weights) const;

  CrackMetaModel meta_model_;
  CrackBridgeOptions options_;
  Eigen::MatrixXd crack_;  ///< coordinates of u_imp σ_k u_k, k × N_SVD
  Eigen::VectorXd lift_;   ///< coordinates of lift, k
  Eigen::MatrixXd modes_;  ///< coordinates of A, k × r
  NearestCrack nearest_;
  std::vector<double> base_;     ///< lengths at which Eq. 33 is looked at first: four for each snapshot
  Eigen::MatrixXd base_values_;  ///< v(l) there, N_SVD × n
  Eigen::VectorXd base_prior_;   ///< log π₀ there
};

}  // namespace knothe::assimilation
