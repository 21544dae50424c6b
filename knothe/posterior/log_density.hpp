#pragma once
/// @file The target of a transport map: an unnormalised log-density on R^d, evaluated on many points at once.
#include <Eigen/Core>

namespace knothe::posterior {

/// Index of entry (a, b), a ≥ b, of a symmetric d × d matrix whose lower triangle is stored row by row.
[[nodiscard]] constexpr Eigen::Index packed_index(Eigen::Index a, Eigen::Index b) {
  return a >= b ? a * (a + 1) / 2 + b : b * (b + 1) / 2 + a;
}

/// Values and derivatives of a log-density at n points of R^d. One column per coordinate, so that each
/// coordinate is contiguous over the points.
struct LogDensityBatch {
  Eigen::VectorXd value;     ///< n, natural logarithm
  Eigen::MatrixXd gradient;  ///< n × d
  Eigen::MatrixXd hessian;   ///< n × d(d+1)/2, columns by `packed_index`

  /// Makes room for n points; keeps the memory it has where that suffices.
  void resize(Eigen::Index n, Eigen::Index d, int derivatives) {
    value.resize(n);
    if (derivatives >= 1) gradient.resize(n, d);
    if (derivatives >= 2) hessian.resize(n, d * (d + 1) / 2);
  }
};

/// log π̄ of Rubio et al. 2019, Eq. 8. An implementation may own workspace, hence `evaluate` is not const; one
/// object serves one thread.
class LogDensity {
 public:
  virtual ~LogDensity() = default;
  [[nodiscard]] virtual Eigen::Index dimension() const = 0;
  /// Highest order of derivatives that `evaluate` can give: 0, 1 or 2.
  [[nodiscard]] virtual int available_derivatives() const { return 2; }
  /// Fills `out` (which the caller has resized) with derivatives up to order `derivatives` at `points` (n ×
  /// d). Constants are included, so that ∫ exp(value) is the evidence. A value may be -inf where the density
  /// is zero; gradient and Hessian are finite wherever it is not.
  virtual void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                        LogDensityBatch& out) = 0;
};

}  // namespace knothe::posterior
