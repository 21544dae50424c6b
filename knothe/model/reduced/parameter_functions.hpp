#pragma once
/// @file The functions w(p) of a separated model, y_t(p) = O (u_lift(t) + U C_t w(p)).
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::model {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// w and its exact derivatives at n points; each row is one point, contiguous over the r functions.
struct FunctionBatch {
  RowMatrix value;               ///< n × r
  std::vector<RowMatrix> first;  ///< d matrices n × r: ∂w/∂p_a
  std::vector<RowMatrix> second;  ///< d(d+1)/2 matrices n × r: ∂²w/∂p_a∂p_b at index a(a+1)/2 + b, a ≥ b

  /// Makes room; keeps the memory it has where that suffices.
  void resize(Index n, Index d, Index r, int derivatives) {
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

/// ℓ(p) = constant − ½ |A w(p) + b|² + c·w(p): what a Gaussian log-likelihood is as a function of p. Owns
/// workspace: one object serves one thread. It refers to the functions it was made from, which must outlive
/// it.
class QuadraticForm {
 public:
  virtual ~QuadraticForm() = default;
  /// `a`: k × r (k may be 0), `b`: k, `c`: r. Nothing is allocated when k is not larger than before.
  virtual void set(const Eigen::Ref<const Eigen::MatrixXd>& a, const Eigen::Ref<const Eigen::VectorXd>& b,
                   const Eigen::Ref<const Eigen::VectorXd>& c, double constant) = 0;
  /// ℓ at `points` (n × d) into `value` (n) and, for `derivatives` ≥ 1 and 2, `gradient` (n × d) and
  /// `hessian` (n × d(d+1)/2, entry (a, b), a ≥ b, in column a(a+1)/2 + b), all sized by the caller. The
  /// result at a point does not depend on the other points.
  virtual void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                        Eigen::Ref<Eigen::VectorXd> value, Eigen::Ref<Eigen::MatrixXd> gradient,
                        Eigen::Ref<Eigen::MatrixXd> hessian) = 0;
};

/// w: R^d → R^r, twice continuously differentiable, with exact first, second and mixed derivatives
/// (Rubio et al. 2019, Eq. 15). Safe to use from several threads.
class ParameterFunctions {
 public:
  virtual ~ParameterFunctions() = default;
  [[nodiscard]] virtual Index dimension() const = 0;  ///< d
  [[nodiscard]] virtual Index count() const = 0;      ///< r
  /// The box on which the functions are known; ±infinity where the model is unbounded. Nothing extrapolates:
  /// points are inside (a rounding error outside counts as on the border).
  [[nodiscard]] virtual Eigen::VectorXd lower() const = 0;
  [[nodiscard]] virtual Eigen::VectorXd upper() const = 0;
  /// Fills `out` (resized by the caller) at `points`, n × d.
  virtual void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                        FunctionBatch& out) const = 0;
  /// Upper bounds of |w_k(p) − centre_k| over the box, r; infinity where none is known, as here by default.
  [[nodiscard]] virtual Eigen::VectorXd magnitude(const Eigen::VectorXd& centre) const;
  /// An evaluator of quadratic forms of these functions. This one calls `evaluate` and serves any functions.
  [[nodiscard]] virtual std::unique_ptr<QuadraticForm> make_quadratic_form() const;
};

}  // namespace knothe::model
