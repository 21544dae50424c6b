#pragma once
/// @file The two kinds of parameter functions of a separated model, both made of not-a-knot cubic splines.
#include <span>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/model/reduced/spline_axis.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {

/// Doubles that are worked on together; r is padded to a multiple of it.
inline constexpr Index k_lane_count = 8;

/// The part that both kinds share: axes, box, spline bases.
class SplineFunctions : public ParameterFunctions {
 public:
  [[nodiscard]] Index dimension() const final { return std::ssize(bases_); }
  [[nodiscard]] Index count() const final { return count_; }
  [[nodiscard]] Eigen::VectorXd lower() const final;
  [[nodiscard]] Eigen::VectorXd upper() const final;

 protected:
  /// `nodes`: those of each axis. Errors of the spline (not increasing …) pass on as UsageError.
  SplineFunctions(std::span<const std::vector<double>> nodes, Index count);
  /// The local spline basis of every axis at one point (row `row` of `points`), which is moved into the box,
  /// with derivatives up to this order.
  template <int Derivatives>
  void localise(const Eigen::Ref<const Eigen::MatrixXd>& points, Index row,
                std::span<numerics::CubicSplineBasis::Local> local) const;

  std::vector<numerics::CubicSplineBasis> bases_;
  std::vector<SplineAxis> axes_;  ///< the same, made for finding points
  Index count_;                   ///< r
  Index padded_;                  ///< r rounded up to full lanes
};

/// Canonical form: w_k(p) = Π_i α_k^i(p_i) (Rubio et al. 2019, Eq. 12 and 15).
class CanonicalFunctions final : public SplineFunctions {
 public:
  /// `values[i]`: [r, nᵢ] in C order, α_k^i at the nodes of axis i.
  CanonicalFunctions(std::span<const std::vector<double>> nodes, std::span<const std::vector<double>> values,
                     Index count);
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                FunctionBatch& out) const override;
  [[nodiscard]] std::unique_ptr<QuadraticForm> make_quadratic_form() const override;

 private:
  template <int Derivatives>
  void evaluate_all(const Eigen::Ref<const Eigen::MatrixXd>& points, FunctionBatch& out) const;
  [[nodiscard]] RowMatrix axis_values(std::size_t axis, const Eigen::Ref<const Eigen::VectorXd>& nodes) const;

  /// Per axis: B-spline coefficients [nᵢ + 3, padded r]; the extra rows are zeros that short axes may touch.
  std::vector<std::vector<double>> coefficients_;
};

/// Tree form: w_k(p) = β_k(p), the tensor-product spline through values on the grid. Up to 8 parameters.
class JointFunctions final : public SplineFunctions {
 public:
  /// `values`: [r, n₁, …, n_d] in C order.
  JointFunctions(std::span<const std::vector<double>> nodes, std::span<const double> values, Index count);
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                FunctionBatch& out) const override;
  [[nodiscard]] Eigen::VectorXd magnitude(const Eigen::VectorXd& centre) const override;
  [[nodiscard]] std::unique_ptr<QuadraticForm> make_quadratic_form() const override;

  static constexpr std::size_t k_max_parameters = 8;

 private:
  std::vector<double> coefficients_;     ///< B-spline coefficients [n₁, …, n_d, padded r]
  std::vector<std::ptrdiff_t> strides_;  ///< of the axes in `coefficients_`
};

}  // namespace knothe::model
