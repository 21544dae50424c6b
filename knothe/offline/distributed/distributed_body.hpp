#pragma once
/// @file One rank's share of the elastic body, and a loading of it (distributed_model.hpp).
#include <memory>
#include <span>
#include <vector>

#include "knothe/offline/distributed/distributed_system.hpp"
#include "knothe/offline/distributed/mesh_part.hpp"
#include "knothe/offline/distributed/ranks.hpp"
#include "knothe/offline/full_order/finite_elements.hpp"
#include "knothe/offline/full_order/full_order_model.hpp"
#include "knothe/offline/law/damage_law.hpp"

namespace knothe::offline {

/// Vectors have 3 values of each local node, ghosts included; sums go over the owned ones.
struct DistributedBody {
  MeshPart part;
  ElasticConstants elastic;
  FiniteElements elements;
  Ranks ranks;
  std::vector<char> prescribed;         ///< 1 where a component is prescribed
  std::vector<double> unit_prescribed;  ///< -1 at the load's u_y, 0 elsewhere
  std::vector<double> unit_lift;        ///< elastic solution for a unit imposed displacement
  double unit_reaction = 0;             ///< half body, N/m
  std::unique_ptr<DistributedSystem> system;

  [[nodiscard]] std::size_t owned_dofs() const { return 3 * part.owned_nodes; }
  [[nodiscard]] CellVector gather(std::span<const double> values, std::int64_t cell) const;
  void scatter(const CellVector& values, std::int64_t cell, std::span<double> sum) const;
  /// Of a cell whose material has lost the parts `damage` of its stiffness at its 8 points (none if empty).
  void secant_matrix(std::int64_t cell, std::span<const double> damage, CellMatrix& matrix) const;
  /// √Σ over the owned degrees of freedom that are free, of all ranks.
  [[nodiscard]] double free_norm(std::span<const double> force) const;
  /// Σ −f over the load's u_y: the reaction of the half body, N.
  [[nodiscard]] double reaction(std::span<const double> force) const;
};

/// Follows one loading from the virgin state, like LoadStepping.
class DistributedStepping {
 public:
  /// `ratios` of each local cell (regularisation.hpp).
  DistributedStepping(DistributedBody& body, const SolverOptions& options, const DamageParameters& parameters,
                      std::span<const double> ratios);

  [[nodiscard]] StepRecord advance(double target);
  [[nodiscard]] std::span<const double> displacement() const { return state_.displacement; }
  /// Mean damage of the reference law in each local cell.
  [[nodiscard]] std::vector<double> cell_damage() const;

 private:
  struct State {
    double imposed = 0;
    std::vector<double> displacement;
    double reaction = 0;
  };
  [[nodiscard]] MaterialResponse respond_at(std::int64_t cell, int point, const CellVector& u) const;
  /// Internal forces, trial damage and reaction at `displacement_`; the residual relative to the reaction.
  double evaluate(double imposed);
  void prepare_secant();
  [[nodiscard]] bool correct();
  [[nodiscard]] bool newton(double imposed, StepRecord& record);
  [[nodiscard]] bool secant(double imposed, StepRecord& record);
  void start_guess(double imposed, bool extrapolate);
  void commit(double imposed, StepRecord& record);

  DistributedBody& body_;
  const SolverOptions& options_;
  const DamageParameters parameters_;
  const std::span<const double> ratios_;
  std::vector<double> history_, committed_, trial_;  ///< [local cell][point]
  std::vector<double> displacement_, force_, right_, correction_;
  State state_, previous_;
  double reaction_ = 0, work_ = 0, dissipated_ = 0;  ///< half body
  bool preconditioner_is_old_ = true;
};

}  // namespace knothe::offline
