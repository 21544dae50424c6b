#pragma once
/// @file What LATIN-PGD needs of the body: its active cells with everything else condensed out (exactly, as
/// in equilibrium_system.hpp), for many states at once.
///
/// A state is u = τ u_lift + v, with τ the imposed displacement, u_lift the elastic solution for a unit one,
/// and v = G f: f elastic forces on the dofs of active cells, G the elastic flexibility between them. In
/// equilibrium f = q, the force that damage takes away.
#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/equilibrium_system.hpp"
#include "knothe/offline/full_order/structure.hpp"
#include "knothe/offline/law/regularisation.hpp"

namespace knothe::offline {

/// The active part. n_a dofs, n_g Gauss points (eight for each cell, in the order in which cells joined).
class LatinBody {
 public:
  /// `regularisation`: none or crack band.
  explicit LatinBody(std::shared_ptr<const Structure> structure,
                     const DamageRegularisationOptions& regularisation = {});

  [[nodiscard]] const Structure& structure() const { return *structure_; }
  [[nodiscard]] Index dof_count() const { return std::ssize(dofs_); }
  [[nodiscard]] Index point_count() const { return k_points_per_cell * cells_.size(); }
  [[nodiscard]] std::span<const std::int64_t> cells() const { return cells_; }
  [[nodiscard]] std::span<const int> dofs() const { return dofs_; }
  /// Cells that can be damaged and are not active.
  [[nodiscard]] const std::vector<std::int64_t>& waiting() const { return waiting_; }

  /// Cells join (none of them active): new dofs and points come after the old ones.
  void join(std::span<const std::int64_t> cells);

  /// G, n_a × n_a.
  [[nodiscard]] const Eigen::MatrixXd& flexibility() const { return flexibility_matrix_; }
  /// Strains of fields on the active dofs (n_a × r): r × 6 n_g, column 6 g + i is component i at point g.
  /// Without the displacement of the load, which only the lift has.
  [[nodiscard]] Eigen::MatrixXd strains(const Eigen::MatrixXd& fields) const;
  /// The same for the unit lift.
  [[nodiscard]] Eigen::RowVectorXd lift_strains() const;
  /// w_g: quadrature weights, m³.
  [[nodiscard]] const Eigen::VectorXd& weights() const { return weights_; }
  /// r of the cell that active point g is in (crack band, else 1).
  [[nodiscard]] double band_ratio(Index g) const { return ratios_[cells_[g / k_points_per_cell]]; }
  [[nodiscard]] std::span<const double> band_ratios() const { return ratios_; }  ///< of all cells

  /// q of many states: `lost` is d C ε, lanes × 6 n_g; lanes × n_a. `reaction` (lanes) gets - u_lift · q over
  /// *all* dofs, the prescribed ones too.
  [[nodiscard]] Eigen::MatrixXd damage_forces(const Eigen::MatrixXd& lost, Eigen::VectorXd& reaction) const;
  /// What takes the out-of-balance forces `residual` away in the linear body whose material has lost
  /// `lost` = ∂(d C ε)/∂ε, one matrix for each point: (G⁻¹ - ∂q/∂v) x = residual, and its elastic force G⁻¹
  /// x. Only the dofs of damaged cells are unknowns: x = G (residual + ∂q/∂v x). False if singular.
  [[nodiscard]] bool correct(std::span<const VoigtMatrix> lost, const Eigen::VectorXd& residual,
                             Eigen::VectorXd& displacement, Eigen::VectorXd& force) const;

  /// Displacement of all dofs of the body for elastic forces on the active dofs: K⁻¹ forces, n_dof × r.
  [[nodiscard]] Eigen::MatrixXd expand(const Eigen::MatrixXd& forces) const;
  /// Strains in `waiting` cells: (r + 1) × 6 · 8 · count, row 0 the unit lift, then K⁻¹ forces.
  [[nodiscard]] Eigen::MatrixXd waiting_strains(const Eigen::MatrixXd& expanded) const;

 private:
  [[nodiscard]] Eigen::MatrixXd strains_of_cells(std::span<const std::int64_t> cells,
                                                 std::span<const int> places,
                                                 const Eigen::MatrixXd& fields) const;

  std::shared_ptr<const Structure> structure_;
  Flexibility flexibility_;
  std::vector<double> ratios_;
  std::vector<std::int64_t> cells_, waiting_;
  std::vector<int> dofs_;    ///< active dofs, in the order in which they joined
  std::vector<int> place_;   ///< of each dof of the body among the active ones, or -1
  std::vector<int> places_;  ///< [active cell][24]
  Eigen::MatrixXd flexibility_matrix_;
  Eigen::VectorXd weights_;
};

}  // namespace knothe::offline
