#include "knothe/offline/latin/latin_body.hpp"

#include <algorithm>
#include <array>

#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/dense_solvers.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;
using Eigen::VectorXd;

LatinBody::LatinBody(std::shared_ptr<const Structure> structure,
                     const DamageRegularisationOptions& regularisation)
    : structure_(std::move(structure)),
      flexibility_(*structure_),
      ratios_(offline::band_ratios(structure_->mesh(), structure_->elements(), regularisation)),
      place_(structure_->dof_count(), -1) {
  const auto& mesh = structure_->mesh();
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell)
    if (mesh.elastic[cell] == 0) waiting_.push_back(cell);
}

void LatinBody::join(std::span<const std::int64_t> cells) {
  for (const std::int64_t cell : cells) {
    cells_.push_back(cell);
    std::erase(waiting_, cell);
    for (const int dof : structure_->cell_dofs(cell)) {
      if (structure_->free_index(dof) >= 0 && place_[dof] < 0) {
        place_[dof] = dofs_.size();
        dofs_.push_back(dof);
      }
      places_.push_back(place_[dof]);
    }
  }
  // G is symmetric: the new columns hold the new rows of the old ones, so each is wanted once. At 100,000
  // dofs all of them, for all dofs that may ever be active, would be gigabytes.
  const Index known = flexibility_matrix_.rows(), n = dof_count();
  flexibility_matrix_.conservativeResize(n, n);
  for (Index j = known; j < n; ++j) {
    const int place = flexibility_.place(dofs_[j]);
    const auto column = flexibility_.column(place);
    for (Index i = 0; i <= j; ++i)
      flexibility_matrix_(i, j) = flexibility_matrix_(j, i) = column[flexibility_.place(dofs_[i])];
    flexibility_.release(place);
  }
  weights_.resize(point_count());
  for (Index c = 0; c < std::ssize(cells_); ++c)
    for (int point = 0; point < k_points_per_cell; ++point)
      weights_[c * k_points_per_cell + point] = structure_->elements().weight(cells_[c], point);
}

MatrixXd LatinBody::strains_of_cells(std::span<const std::int64_t> cells, std::span<const int> places,
                                     const MatrixXd& fields) const {
  const Index r = fields.cols();
  MatrixXd result(r, 6 * k_points_per_cell * std::ssize(cells));
  for (Index c = 0; c < std::ssize(cells); ++c)
    for (Index k = 0; k < r; ++k) {
      CellVector u;
      for (int i = 0; i < k_cell_dofs; ++i) {
        const int place = places[k_cell_dofs * c + i];
        u[i] = place >= 0 ? fields(place, k) : 0.0;
      }
      for (int point = 0; point < k_points_per_cell; ++point) {
        const Voigt strain = strain_at(structure_->elements().gradient(cells[c], point), u);
        for (int i = 0; i < 6; ++i) result(k, 6 * (c * k_points_per_cell + point) + i) = strain[i];
      }
    }
  return result;
}

MatrixXd LatinBody::strains(const MatrixXd& fields) const {
  return strains_of_cells(cells_, places_, fields);
}

Eigen::RowVectorXd LatinBody::lift_strains() const {
  std::vector<int> places;
  for (const auto cell : cells_)
    for (const int dof : structure_->cell_dofs(cell)) places.push_back(dof);
  const auto lift = structure_->unit_lift();
  return strains_of_cells(cells_, places, Eigen::Map<const VectorXd>(lift.data(), structure_->dof_count()))
      .row(0);
}

MatrixXd LatinBody::damage_forces(const MatrixXd& lost, VectorXd& reaction) const {
  const Index lanes = lost.rows();
  MatrixXd forces = MatrixXd::Zero(lanes, dof_count());
  reaction.setZero(lanes);
  MatrixXd cell_force(lanes, k_cell_dofs);
  // Component i of the force of node a: Σ_j σ_ij ∂N_a/∂x_j.
  constexpr int k_voigt[3][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}};
  for (Index c = 0; c < std::ssize(cells_); ++c) {
    const Index first = 6 * k_points_per_cell * c;
    if (lost.middleCols(first, 6 * k_points_per_cell).isZero(0.0)) continue;
    cell_force.setZero();
    for (int point = 0; point < k_points_per_cell; ++point) {
      const double* gradient = structure_->elements().gradient(cells_[c], point);
      const double weight = structure_->elements().weight(cells_[c], point);
      const auto stress = lost.middleCols(first + 6 * point, 6);
      for (int i = 0; i < 3; ++i)
        for (int a = 0; a < 8; ++a)
          cell_force.col(8 * i + a) += (weight * gradient[a]) * stress.col(k_voigt[i][0]) +
                                       (weight * gradient[8 + a]) * stress.col(k_voigt[i][1]) +
                                       (weight * gradient[16 + a]) * stress.col(k_voigt[i][2]);
    }
    const auto dofs = structure_->cell_dofs(cells_[c]);
    for (int i = 0; i < k_cell_dofs; ++i) {
      const int place = places_[k_cell_dofs * c + i];
      if (place >= 0) forces.col(place) += cell_force.col(i);
      reaction -= structure_->unit_lift()[dofs[i]] * cell_force.col(i);
    }
  }
  return forces;
}

bool LatinBody::correct(std::span<const VoigtMatrix> lost, const VectorXd& residual, VectorXd& displacement,
                        VectorXd& force) const {
  // Cell matrices of ∂q/∂v, and the dofs they touch.
  std::vector<CellMatrix> matrices;
  std::vector<std::size_t> damaged;
  std::vector<int> unknown(dofs_.size(), -1), touched;
  for (Index c = 0; c < std::ssize(cells_); ++c) {
    CellMatrix matrix{};
    bool any = false;
    for (int point = 0; point < k_points_per_cell; ++point) {
      const VoigtMatrix& material = lost[k_points_per_cell * c + point];
      if (std::all_of(material.begin(), material.end(), [](double value) { return value == 0; })) continue;
      any = true;
      add_stiffness(structure_->elements().gradient(cells_[c], point), material,
                    structure_->elements().weight(cells_[c], point), matrix);
    }
    if (!any) continue;
    matrices.push_back(matrix);
    damaged.push_back(c);
    for (int i = 0; i < k_cell_dofs; ++i) {
      const int place = places_[k_cell_dofs * c + i];
      if (place < 0 || unknown[place] >= 0) continue;
      unknown[place] = touched.size();
      touched.push_back(place);
    }
  }
  // I − G ∂q/∂v cell by cell: ∂q/∂v is sparse, and a dense product would cost three times the factorisation.
  const auto n = std::ssize(touched);
  const VectorXd elastic = flexibility_matrix_ * residual;
  MatrixXd flexibility(n, n), matrix = MatrixXd::Identity(n, n), columns(n, k_cell_dofs);
  VectorXd x(n);
  for (Index j = 0; j < n; ++j) {
    x[j] = elastic[touched[j]];
    const auto column = flexibility_matrix_.col(touched[j]);
    for (Index i = 0; i < n; ++i) flexibility(i, j) = column[touched[i]];
  }
  const auto unknowns_of = [&](std::size_t k) {
    std::array<int, k_cell_dofs> result{};
    for (Index i = 0; i < std::ssize(result); ++i) {
      const int place = places_[k_cell_dofs * damaged[k] + i];
      result[i] = place >= 0 ? unknown[place] : -1;
    }
    return result;
  };
  for (Index k = 0; k < std::ssize(damaged); ++k) {
    const auto unknowns = unknowns_of(k);
    for (int i = 0; i < k_cell_dofs; ++i) {
      if (unknowns[i] >= 0)
        columns.col(i) = flexibility.col(unknowns[i]);
      else
        columns.col(i).setZero();
    }
    const Eigen::Map<const Eigen::Matrix<double, k_cell_dofs, k_cell_dofs, Eigen::RowMajor>> cell(
        matrices[k].data());
    const MatrixXd product = columns * cell;
    for (int j = 0; j < k_cell_dofs; ++j)
      if (unknowns[j] >= 0) matrix.col(unknowns[j]) -= product.col(j);
  }
  if (!solve_dense(std::span(matrix.data(), n * n), std::span(x.data(), n))) return false;
  force = residual;
  for (Index k = 0; k < std::ssize(damaged); ++k) {
    const auto unknowns = unknowns_of(k);
    for (int i = 0; i < k_cell_dofs; ++i) {
      const int row = unknowns[i];
      if (row < 0) continue;
      double sum = 0;
      for (int j = 0; j < k_cell_dofs; ++j)
        if (unknowns[j] >= 0) sum += matrices[k][k_cell_dofs * i + j] * x[unknowns[j]];
      force[touched[row]] += sum;
    }
  }
  displacement = flexibility_matrix_ * force;
  return displacement.allFinite();
}

MatrixXd LatinBody::expand(const MatrixXd& forces) const {
  const Index free = structure_->free_count(), r = forces.cols();
  MatrixXd right = MatrixXd::Zero(free, r);
  for (Index i = 0; i < dof_count(); ++i) right.row(structure_->free_index(dofs_[i])) = forces.row(i);
  if (r > 0) structure_->factor().solve(std::span(right.data(), free * r), r);
  MatrixXd result = MatrixXd::Zero(structure_->dof_count(), r);
  for (Index i = 0; i < free; ++i) result.row(structure_->free_dofs()[i]) = right.row(i);
  return result;
}

MatrixXd LatinBody::waiting_strains(const MatrixXd& expanded) const {
  MatrixXd fields(structure_->dof_count(), expanded.cols() + 1);
  fields.col(0) = Eigen::Map<const VectorXd>(structure_->unit_lift().data(), structure_->dof_count());
  fields.rightCols(expanded.cols()) = expanded;
  std::vector<int> places;
  for (const auto cell : waiting_)
    for (const int dof : structure_->cell_dofs(cell)) places.push_back(dof);
  return strains_of_cells(waiting_, places, fields);
}

}  // namespace knothe::offline
