#pragma once
/// @file A reduced model made finer where it is needed: around a posterior, by a few full-order solutions
/// there (docs/explanation/reduction.md, "Refined where the posterior is").
#include <Eigen/Core>
#include <span>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/snapshots.hpp"
#include "knothe/model/reduced/truncation_error.hpp"

namespace knothe::model {

/// Where the model is to be fine: mean (d) and covariance (d × d) of a posterior.
struct Neighbourhood {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  [[nodiscard]] Eigen::VectorXd std() const { return covariance.diagonal().cwiseSqrt(); }
};

/// How what is known at one point goes on to others.
struct InterpolationKernel {
  /// ℓ, d: of Matérn's kernel of order 5/2, K(p, q) = (1 + r + r²/3) e⁻ʳ, r² = 5 Σ_a ((p − q)_a / ℓ_a)².
  Eigen::VectorXd lengths;
  Eigen::VectorXd reach;  ///< ρ, d: beyond two or three of these around the points nothing is said
  /// Variance, of one, of what is not smooth (a solution has kinks where damage begins); it keeps what is
  /// said between the points from growing wild beyond them.
  double nugget = 1e-10;
};

/// Interpolation of what is known at scattered points p_1 … p_k, and is zero at some more: kriging,
/// e(p) ≈ Σ_i φ_i(p) e_i, times a window that is one between the points,
/// 1 − Π_i (1 − exp(−½ Σ_a ((p − p_i)_a / ρ_a)²)).
class ScatteredInterpolation {
 public:
  /// `points` k × d, `zeros` z × d.
  ScatteredInterpolation(const Eigen::MatrixXd& points, const Eigen::MatrixXd& zeros,
                         InterpolationKernel kernel);
  [[nodiscard]] const InterpolationKernel& kernel() const { return kernel_; }
  /// φ at `at` (n × d): n × k.
  [[nodiscard]] Eigen::VectorXd window(const Eigen::Ref<const Eigen::MatrixXd>& at) const;  ///< n
  [[nodiscard]] Eigen::MatrixXd functions(const Eigen::Ref<const Eigen::MatrixXd>& at) const;
  /// k × k, L: what the interpolation of the others misses at p_i is Σ_j L_ij e_j (O. Dubrule 1983).
  [[nodiscard]] const Eigen::MatrixXd& leave_one_out() const { return leave_one_out_; }
  /// Standard deviation of what is missed at p_i when it is left out (k), and at `at` (n) by all, for a
  /// process of standard deviation one.
  [[nodiscard]] Eigen::VectorXd left_out_std() const;
  [[nodiscard]] Eigen::VectorXd missed_std(const Eigen::Ref<const Eigen::MatrixXd>& at) const;

 private:
  Eigen::MatrixXd points_, all_;  ///< k × d, (k + z) × d
  InterpolationKernel kernel_;
  Eigen::MatrixXd inverse_;  ///< of the kernel matrix
  Eigen::MatrixXd leave_one_out_;
};

/// Of `candidates` (n × d, equally weighted) the `count` at which a solution lowers the kriging variance
/// most, averaged over all candidates, one after the other. `known` k × d: solutions so far; the error is
/// taken for zero at the nodes of `axes`. Fewer rows where nothing is left to be known. The kernel's nugget
/// is left out: a solution is exact, and is not asked for twice.
[[nodiscard]] Eigen::MatrixXd most_informative(std::span<const Axis> axes, const Eigen::MatrixXd& known,
                                               const Eigen::MatrixXd& candidates,
                                               const InterpolationKernel& kernel, Index count);
/// A kernel before solutions tell of one: in proportion to the cell of the grid that holds `at`.
[[nodiscard]] InterpolationKernel kernel_of_cell(std::span<const Axis> axes, const Neighbourhood& at);

struct RefinedModel {
  ModelContents model;  ///< in tree form, with more nodes around the neighbourhood
  /// Of it: what the solutions miss of each other, scaled to what all of them together miss over the
  /// neighbourhood; far from them the base's.
  TruncationError error;
  InterpolationKernel kernel;  ///< by which the solutions predict each other best
};

/// `base` plus the interpolated errors that it has at the `solutions` (each a grid of one point): fields and
/// outputs. The axes get more nodes around `at`; at the base's own nodes, and far away, nothing changes.
/// `error` is the base's. DataError for a solution that does not have the base's parameters, times, dofs or
/// outputs.
[[nodiscard]] RefinedModel refined(const ModelContents& base, const TruncationError& error,
                                   std::span<const Snapshots> solutions, const Neighbourhood& at);

}  // namespace knothe::model
