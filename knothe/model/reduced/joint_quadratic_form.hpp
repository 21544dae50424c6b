#pragma once
/// @file Quadratic forms of the functions of a tensor grid, at a cost that does not depend on their number.
#include <array>
#include <span>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/model/reduced/spline_axis.hpp"
#include "knothe/numerics/integrate/grid_evaluator.hpp"

namespace knothe::model {

/// ℓ(p) = constant − ½ |s(p)|² + q(p), where s = A w + b and q = c·w are tensor splines themselves: the table
/// of B-spline coefficients is transformed once per form.
///
/// For up to three parameters ℓ is, on each cell of the grid, a polynomial of degree 6 in each of them: it is
/// multiplied out when a point first falls into the cell. Its rounding error is that of the largest term in
/// the cell; where this could be felt (see `k_largest_polynomial`), for values alone with three parameters,
/// and for four, s is evaluated and squared. On a grid of two or three parameters the polynomials, or the
/// splines s, are contracted to those of one variable per row and cell.
class JointQuadraticForm final : public QuadraticForm, public numerics::GridEvaluator {
 public:
  static constexpr std::size_t k_max_parameters = 4;

  /// `coefficients`: B-spline coefficients of w, [n₁, …, n_d, padded r]; `strides` of its axes. Neither is
  /// copied.
  JointQuadraticForm(std::span<const numerics::CubicSplineBasis> bases, std::span<const double> coefficients,
                     std::span<const std::ptrdiff_t> strides, Index count);
  void set(const Eigen::Ref<const Eigen::MatrixXd>& a, const Eigen::Ref<const Eigen::VectorXd>& b,
           const Eigen::Ref<const Eigen::VectorXd>& c, double constant) override;
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                Eigen::Ref<Eigen::VectorXd> value, Eigen::Ref<Eigen::MatrixXd> gradient,
                Eigen::Ref<Eigen::MatrixXd> hessian) override;
  /// With two and three parameters.
  [[nodiscard]] bool has_grid() const override { return axes_.size() == 2 || axes_.size() == 3; }
  void set_grid(const Eigen::Ref<const Eigen::MatrixXd>& axes) override;
  void evaluate_runs(std::span<const numerics::GridRun> runs, Eigen::Ref<Eigen::VectorXd> value) override;

 private:
  static constexpr Index k_unknown = -1, k_squares = -2;  ///< of a cell, instead of where its polynomial is
  /// One point's ℓ − constant, gradient and packed Hessian.
  template <std::size_t D>
  struct Result {
    double value;
    std::array<double, D> gradient;
    std::array<double, D*(D + 1) / 2> hessian;
  };
  struct Output {
    double* value;
    double* gradient;
    Index gradient_stride;
    double* hessian;
    Index hessian_stride;
  };

  template <std::size_t D>
  void evaluate_in(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives, const Output& out);
  template <std::size_t D, int Derivatives>
  void evaluate_all(const Eigen::Ref<const Eigen::MatrixXd>& points, const Output& out);
  template <std::size_t D, int Derivatives>
  void sum_squares(const std::array<SplineAxis::Place, D>& place, Result<D>& result) const;
  template <std::size_t D, int Derivatives>
  void evaluate_polynomial(const double* c, const std::array<SplineAxis::Place, D>& place,
                           Result<D>& result) const;
  template <std::size_t D>
  void sum_squares_in_line(const std::array<SplineAxis::Place, D>& place, const double* t, Index n,
                           double* value);
  template <std::size_t D>
  void evaluate_run(const numerics::GridRun& run, double* value);
  /// The polynomial of the cell where `place` is, coefficients of t₁^p … t_d^q at [7, …, 8], the last of 8
  /// zero; null where squares are to be summed.
  template <std::size_t D>
  const double* polynomial_at(const std::array<SplineAxis::Place, D>& place);
  template <std::size_t D>
  Index multiply_out(const std::array<SplineAxis::Place, D>& place);

  std::vector<SplineAxis> axes_;
  std::span<const double> coefficients_;  ///< of w
  Index grid_, count_, source_stride_;

  double constant_ = 0;
  Index padded_ = 0;             ///< k, or k + 1 with q, rounded up to full lanes
  Eigen::MatrixXd combination_;  ///< r × (k + 1): Aᵀ and c
  std::vector<double> table_;    ///< B-spline coefficients of s and q, [n₁, …, n_d, padded]
  std::array<std::ptrdiff_t, k_max_parameters> grid_strides_{}, strides_{};
  std::vector<double> square_, linear_;  ///< per function: −½ and 0 for s, 0 and 1 for q, 0 and 0 for padding
  std::vector<double> polynomial_;       ///< of the cells that points fell into
  std::vector<Index> cell_;              ///< where the polynomial of each begins
  bool multiplies_out_ = true;           ///< on the grid
  std::vector<double> line_;             ///< of one row in one cell: s in the powers of t, [4, padded]
  std::vector<std::vector<SplineAxis::Place>> places_;  ///< of the grid's nodes, but on the last axis:
  std::vector<double> along_;                           ///< t of each node there
  std::vector<std::size_t> piece_;
};

}  // namespace knothe::model
