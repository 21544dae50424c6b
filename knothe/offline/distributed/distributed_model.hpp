#pragma once
/// @file One full-order model, distributed over the ranks of an MPI job: for meshes whose direct factor no
/// one machine holds.
#include <functional>
#include <memory>
#include <vector>

#include "knothe/offline/full_order/full_order_model.hpp"
#include "knothe/offline/mesh/hexahedron_mesh.hpp"

namespace knothe::offline {

/// How the elastic solution for a unit imposed displacement was found. The same on every rank.
struct DistributedElastic {
  std::int64_t dofs = 0;
  std::int64_t cells = 0;
  int ranks = 1;
  int iterations = 0;        ///< of conjugate gradients with algebraic multigrid
  double residual = 0;       ///< ‖b − K u‖ / ‖b‖
  double unit_reaction = 0;  ///< of the whole beam, N per m of imposed displacement
  /// Displacement at the nodes of the given mesh for a unit imposed displacement, [3 × nodes].
  std::vector<double> unit_lift;
  double set_up_seconds = 0;  ///< mesh, assembly and multigrid, of the slowest rank
  double solve_seconds = 0;   ///< of the slowest rank
  double largest_memory = 0;  ///< MiB, of the rank that has had most so far
  double memory_of_all = 0;   ///< MiB, their sum
};

/// The same equations as FullOrderModel, without condensation: Newton's method with the consistent tangent,
/// each system solved by GMRES that is preconditioned by multigrid of the secant stiffness. The direct
/// solution is faster up to some 300,000 dofs; this one goes on beyond. Every rank makes the object and calls
/// its functions.
class DistributedModel {
 public:
  /// Tolerance of the linear elastic solution and its most iterations.
  struct LinearOptions {
    double tolerance = 1e-9;
    int max_iterations = 500;
  };

  /// Divides the cells of `mesh` into 8, `refinements` times, and finds the elastic solution. Errors:
  /// ProjectError (options; supports with springs; gradient damage; more ranks than cells), DataError (mesh),
  /// NumericalError (the elastic solution is not found).
  DistributedModel(const HexahedronMesh& mesh, const ElasticConstants& elastic, const SolverOptions& options,
                   int refinements, const LinearOptions& linear);
  ~DistributedModel();

  [[nodiscard]] const DistributedElastic& elastic() const;
  /// Runs all steps, as FullOrderModel::run does. `displacement` and `cell_damage` of the result are those at
  /// nodes and cells of the given mesh. `on_step` gets the number of the step and its record.
  [[nodiscard]] FullOrderResult run(const DamageParameters& parameters,
                                    const std::function<void(int, const StepRecord&)>& on_step = {});

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace knothe::offline
