#include "knothe/offline/full_order/structure.hpp"

#include <numeric>

namespace knothe::offline {

Structure::Structure(HexahedronMesh mesh, const ElasticConstants& elastic, const std::string& source)
    : mesh_(std::move(mesh)), elastic_(elastic) {
  elastic_.validate();
  validate(mesh_, source);
  elements_ = evaluate_finite_elements(mesh_.points, mesh_.cells);
  number_dofs();
  assemble();
  factor_ = std::make_unique<SymmetricFactor>(free_stiffness_);
  solve_lift();
}

std::array<int, k_cell_dofs> Structure::cell_dofs(std::int64_t cell) const {
  std::array<int, k_cell_dofs> dofs;
  for (int c = 0; c < 3; ++c)
    for (int a = 0; a < 8; ++a) dofs[8 * c + a] = 3 * mesh_.cells[8 * cell + a] + c;
  return dofs;
}

CellVector Structure::gather(std::span<const double> displacement, std::int64_t cell) const {
  CellVector result;
  for (int c = 0; c < 3; ++c)
    for (int a = 0; a < 8; ++a) result[8 * c + a] = displacement[3 * mesh_.cells[8 * cell + a] + c];
  return result;
}

void Structure::number_dofs() {
  const std::size_t dofs = 3 * mesh_.node_count();
  free_index_.assign(dofs, 0);
  unit_prescribed_.assign(dofs, 0.0);
  const auto hold = [&](const NodeSet& nodes, int component) {
    for (const auto node : nodes) free_index_[3 * node + component] = -1;
  };
  if (mesh_.support_stiffness == 0) {
    hold(mesh_.support_left, 1);
    hold(mesh_.support_right, 1);
  }
  hold(mesh_.left_support == LeftSupport::left_face ? mesh_.left_face : mesh_.support_left, 0);
  hold(mesh_.symmetry, 2);
  hold(mesh_.load, 1);
  for (const auto node : mesh_.load) unit_prescribed_[3 * node + 1] = -1.0;
  for (std::size_t dof = 0; dof < dofs; ++dof)
    if (free_index_[dof] == 0) {
      free_index_[dof] = free_dofs_.size();
      free_dofs_.push_back(dof);
    }
}

void Structure::assemble() {
  const VoigtMatrix material = elastic_matrix(elastic_);
  std::vector<int> all, free;
  for (std::int64_t cell = 0; cell < mesh_.cell_count(); ++cell)
    for (const int dof : cell_dofs(cell)) {
      all.push_back(dof);
      free.push_back(free_index_[dof]);
    }
  stiffness_ = coupling_pattern(dof_count(), all, k_cell_dofs);
  free_stiffness_ = coupling_pattern(free_count(), free, k_cell_dofs);
  for (std::int64_t cell = 0; cell < mesh_.cell_count(); ++cell) {
    CellMatrix matrix{};
    for (int point = 0; point < k_points_per_cell; ++point)
      add_stiffness(elements_.gradient(cell, point), material, elements_.weight(cell, point), matrix);
    const int *dofs = &all[24 * cell], *places = &free[24 * cell];
    for (int i = 0; i < k_cell_dofs; ++i)
      for (int j = 0; j < k_cell_dofs; ++j) {
        const double value = matrix[k_cell_dofs * i + j];
        stiffness_.value[stiffness_.position(dofs[i], dofs[j])] += value;
        if (places[i] >= 0 && places[j] >= 0)
          free_stiffness_.value[free_stiffness_.position(places[i], places[j])] += value;
      }
  }
  // Springs to the ground belong to the elastic body: their forces and energy are in K u and ½ uᵀ K u.
  if (mesh_.support_stiffness == 0) return;
  for (const NodeSet* support : {&mesh_.support_left, &mesh_.support_right})
    for (const auto node : *support) {
      const int dof = 3 * node + 1, place = free_index_[dof];
      const double share = mesh_.support_stiffness / support->size();
      stiffness_.value[stiffness_.position(dof, dof)] += share;
      if (place >= 0) free_stiffness_.value[free_stiffness_.position(place, place)] += share;
    }
}

void Structure::solve_lift() {
  std::vector<double> force(dof_count()), right(free_count());
  stiffness_.multiply(unit_prescribed_, force);
  for (int i = 0; i < free_count(); ++i) right[i] = -force[free_dofs_[i]];
  factor_->solve(right);
  unit_lift_ = unit_prescribed_;
  for (int i = 0; i < free_count(); ++i) unit_lift_[free_dofs_[i]] = right[i];
  stiffness_.multiply(unit_lift_, force);
  unit_reaction_ = std::inner_product(force.begin(), force.end(), unit_prescribed_.begin(), 0.0);
}

}  // namespace knothe::offline
