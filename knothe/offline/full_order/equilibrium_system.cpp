#include "knothe/offline/full_order/equilibrium_system.hpp"

#include <algorithm>
#include <tuple>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/dense_solvers.hpp"

namespace knothe::offline {
namespace {

class UncondensedSystem final : public EquilibriumSystem {
 public:
  explicit UncondensedSystem(const Structure& structure)
      : structure_(structure),
        tangent_(structure.free_stiffness()),
        solver_(tangent_),
        displacement_(structure.dof_count()),
        force_(structure.dof_count()) {}

  void set_active(std::span<const std::int64_t> cells) override {
    places_.clear();
    for (const auto cell : cells)
      for (const int dof : structure_.cell_dofs(cell)) places_.push_back(structure_.free_index(dof));
  }
  std::span<const int> unknown_dofs() const override { return structure_.free_dofs(); }
  std::span<const int> places() const override { return places_; }

  void residual(double imposed, std::span<const double> v, std::span<const double> force,
                std::span<double> r) override {
    expand(imposed, v, force, displacement_);
    structure_.stiffness().multiply(displacement_, force_);
    for (Index i = 0; i < std::ssize(r); ++i) r[i] = force_[structure_.free_dofs()[i]] - force[i];
  }

  bool solve(std::span<const CellMatrix> matrices, std::span<const double> r, std::span<double> x) override {
    tangent_.value = structure_.free_stiffness().value;
    for (Index cell = 0; cell < std::ssize(matrices); ++cell) {
      const int* places = &places_[k_cell_dofs * cell];
      for (int i = 0; i < k_cell_dofs; ++i)
        for (int j = 0; j < k_cell_dofs; ++j)
          if (places[i] >= 0 && places[j] >= 0)
            tangent_.value[tangent_.position(places[i], places[j])] -= matrices[cell][k_cell_dofs * i + j];
    }
    return solver_.solve(tangent_, r, x);
  }

  void expand(double imposed, std::span<const double> v, std::span<const double>,
              std::span<double> displacement) override {
    for (int dof = 0; dof < structure_.dof_count(); ++dof) {
      const int free = structure_.free_index(dof);
      displacement[dof] = free >= 0 ? v[free] : imposed * structure_.unit_prescribed()[dof];
    }
  }

 private:
  const Structure& structure_;
  SparseMatrix tangent_;
  UnsymmetricSolver solver_;
  std::vector<int> places_;
  std::vector<double> displacement_, force_;
};

class CondensedSystem final : public EquilibriumSystem {
 public:
  CondensedSystem(const Structure& structure, Flexibility& flexibility)
      : structure_(structure), flexibility_(flexibility) {}

  void set_active(std::span<const std::int64_t> cells) override {
    // Unknowns in the flexibility's order.
    std::vector<int> wanted;
    for (const auto cell : cells)
      for (const int dof : structure_.cell_dofs(cell))
        if (structure_.free_index(dof) >= 0) wanted.push_back(flexibility_.place(dof));
    std::sort(wanted.begin(), wanted.end());
    wanted.erase(std::unique(wanted.begin(), wanted.end()), wanted.end());
    dofs_.clear();
    lift_.clear();
    std::vector<int> unknown_of_dof(structure_.dof_count(), -1);
    for (const int place : wanted) {
      const int dof = flexibility_.dof(place);
      unknown_of_dof[dof] = dofs_.size();
      dofs_.push_back(dof);
      lift_.push_back(structure_.unit_lift()[dof]);
    }
    places_.clear();
    for (const auto cell : cells)
      for (const int dof : structure_.cell_dofs(cell)) places_.push_back(unknown_of_dof[dof]);

    const std::size_t n = wanted.size();
    schur_.resize(n * n);
    for (std::size_t j = 0; j < n; ++j) {
      const auto column = flexibility_.column(wanted[j]);
      for (std::size_t i = 0; i < n; ++i) schur_[j * n + i] = column[wanted[i]];
    }
    if (!invert_positive_definite(schur_, n))
      throw NumericalError(
          "the condensed elastic stiffness is not positive definite: the mesh is too ill-conditioned "
          "for static condensation");
    tangent_.resize(n * n);
    difference_.resize(n);
  }
  std::span<const int> unknown_dofs() const override { return dofs_; }
  std::span<const int> places() const override { return places_; }

  void residual(double imposed, std::span<const double> v, std::span<const double> force,
                std::span<double> r) override {
    for (Index i = 0; i < std::ssize(v); ++i) difference_[i] = v[i] - imposed * lift_[i];
    multiply_symmetric(schur_, difference_, r);
    for (Index i = 0; i < std::ssize(v); ++i) r[i] -= force[i];
  }

  bool solve(std::span<const CellMatrix> matrices, std::span<const double> r, std::span<double> x) override {
    const std::size_t n = dofs_.size();
    std::copy(schur_.begin(), schur_.end(), tangent_.begin());
    for (Index cell = 0; cell < std::ssize(matrices); ++cell) {
      const int* places = &places_[k_cell_dofs * cell];
      for (int j = 0; j < k_cell_dofs; ++j) {
        if (places[j] < 0) continue;
        double* column = &tangent_[places[j] * n];
        for (int i = 0; i < k_cell_dofs; ++i)
          if (places[i] >= 0) column[places[i]] -= matrices[cell][k_cell_dofs * i + j];
      }
    }
    std::copy(r.begin(), r.end(), x.begin());
    return solve_dense(tangent_, x);
  }

  void expand(double imposed, std::span<const double>, std::span<const double> force,
              std::span<double> displacement) override {
    std::vector<double> right(structure_.free_count(), 0.0);
    for (Index i = 0; i < std::ssize(dofs_); ++i) right[structure_.free_index(dofs_[i])] = force[i];
    structure_.factor().solve(right);
    for (int dof = 0; dof < structure_.dof_count(); ++dof) {
      const int free = structure_.free_index(dof);
      displacement[dof] = imposed * structure_.unit_lift()[dof] + (free >= 0 ? right[free] : 0.0);
    }
  }

 private:
  const Structure& structure_;
  Flexibility& flexibility_;
  std::vector<int> dofs_, places_;
  std::vector<double> lift_, schur_, tangent_, difference_;
};

constexpr int k_block = 16;  // columns solved at once

}  // namespace

std::unique_ptr<EquilibriumSystem> make_uncondensed_system(const Structure& structure) {
  return std::make_unique<UncondensedSystem>(structure);
}

std::unique_ptr<EquilibriumSystem> make_condensed_system(const Structure& structure,
                                                         Flexibility& flexibility) {
  return std::make_unique<CondensedSystem>(structure, flexibility);
}

Flexibility::Flexibility(const Structure& structure)
    : structure_(structure), place_(structure.dof_count(), -1) {
  const auto& mesh = structure.mesh();
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    if (mesh.elastic[cell] != 0) continue;
    for (const int dof : structure.cell_dofs(cell)) {
      if (structure.free_index(dof) < 0 || place_[dof] == 0) continue;
      place_[dof] = 0;
      dofs_.push_back(dof);
    }
  }
  // Neighbours in a vertical crack are neighbours here, so that its blocks of columns are wanted as a whole.
  const auto key = [&](int dof) {
    const double* point = &mesh.points[3 * (dof / 3)];
    return std::tuple(point[0], point[1], point[2], dof);
  };
  std::sort(dofs_.begin(), dofs_.end(), [&](int a, int b) { return key(a) < key(b); });
  for (Index i = 0; i < std::ssize(dofs_); ++i) place_[dofs_[i]] = i;
  columns_.resize(dofs_.size());
}

std::span<const double> Flexibility::column(int place) {
  if (columns_[place].empty()) {
    const std::size_t rows = dofs_.size();
    const int first = place / k_block * k_block;
    const int columns = std::min<int>(k_block, rows - first);
    const std::size_t size = structure_.free_count();
    std::vector<double> right(size * columns, 0.0);
    for (int c = 0; c < columns; ++c) right[size * c + structure_.free_index(dofs_[first + c])] = 1.0;
    structure_.factor().solve(right, columns);
    for (int c = 0; c < columns; ++c) {
      std::vector<double>& column = columns_[first + c];
      column.resize(rows);
      for (std::size_t i = 0; i < rows; ++i) column[i] = right[size * c + structure_.free_index(dofs_[i])];
    }
  }
  return columns_[place];
}

}  // namespace knothe::offline
