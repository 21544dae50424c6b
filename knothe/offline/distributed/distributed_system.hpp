#pragma once
/// @file Sparse linear systems of an elastic body, distributed over the ranks of an MPI job (PETSc).
#include <functional>
#include <memory>
#include <span>

#include "knothe/offline/distributed/mesh_part.hpp"
#include "knothe/offline/law/element_kernels.hpp"

namespace knothe::offline {

/// How a linear solve went.
struct LinearSolve {
  int iterations = 0;
  double residual = 0;  ///< ‖b − A x‖ / ‖b‖, of the residual itself
  bool converged = false;
};

/// A matrix of three unknowns a node, preconditioned by smoothed-aggregation algebraic multigrid (GAMG) that
/// is given the six rigid-body modes. Rows and columns of prescribed degrees of freedom are those of the
/// identity. What is made and solved is made and solved by all ranks together.
class DistributedSystem {
 public:
  /// Matrix of a cell; both owned and ghost cells are asked for.
  using CellMatrices = std::function<void(std::int64_t cell, CellMatrix& matrix)>;

  DistributedSystem() = default;
  virtual ~DistributedSystem() = default;
  DistributedSystem(const DistributedSystem&) = delete;
  DistributedSystem& operator=(const DistributedSystem&) = delete;

  /// Values of a symmetric positive definite matrix: conjugate gradients, multigrid of this matrix.
  virtual void set_symmetric(const CellMatrices& matrices) = 0;
  /// Values of any matrix: GMRES, with the multigrid of the last `set_symmetric`, which must have come before
  /// and be near.
  virtual void set_general(const CellMatrices& matrices) = 0;
  /// A x = b to ‖b − A x‖ ≤ tolerance ‖b‖; values of owned nodes, 3 each. Not converged: the best x.
  virtual LinearSolve solve(std::span<const double> b, std::span<double> x, double tolerance,
                            int max_iterations) = 0;
  /// From the owners to the ghosts: `values` has 3 of each local node.
  virtual void update_ghosts(std::span<double> values) = 0;
};

/// `prescribed[3 n + c]` of local node n: 1 where component c is prescribed. `part` must outlive the system.
[[nodiscard]] std::unique_ptr<DistributedSystem> make_distributed_system(const MeshPart& part,
                                                                         std::span<const char> prescribed);

}  // namespace knothe::offline
