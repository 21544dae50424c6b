#pragma once
/// @file What is said of weighted points: moments, quantiles, and draws from them.
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// Levels at which quantiles are given, in lines, files and figures.
inline constexpr std::array<double, 5> k_quantile_levels = {0.025, 0.25, 0.5, 0.75, 0.975};

/// Mean (d) and covariance (d × d, symmetric to the bit) of points (n × d) under weights (n, sum 1; asserted
/// that there are as many).
void mean_and_covariance(const Eigen::Ref<const Eigen::MatrixXd>& points,
                         const Eigen::Ref<const Eigen::VectorXd>& weights, Eigen::VectorXd& mean,
                         Eigen::MatrixXd& covariance);

/// Mean and covariance; skewness and kurtosis of each coordinate.
struct Moments {
  Eigen::VectorXd mean;        ///< d
  Eigen::MatrixXd covariance;  ///< d × d
  Eigen::VectorXd skewness;    ///< d, E(z − μ)³/σ³
  Eigen::VectorXd kurtosis;    ///< d, E(z − μ)⁴/σ⁴: 3 for a Gaussian
};

/// Moments of the points (n × d) under the weights (n, ≥ 0 with a positive sum; divided by it). Skewness and
/// kurtosis of a coordinate without spread are 0 and 3. Errors: UsageError for sizes that disagree, no
/// points, weights that are negative, not finite or all zero.
[[nodiscard]] Moments moments_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                 const Eigen::Ref<const Eigen::VectorXd>& weights);

/// log Σ exp(values), at least one; −∞ for nothing but −∞.
[[nodiscard]] double log_sum(const Eigen::Ref<const Eigen::VectorXd>& values);

/// Effective sample size (Σw)²/Σw² of weights exp(log_weight), as a fraction of their number.
[[nodiscard]] double effective_share(const Eigen::Ref<const Eigen::VectorXd>& log_weight);

/// Quantiles of weighted points in one variable: the points sorted, point i stands at cumulative weight c_i =
/// Σ_{j<i} w_j + w_i/2 (the sum of the weights being 1), and values are interpolated linearly in c; beyond
/// the first and last, those. Linear time: only the neighbourhood of each quantile is sorted. Keeps its
/// workspace.
class WeightedQuantiles {
 public:
  /// `weights` ≥ 0 with a positive sum (any); `levels` in [0, 1]. Errors: UsageError for no points, no
  /// weight, sizes that disagree.
  void compute(std::span<const double> values, std::span<const double> weights,
               std::span<const double> levels, std::span<double> quantiles);

 private:
  struct Entry {
    double value, weight;
    bool operator<(const Entry& other) const { return value < other.value; }
  };
  struct Bin {
    double weight = 0;
    int count = 0, begin = 0, fill = 0;
    bool sorted = false;
  };
  std::vector<Bin> bins_;
  std::vector<Entry> entries_;
};

/// Marginal quantiles at `k_quantile_levels` of points (n × d): d × levels, into `quantiles`. The second form
/// keeps the workspace.
[[nodiscard]] Eigen::MatrixXd weighted_quantiles(const Eigen::MatrixXd& points,
                                                 const Eigen::VectorXd& weights);
void weighted_quantiles(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights,
                        WeightedQuantiles& workspace, Eigen::MatrixXd& quantiles);

/// Quantiles of a smooth density of which the nodes of a lattice are given, with weights (≥ 0, any positive
/// sum) proportional to the density there. Each node is spread by K(x/width)/width with its own width, whose
/// moments from the second to the fourteenth vanish, so that nothing is widened: its transform is Q(8, s) =
/// e⁻ˢ Σ_{j<8} sʲ/j!, s = (width ω)²/2. A width of 1.3 spacings makes it 1e-7 at ω = 2π/spacing, where the
/// lattice would be seen. Errors: as of `WeightedQuantiles`.
void lattice_quantiles(std::span<const double> nodes, std::span<const double> weights,
                       std::span<const double> widths, std::span<const double> levels,
                       std::span<double> quantiles);

/// `count` draws that weigh the same, by index, from weighted points (weights ≥ 0, any positive sum): those
/// at the cumulative weights (k + ½)/count, the points taken in the order of `reversed_bits`, because every
/// k-th point of a low-discrepancy sequence would lie in one part of the first coordinate.
[[nodiscard]] std::vector<Index> equal_draws(const Eigen::Ref<const Eigen::VectorXd>& weights, Index count);
/// The same with the points taken in the order of `values` (n, one for each): of what hardly depends on more
/// than these the draws have the distribution of all points.
[[nodiscard]] std::vector<Index> equal_draws_along(const Eigen::Ref<const Eigen::VectorXd>& values,
                                                   const Eigen::Ref<const Eigen::VectorXd>& weights,
                                                   Index count);

/// Those draws, count × d, shuffled by the seed, so that any part of them is a sample too.
[[nodiscard]] Eigen::MatrixXd resample(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                       const Eigen::Ref<const Eigen::VectorXd>& weights, Index count,
                                       std::uint64_t seed);

}  // namespace knothe::numerics
