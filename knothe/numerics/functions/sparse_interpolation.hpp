#pragma once
/// @file Polynomial interpolation of few degrees in many variables, one node for each degree.
#include <Eigen/Core>
#include <map>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// A degree for each variable.
using MultiIndex = std::vector<int>;

/// The first `count` nodes of the Leja sequence 0, 1, −1, … on [−1, 1]: each is where the product of its
/// distances to the nodes before it is largest; of two such places the larger one.
[[nodiscard]] std::vector<double> leja_nodes(int count);

/// Interpolation on a box by the polynomials p^ν, ν ∈ Λ, where Λ has with every ν all that are smaller in
/// every variable. Each ν has one node, (x_ν1, …, x_νd) with Leja's x: so a function of these degrees is met
/// exactly by as many values as it has coefficients (A. Chkifa, A. Cohen, C. Schwab, Found. Comput. Math. 14,
/// 2014). In Newton's form
///
///   u(p) = Σ_ν s_ν Π_i H_νi(p_i),   H_k(x) = Π_{j<k} (x − x_j)/(x_k − x_j),
///
/// the surplus s_ν is how far the value at node ν is from the interpolation before it: later indices do not
/// change it.
class SparseInterpolation {
 public:
  /// UsageError unless the box is finite and not empty.
  SparseInterpolation(Eigen::VectorXd lower, Eigen::VectorXd upper);

  [[nodiscard]] Index dimension() const { return lower_.size(); }                    ///< d
  [[nodiscard]] Index count() const { return std::ssize(indices_); }                 ///< |Λ|
  [[nodiscard]] const std::vector<MultiIndex>& indices() const { return indices_; }  ///< as added
  [[nodiscard]] bool contains(const MultiIndex& index) const { return place_.count(index) > 0; }
  /// UsageError for an index that is there, or one without all that are smaller by one in one variable.
  void add(const MultiIndex& index);
  /// Node of an index, in the box.
  [[nodiscard]] Eigen::VectorXd node(const MultiIndex& index) const;

  /// H_ν(p), |Λ|.
  [[nodiscard]] Eigen::VectorXd basis(const Eigen::VectorXd& p) const;
  /// ∂H_ν/∂p_i, |Λ| × d.
  [[nodiscard]] Eigen::MatrixXd basis_gradient(const Eigen::VectorXd& p) const;
  /// H_k(x), k = 0 … `degree`, of variable `i`.
  [[nodiscard]] Eigen::VectorXd factors(Index i, double x, int degree) const;
  /// Largest degree in variable `i`.
  [[nodiscard]] int degree(Index i) const { return degree_[i]; }

  /// s_ν from the values at the nodes in their order, |Λ| × any number of functions. The first rows are those
  /// of a part of the values.
  [[nodiscard]] Eigen::MatrixXd surpluses(const Eigen::MatrixXd& values) const;

 private:
  /// H_k and its derivative in p_i, in two columns.
  [[nodiscard]] Eigen::MatrixXd factors_with_slope(Index i, double x) const;

  Eigen::VectorXd lower_, upper_;
  std::vector<double> nodes_;  ///< on [−1, 1], as many as the largest degree needs
  std::vector<MultiIndex> indices_;
  std::map<MultiIndex, Index> place_;
  std::vector<int> degree_;
  Eigen::MatrixXd triangle_;  ///< H_μ(node ν) at [ν, μ], with room for more: unit lower triangular
};

}  // namespace knothe::numerics
