#pragma once
/// @file Interpolating cubic splines in one variable, in two forms: as a function, and as a basis.
///
/// n ≥ 4 nodes give the not-a-knot cubic spline (third derivative continuous at the second and the last but
/// one node), n = 3 the parabola, n = 2 the straight line. Outside the nodes the border polynomial continues.
/// Source: C. de Boor, A Practical Guide to Splines, 2001, ch. IV, IX and X.
#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// The B-splines B_0 … B_{n−1} in whose span the interpolants through n nodes lie: s(x) = Σ_i c_i B_i(x). At
/// any x at most four of them are not zero, so that a tensor product in d variables needs 4^d terms.
class CubicSplineBasis {
 public:
  /// The functions that are not zero at a point, and their derivatives there. For n < 4 the last ones are
  /// zero.
  struct Local {
    Index first;                              ///< B_first … B_{first+3}; first + active() ≤ n
    std::array<double, 4> value;              ///< B
    std::array<double, 4> first_derivative;   ///< B'
    std::array<double, 4> second_derivative;  ///< B''
  };

  /// `nodes`: at least two, strictly increasing, finite. Errors: UsageError.
  explicit CubicSplineBasis(std::span<const double> nodes);

  [[nodiscard]] Index size() const { return std::ssize(nodes_); }  ///< n
  [[nodiscard]] std::span<const double> nodes() const { return nodes_; }
  /// Number of functions that may differ from zero at a point: min(n, 4).
  [[nodiscard]] int active() const { return degree_ + 1; }

  [[nodiscard]] Local evaluate(double x) const;

  /// Ends of the polynomial pieces, increasing; piece j is [breaks[j], breaks[j + 1]], where B_j … B_{j+3}
  /// act.
  [[nodiscard]] std::span<const double> breaks() const { return breaks_; }
  /// Per piece: the coefficient of (x − left end)^power in each of its functions, at [power][function].
  [[nodiscard]] std::span<const std::array<std::array<double, 4>, 4>> pieces() const { return pieces_; }

  /// The n × n matrix A⁻¹ with c = A⁻¹ y for the values y at the nodes. For a tensor grid apply it along each
  /// axis.
  [[nodiscard]] const Eigen::MatrixXd& coefficients_from_values() const { return from_values_; }

  /// Cardinal weights: s(x) = Σ_i `weights`[i] y_i, or its first or second derivative (`derivative` 0, 1, 2).
  [[nodiscard]] Eigen::VectorXd cardinal_weights(double x, int derivative = 0) const;

 private:
  [[nodiscard]] std::size_t interval_of(double x) const;

  std::vector<double> nodes_;
  std::vector<double> breaks_;  ///< ends of the polynomial pieces: the nodes without second and last but one
  double inverse_mean_width_ = 0;
  int degree_;
  /// Per piece: coefficient of s^power of each active function, s = x − left end, at [power][function].
  std::vector<std::array<std::array<double, 4>, 4>> pieces_;
  Eigen::MatrixXd from_values_;
};

/// The interpolating spline through (nodes, values).
class CubicSpline {
 public:
  /// Errors: UsageError for nodes as above, for another number of values than nodes, for values that are not
  /// finite.
  CubicSpline(std::span<const double> nodes, std::span<const double> values);

  [[nodiscard]] double value(double x) const { return evaluate(x)[0]; }
  [[nodiscard]] double derivative(double x) const { return evaluate(x)[1]; }
  [[nodiscard]] double second_derivative(double x) const { return evaluate(x)[2]; }
  /// s, s', s'' at x.
  [[nodiscard]] std::array<double, 3> evaluate(double x) const;
  /// Left end of each polynomial piece and its coefficients: Σ_k c[k] (x − left)^k.
  struct Piece {
    double left;
    std::array<double, 4> coefficient;
  };
  [[nodiscard]] std::span<const Piece> pieces() const { return pieces_; }

 private:
  std::vector<Piece> pieces_;
};

}  // namespace knothe::numerics
