#pragma once
/// @file The change of variables p = F⁻¹(Φ(z)) for all parameters and many points, fast.
#include <Eigen/Core>
#include <vector>

#include "knothe/posterior/draws/mixture.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::posterior {

/// p(z), dp/dz and d²p/dz², parameter by parameter. In z independent priors are exactly N(0, I). What priors
/// of a joint one are known to be together is a factor beside that, `add_dependence`: whoever adds
/// log N(z; 0, I) adds it too.
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
  /// Adds log π₀(p) − Σ log π₀k(p_k) at points p of the support (n × d), with derivatives in p, to what `out`
  /// holds. Nothing where all priors are independent.
  void add_dependence(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                      LogDensityBatch& out) const;
  /// The same of log π₀(p), all of it; −∞ outside the support.
  void add_log_density(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                       LogDensityBatch& out) const;
  [[nodiscard]] bool is_independent() const { return groups_.empty(); }
  /// Covariance of z over the prior, as if p(z) were linear: I, but for the correlations of joint priors.
  [[nodiscard]] Eigen::MatrixXd covariance() const;
  /// Points of the prior from those of N(0, I) (n × d).
  [[nodiscard]] Eigen::MatrixXd points(const Eigen::Ref<const Eigen::MatrixXd>& normal) const;
  /// Quantiles of z (d × levels) as quantiles of p, exactly: p(z) is monotone, coordinate by coordinate.
  [[nodiscard]] Eigen::MatrixXd carry(const Eigen::Ref<const Eigen::MatrixXd>& z_quantiles) const;

 private:
  static constexpr double k_range = 8.5;
  static constexpr int k_per_unit = 32;
  static constexpr int k_intervals = static_cast<int>(2 * k_range * k_per_unit);
  struct Quintic {
    double c[6];  ///< coefficients in the local variable (z − left)·k_per_unit ∈ [0, 1]
  };
  /// Parameters of one joint prior, in the order of the mixture's coordinates.
  struct Group {
    std::vector<Eigen::Index> parameters;
    Mixture mixture;
    double log_mass = 0;  ///< of the part inside the priors' support
  };
  void tabulate(std::size_t k);
  void find_groups();
  [[nodiscard]] double log_mass_inside(const Group& group) const;
  [[nodiscard]] bool is_inside(const Group& group, const Eigen::Ref<const Eigen::VectorXd>& p) const;

  std::vector<Prior> priors_;
  std::vector<std::vector<Quintic>> table_;  ///< empty for an affine prior
  std::vector<Group> groups_;
};

}  // namespace knothe::posterior
