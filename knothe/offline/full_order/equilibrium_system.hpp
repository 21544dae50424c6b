#pragma once
/// @file The linear algebra of one equilibrium: unknowns, residual and tangent, condensed or not.
///
/// Damage acts as a force on an elastic body: K u = f + q(u), with K the elastic stiffness and q = ∫ Bᵀ d C ε
/// the part of the elastic force that damage takes away; q comes from the few *active* cells only (those that
/// are damaged or soon may be), so everything else can be condensed out exactly.
#include <memory>
#include <span>
#include <vector>

#include "knothe/offline/full_order/structure.hpp"

namespace knothe::offline {

/// Unknowns v ⊂ free dofs, at a given imposed displacement: r(v) = elastic force − q(v) = 0.
class EquilibriumSystem {
 public:
  virtual ~EquilibriumSystem() = default;
  /// From now on `cells` (ascending) may be damaged. Changes the unknowns.
  virtual void set_active(std::span<const std::int64_t> cells) = 0;
  /// Dofs that are the unknowns.
  [[nodiscard]] virtual std::span<const int> unknown_dofs() const = 0;
  /// For each active cell its 24 places among the unknowns, -1 where a dof is prescribed.
  [[nodiscard]] virtual std::span<const int> places() const = 0;
  /// r = (elastic force of v at the imposed displacement) - force; `force` is q on the unknowns.
  virtual void residual(double imposed, std::span<const double> v, std::span<const double> force,
                        std::span<double> r) = 0;
  /// Solves (elastic stiffness - Σ cell matrices) x = r; `matrices` are ∂q/∂u of the active cells. False if
  /// singular.
  [[nodiscard]] virtual bool solve(std::span<const CellMatrix> matrices, std::span<const double> r,
                                   std::span<double> x) = 0;
  /// Displacement of all dofs that belongs to v and q.
  virtual void expand(double imposed, std::span<const double> v, std::span<const double> force,
                      std::span<double> displacement) = 0;
};

/// All free dofs are unknowns; UMFPACK. The reference that the condensed system is tested against.
[[nodiscard]] std::unique_ptr<EquilibriumSystem> make_uncondensed_system(const Structure& structure);

/// The elastic flexibility K⁻¹ between dofs of cells that can be damaged, its columns computed when they are
/// first wanted, in fixed blocks: what a column is does not depend on what was wanted before.
class Flexibility {
 public:
  explicit Flexibility(const Structure& structure);
  /// Place of a dof in the order of this object (by x, then y, then z of its node), or -1 if it has none.
  [[nodiscard]] int place(int dof) const { return place_[dof]; }
  [[nodiscard]] int dof(int place) const { return dofs_[place]; }
  /// Entries of column `place`, for all places.
  [[nodiscard]] std::span<const double> column(int place);
  /// Column `place` will not be wanted again: its memory is given back.
  void release(int place) { columns_[place] = {}; }

 private:
  const Structure& structure_;
  std::vector<int> place_, dofs_;
  std::vector<std::vector<double>> columns_;
};

/// Unknowns are the free dofs of active cells; the rest follows elastically and is condensed: with G the
/// flexibility between the unknowns, S = G⁻¹ is the Schur complement of the whole elastic body on them, and
/// r = S (v - imposed × unit lift) - q. Exact, and dense of some hundred unknowns where the body has
/// thousands. `flexibility` is kept between runs and must outlive the system.
[[nodiscard]] std::unique_ptr<EquilibriumSystem> make_condensed_system(const Structure& structure,
                                                                       Flexibility& flexibility);

}  // namespace knothe::offline
