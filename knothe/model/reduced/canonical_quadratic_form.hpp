#pragma once
/// @file Quadratic forms of products of one-variable functions, fast on a tensor grid.
#include <functional>
#include <memory>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/numerics/integrate/grid_evaluator.hpp"

namespace knothe::model {

/// ℓ(p) = constant − ½ |A w(p) + b|² + c·w(p), w_k(p) = Π_i α_k^i(p_i), of one to three parameters. On a grid
/// the α are tabulated axis by axis; what the outer parameters make of A and c is common to a row.
class CanonicalQuadraticForm final : public QuadraticForm, public numerics::GridEvaluator {
 public:
  /// `generic`: evaluates point by point. `axis_values(i, nodes)`: α of axis i at the nodes, n × r.
  using AxisValues = std::function<RowMatrix(Index, const Eigen::Ref<const Eigen::VectorXd>&)>;
  CanonicalQuadraticForm(std::unique_ptr<QuadraticForm> generic, Index dimension, AxisValues axis_values)
      : generic_(std::move(generic)), dimension_(dimension), axis_values_(std::move(axis_values)) {}

  void set(const Eigen::Ref<const Eigen::MatrixXd>& a, const Eigen::Ref<const Eigen::VectorXd>& b,
           const Eigen::Ref<const Eigen::VectorXd>& c, double constant) override;
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                Eigen::Ref<Eigen::VectorXd> value, Eigen::Ref<Eigen::MatrixXd> gradient,
                Eigen::Ref<Eigen::MatrixXd> hessian) override {
    generic_->evaluate(points, derivatives, value, gradient, hessian);
  }
  [[nodiscard]] bool has_grid() const override { return dimension_ <= 3; }
  void set_grid(const Eigen::Ref<const Eigen::MatrixXd>& axes) override;
  void evaluate_runs(std::span<const numerics::GridRun> runs, Eigen::Ref<Eigen::VectorXd> value) override;

 private:
  void set_row(Index row);

  std::unique_ptr<QuadraticForm> generic_;
  Index dimension_;
  AxisValues axis_values_;
  RowMatrix a_;  ///< A and, last, c: (k + 1) × r
  Eigen::VectorXd b_;
  double constant_ = 0;
  std::vector<RowMatrix> outer_;  ///< of each axis but the last: count × r
  RowMatrix last_;                ///< r × count, and eight zeros more
  Index count_ = 0;
  Eigen::VectorXd product_;  ///< of the outer α, r
  RowMatrix of_row_;         ///< A and c times these
};

}  // namespace knothe::model
