#pragma once
/// @file The change of variables p = F⁻¹(Φ(z)) for all parameters and many points, fast.
#include <Eigen/Core>
#include <vector>

#include "knothe/posterior/prior/prior.hpp"

namespace knothe::posterior {

/// p(z), dp/dz and d²p/dz² for d independent priors. In z the joint prior is exactly N(0, I).
///
/// Normal priors without truncation are affine and exact. The others are piecewise quintic Hermite
/// interpolants of F⁻¹∘Φ on |z| ≤ 8.5 with exact values and derivatives every 1/32 (error below 1e-12 of the
/// scale, tested), and the derivatives returned are those of the interpolant itself, so that value, slope and
/// curvature belong to one function; outside, the exact formula.
class PriorTransform {
 public:
  explicit PriorTransform(std::vector<Prior> priors);

  [[nodiscard]] Eigen::Index dimension() const { return std::ssize(priors_); }
  [[nodiscard]] const std::vector<Prior>& priors() const { return priors_; }
  [[nodiscard]] const Prior& prior(Eigen::Index k) const { return priors_[k]; }

  /// Fills `p` and, for derivatives ≥ 1 and 2, `first` and `second`, all n × d and resized by the caller.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives, Eigen::Ref<Eigen::MatrixXd> p,
                Eigen::Ref<Eigen::MatrixXd> first, Eigen::Ref<Eigen::MatrixXd> second) const;
  /// Quantiles of z (d × levels) as quantiles of p, exactly: p(z) is monotone, coordinate by coordinate.
  [[nodiscard]] Eigen::MatrixXd carry(const Eigen::Ref<const Eigen::MatrixXd>& z_quantiles) const;

 private:
  static constexpr double k_range = 8.5;
  static constexpr int k_per_unit = 32;
  static constexpr int k_intervals = static_cast<int>(2 * k_range * k_per_unit);
  struct Quintic {
    double c[6];  ///< coefficients in the local variable (z − left)·k_per_unit ∈ [0, 1]
  };
  void tabulate(std::size_t k);

  std::vector<Prior> priors_;
  std::vector<std::vector<Quintic>> table_;  ///< empty for an affine prior
};

}  // namespace knothe::posterior
