#pragma once
/// @file The elastic body: degrees of freedom, supports, stiffness, its factor, and the elastic solution of
/// the load.
#include <memory>
#include <span>
#include <vector>

#include "knothe/offline/full_order/finite_elements.hpp"
#include "knothe/offline/full_order/sparse_solvers.hpp"
#include "knothe/offline/law/damage_law.hpp"
#include "knothe/offline/law/element_kernels.hpp"
#include "knothe/offline/mesh/hexahedron_mesh.hpp"

namespace knothe::offline {

/// Degree of freedom 3 n + c is component c (0 x, 1 y, 2 z) of node n. Immutable after construction.
class Structure {
 public:
  /// `source` names the mesh in messages. Errors: DataError (mesh), ProjectError (constants), NumericalError
  /// (supports).
  Structure(HexahedronMesh mesh, const ElasticConstants& elastic, const std::string& source);

  [[nodiscard]] const HexahedronMesh& mesh() const { return mesh_; }
  [[nodiscard]] const ElasticConstants& elastic() const { return elastic_; }
  [[nodiscard]] const FiniteElements& elements() const { return elements_; }
  [[nodiscard]] int dof_count() const { return free_index_.size(); }
  [[nodiscard]] int free_count() const { return free_dofs_.size(); }
  /// Number of a dof among the free ones, or -1 if it is prescribed.
  [[nodiscard]] int free_index(int dof) const { return free_index_[dof]; }
  [[nodiscard]] std::span<const int> free_dofs() const { return free_dofs_; }
  /// The 24 dofs of a cell, component by component.
  [[nodiscard]] std::array<int, k_cell_dofs> cell_dofs(std::int64_t cell) const;
  [[nodiscard]] CellVector gather(std::span<const double> displacement, std::int64_t cell) const;

  /// Elastic stiffness of all dofs, N/m (half body).
  [[nodiscard]] const SparseMatrix& stiffness() const { return stiffness_; }
  /// Elastic stiffness of the free dofs and its factor.
  [[nodiscard]] const SparseMatrix& free_stiffness() const { return free_stiffness_; }
  [[nodiscard]] const SymmetricFactor& factor() const { return *factor_; }
  /// Prescribed values for a unit imposed displacement: -1 at the load's u_y, 0 elsewhere; n_dof.
  [[nodiscard]] std::span<const double> unit_prescribed() const { return unit_prescribed_; }
  /// Elastic solution for a unit imposed displacement, n_dof.
  [[nodiscard]] std::span<const double> unit_lift() const { return unit_lift_; }
  /// Reaction of the half body to a unit imposed displacement while elastic, N/m.
  [[nodiscard]] double unit_reaction() const { return unit_reaction_; }

 private:
  void number_dofs();
  void assemble();
  void solve_lift();

  HexahedronMesh mesh_;
  ElasticConstants elastic_;
  FiniteElements elements_;
  std::vector<int> free_index_, free_dofs_;
  std::vector<double> unit_prescribed_, unit_lift_;
  double unit_reaction_ = 0;
  SparseMatrix stiffness_, free_stiffness_;
  std::unique_ptr<SymmetricFactor> factor_;
};

}  // namespace knothe::offline
