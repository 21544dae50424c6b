#pragma once
/// @file u − u_lift of snapshots as a matrix with quadrature weights. Private to this room.
#include <Eigen/Core>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/snapshots.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"

namespace knothe::model {

/// Trapezoid weights of increasing nodes, sum 1; 1 for a single node.
[[nodiscard]] Eigen::VectorXd trapezoid_weights(std::span<const double> nodes);

/// Access to the deviation block by block; nothing of the size of the snapshots is copied.
class Deviation {
 public:
  explicit Deviation(const Snapshots& snapshots);

  [[nodiscard]] Index grid() const { return grid_weights_.size(); }   ///< P = Π nᵢ
  [[nodiscard]] Index times() const { return time_weights_.size(); }  ///< n_t
  [[nodiscard]] Index dofs() const { return lift_.rows(); }           ///< n_dof
  [[nodiscard]] const Eigen::VectorXd& grid_weights() const { return grid_weights_; }
  [[nodiscard]] const Eigen::VectorXd& time_weights() const { return time_weights_; }
  [[nodiscard]] const Eigen::MatrixXd& lift() const { return lift_; }  ///< n_dof × n_t

  /// u − u_lift at time `t`: P × n_dof.
  [[nodiscard]] RowMatrix at_time(Index t) const { return at_time(t, 0, grid()); }
  /// G = Σ_t w_t ⟨·,·⟩ between grid points, P × P.
  [[nodiscard]] Eigen::MatrixXd grid_gram(std::size_t threads) const;
  /// Σ_t √w_t (u − u_lift)(·, t, p) B_t, where the rows of B are (t, dof): P × columns of B.
  [[nodiscard]] Eigen::MatrixXd applied(const Eigen::MatrixXd& b, std::size_t threads) const;
  /// Columns √w_t Σ_p (u − u_lift)(·, t, p) V_pk at t · r + k: n_dof × (n_t r).
  [[nodiscard]] Eigen::MatrixXd projected(const Eigen::MatrixXd& v, std::size_t threads) const;

 private:
  [[nodiscard]] RowMatrix at_time(Index t, Index first, Index count) const;

  const Snapshots& snapshots_;
  Eigen::VectorXd grid_weights_, time_weights_;
  Eigen::MatrixXd lift_;
};

}  // namespace knothe::model
