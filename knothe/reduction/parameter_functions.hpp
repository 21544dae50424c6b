#pragma once
/// @file The functions w(p) of a separated model, y_t(p) = O (u_lift(t) + U C_t w(p)).
#include <Eigen/Core>
#include <vector>

namespace knothe::reduction {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// w and its exact derivatives at n points; each row is one point, contiguous over the r functions.
struct FunctionBatch {
  RowMatrix value;               ///< n × r
  std::vector<RowMatrix> first;  ///< d matrices n × r: ∂w/∂p_a
  std::vector<RowMatrix> second;  ///< d(d+1)/2 matrices n × r: ∂²w/∂p_a∂p_b at index a(a+1)/2 + b, a ≥ b

  /// Makes room; keeps the memory it has where that suffices.
  void resize(Eigen::Index n, Eigen::Index d, Eigen::Index r, int derivatives) {
    value.resize(n, r);
    if (derivatives >= 1) {
      first.resize(d);
      for (auto& m : first) m.resize(n, r);
    }
    if (derivatives >= 2) {
      second.resize(d * (d + 1) / 2);
      for (auto& m : second) m.resize(n, r);
    }
  }
};

/// w: R^d → R^r, twice continuously differentiable, with exact first, second and mixed derivatives
/// (Rubio et al. 2019, Eq. 15). Safe to use from several threads.
class ParameterFunctions {
 public:
  virtual ~ParameterFunctions() = default;
  [[nodiscard]] virtual Eigen::Index dimension() const = 0;  ///< d
  [[nodiscard]] virtual Eigen::Index count() const = 0;      ///< r
  /// The box on which the functions are known; ±infinity where the model is unbounded. Nothing extrapolates:
  /// points are inside (a rounding error outside counts as on the border).
  [[nodiscard]] virtual Eigen::VectorXd lower() const = 0;
  [[nodiscard]] virtual Eigen::VectorXd upper() const = 0;
  /// Fills `out` (resized by the caller) at `points`, n × d.
  virtual void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                        FunctionBatch& out) const = 0;
};

}  // namespace knothe::reduction
