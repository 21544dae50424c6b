#include "knothe/offline/distributed/distributed_system.hpp"

#include <fmt/format.h>
#include <petscksp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/offline/distributed/ranks.hpp"

namespace knothe::offline {
namespace {

/// PETSc's error codes as exceptions; it has printed its own words by then.
void check(PetscErrorCode code, const char* what) {
  if (code == 0) return;
  const char* text = nullptr;
  PetscErrorMessage(code, &text, nullptr);
  throw NumericalError(
      fmt::format("PETSc could not {}: {} (error {})", what, text != nullptr ? text : "no text", code));
}

void start_petsc() {
  PetscBool initialised = PETSC_FALSE;
  check(PetscInitialized(&initialised), "be asked");
  if (initialised == PETSC_TRUE) return;
  Ranks::start();
  // Signals are ours (base/cancellation.hpp). PETSC_OPTIONS="-knothe_…" is for experts.
  check(PetscOptionsSetValue(nullptr, "-no_signal_handler", "true"), "set an option");
  check(PetscInitializeNoArguments(), "start");
  check(PetscPopErrorHandler(), "leave its error handler");
  check(PetscPushErrorHandler(PetscReturnErrorHandler, nullptr), "take an error handler");
}

/// An option of our solver that PETSC_OPTIONS does not set.
void set_default(const char* name, const std::string& value) {
  PetscBool there = PETSC_FALSE;
  check(PetscOptionsHasName(nullptr, nullptr, name, &there), "look an option up");
  if (there == PETSC_FALSE) check(PetscOptionsSetValue(nullptr, name, value.c_str()), "set an option");
}

template <class Object, PetscErrorCode (*destroy)(Object*)>
class Handle {
 public:
  Handle() = default;
  ~Handle() { (void)destroy(&object_); }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  [[nodiscard]] Object get() const { return object_; }
  [[nodiscard]] Object* out() { return &object_; }

 private:
  Object object_ = nullptr;
};
using Matrix = Handle<Mat, MatDestroy>;
using Vector = Handle<Vec, VecDestroy>;

struct PetscSystem final : DistributedSystem {
  const MeshPart& part;
  std::vector<char> prescribed;
  Matrix symmetric, general;
  Vector right, solution, residual, ghosted;
  Handle<KSP, KSPDestroy> solver;
  Mat current = nullptr;

  PetscSystem(const MeshPart& mesh_part, std::span<const char> prescribed_dofs)
      : part(mesh_part), prescribed(prescribed_dofs.begin(), prescribed_dofs.end()) {
    start_petsc();
    make_vectors();
    make_matrix(symmetric);
    give_rigid_body_modes();
  }

  void set_symmetric(const CellMatrices& matrices) override;
  void set_general(const CellMatrices& matrices) override;
  LinearSolve solve(std::span<const double> b, std::span<double> x, double tolerance,
                    int max_iterations) override;
  void update_ghosts(std::span<double> values) override;

  [[nodiscard]] PetscInt rows() const { return 3 * part.owned_nodes; }

  void make_vectors() {
    std::vector<PetscInt> ghosts;
    for (std::int64_t n = part.owned_nodes; n < part.node_count(); ++n) ghosts.push_back(part.global_node[n]);
    check(VecCreateGhostBlock(PETSC_COMM_WORLD, 3, rows(), PETSC_DETERMINE, ghosts.size(), ghosts.data(),
                              ghosted.out()),
          "make a vector");
    check(VecCreateMPI(PETSC_COMM_WORLD, rows(), PETSC_DETERMINE, right.out()), "make a vector");
    check(VecSetBlockSize(right.get(), 3), "set the size of blocks");
    check(VecDuplicate(right.get(), solution.out()), "make a vector");
    check(VecDuplicate(right.get(), residual.out()), "make a vector");
  }

  /// How many owned and other nodes each owned node is coupled with.
  void count_neighbours(std::vector<PetscInt>& own, std::vector<PetscInt>& other) const {
    const std::size_t owned = part.owned_nodes;
    std::vector<std::size_t> start(owned + 1, 0);
    const auto visit = [&](const auto& action) {
      for (std::int64_t cell = 0; cell < part.mesh.cell_count(); ++cell) {
        const std::int64_t* nodes = &part.mesh.cells[8 * cell];
        for (int a = 0; a < 8; ++a)
          if (nodes[a] < part.owned_nodes) action(nodes[a], cell);
      }
    };
    visit([&](std::size_t node, std::int64_t) { ++start[node + 1]; });
    for (std::size_t n = 0; n < owned; ++n) start[n + 1] += start[n];
    std::vector<std::int64_t> around(start.back());
    std::vector<std::size_t> next(start.begin(), start.end() - 1);
    visit([&](std::size_t node, std::int64_t cell) { around[next[node]++] = cell; });
    own.assign(owned, 0);
    other.assign(owned, 0);
    std::vector<std::int64_t> neighbours;
    for (std::size_t n = 0; n < owned; ++n) {
      neighbours.clear();
      for (std::size_t k = start[n]; k < start[n + 1]; ++k) {
        const std::int64_t* nodes = &part.mesh.cells[8 * around[k]];
        neighbours.insert(neighbours.end(), nodes, nodes + 8);
      }
      std::sort(neighbours.begin(), neighbours.end());
      neighbours.erase(std::unique(neighbours.begin(), neighbours.end()), neighbours.end());
      for (const std::int64_t neighbour : neighbours) ++(neighbour < part.owned_nodes ? own[n] : other[n]);
    }
  }

  void make_matrix(Matrix& matrix) const {
    check(MatCreate(PETSC_COMM_WORLD, matrix.out()), "make a matrix");
    Mat m = matrix.get();
    check(MatSetSizes(m, rows(), rows(), PETSC_DETERMINE, PETSC_DETERMINE), "size a matrix");
    check(MatSetType(m, MATAIJ), "choose a matrix");
    check(MatSetBlockSize(m, 3), "set the size of blocks");
    std::vector<PetscInt> own, other;
    count_neighbours(own, other);
    check(MatXAIJSetPreallocation(m, 3, own.data(), other.data(), nullptr, nullptr), "allocate a matrix");
    check(MatSetOption(m, MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_TRUE), "set an option");
    // Rows of other ranks are theirs to fill.
    check(MatSetOption(m, MAT_IGNORE_OFF_PROC_ENTRIES, PETSC_TRUE), "set an option");
    check(MatSetOption(m, MAT_NO_OFF_PROC_ENTRIES, PETSC_TRUE), "set an option");
  }

  /// Six of them: CG needs 4 times the iterations with the translations only.
  void give_rigid_body_modes() const {
    Vector places;
    check(VecDuplicate(right.get(), places.out()), "make a vector");
    double* values = nullptr;
    check(VecGetArray(places.get(), &values), "open a vector");
    std::copy_n(part.mesh.points.begin(), rows(), values);
    check(VecRestoreArray(places.get(), &values), "close a vector");
    Handle<MatNullSpace, MatNullSpaceDestroy> modes;
    check(MatNullSpaceCreateRigidBody(places.get(), modes.out()), "make the rigid-body modes");
    check(MatSetNearNullSpace(symmetric.get(), modes.get()), "take the rigid-body modes");
  }

  /// The sum over the cells; returns a diagonal entry's size.
  double fill(const Matrix& matrix, const CellMatrices& cell_matrices) const {
    Mat m = matrix.get();
    check(MatZeroEntries(m), "clear a matrix");
    CellMatrix values{};
    std::array<double, 9 * 8> row_values{};
    std::array<PetscInt, 24> columns{};
    for (std::int64_t cell = 0; cell < part.mesh.cell_count(); ++cell) {
      cell_matrices(cell, values);
      const std::int64_t* nodes = &part.mesh.cells[8 * cell];
      for (int b = 0; b < 8; ++b)
        for (int c = 0; c < 3; ++c) columns[3 * b + c] = 3 * part.global_node[nodes[b]] + c;
      for (int a = 0; a < 8; ++a) {
        if (nodes[a] >= part.owned_nodes) continue;
        const std::array<PetscInt, 3> rows_of_node = {columns[3 * a], columns[3 * a + 1], columns[3 * a + 2]};
        for (int c = 0; c < 3; ++c)
          for (int b = 0; b < 8; ++b)
            for (int d = 0; d < 3; ++d)
              row_values[24 * c + 3 * b + d] = is_prescribed(nodes[a], c) || is_prescribed(nodes[b], d)
                                                   ? 0.0
                                                   : values[k_cell_dofs * (8 * c + a) + 8 * d + b];
        check(MatSetValues(m, 3, rows_of_node.data(), 24, columns.data(), row_values.data(), ADD_VALUES),
              "set values of a matrix");
      }
    }
    // The diagonal of prescribed rows is of the size of the others, for the multigrid's sake.
    const double scale = Ranks::of_this_job().max(std::abs(values[0]));
    for (std::int64_t n = 0; n < part.owned_nodes; ++n)
      for (int c = 0; c < 3; ++c)
        if (is_prescribed(n, c)) {
          const PetscInt row = 3 * part.global_node[n] + c;
          check(MatSetValue(m, row, row, scale, ADD_VALUES), "set a value of a matrix");
        }
    check(MatAssemblyBegin(m, MAT_FINAL_ASSEMBLY), "assemble a matrix");
    check(MatAssemblyEnd(m, MAT_FINAL_ASSEMBLY), "assemble a matrix");
    return scale;
  }

  [[nodiscard]] bool is_prescribed(std::int64_t node, int component) const {
    return prescribed[3 * node + component] != 0;
  }

  /// Symmetric Gauss–Seidel smoothing, four times, and weak couplings left out of the aggregates: half the
  /// iterations of the defaults on elements of 6 : 1. The shift is for unknowns of the coarser levels that
  /// nothing determines (an aggregate of two nodes has no rotation about its axis): their diagonal is zero.
  void make_solver(double scale) {
    set_default("-knothe_pc_gamg_threshold", "0.04");
    set_default("-knothe_mg_levels_pc_type", "sor");
    set_default("-knothe_mg_levels_pc_sor_diagonal_shift", fmt::format("{:.3e}", 1e-8 * scale));
    set_default("-knothe_mg_levels_ksp_max_it", "4");
    check(KSPCreate(PETSC_COMM_WORLD, solver.out()), "make a solver");
    check(KSPSetOptionsPrefix(solver.get(), "knothe_"), "name the solver");
    PC preconditioner = nullptr;
    check(KSPGetPC(solver.get(), &preconditioner), "find the preconditioner");
    check(PCSetType(preconditioner, PCGAMG), "choose multigrid");
    check(PCGAMGSetType(preconditioner, PCGAMGAGG), "choose aggregation");
    check(PCGAMGSetNSmooths(preconditioner, 1), "choose smoothed aggregation");
    check(KSPSetFromOptions(solver.get()), "read PETSC_OPTIONS");
  }

  void use(Mat matrix, KSPType type) {
    current = matrix;
    check(KSPSetType(solver.get(), type), "choose a solver");
    const bool gmres = std::string_view(type) == KSPGMRES;
    check(KSPSetPCSide(solver.get(), gmres ? PC_RIGHT : PC_LEFT), "choose the side of the preconditioner");
    if (gmres) check(KSPGMRESSetRestart(solver.get(), 100), "set a restart");
    check(KSPSetNormType(solver.get(), KSP_NORM_UNPRECONDITIONED), "choose a norm");
    check(KSPSetOperators(solver.get(), matrix, symmetric.get()), "take the matrices");
  }
};

void PetscSystem::set_symmetric(const CellMatrices& matrices) {
  const double scale = fill(symmetric, matrices);
  if (solver.get() == nullptr) make_solver(scale);
  check(MatSetOption(symmetric.get(), MAT_SPD, PETSC_TRUE), "set an option");
  check(KSPSetReusePreconditioner(solver.get(), PETSC_FALSE), "let the preconditioner go");
  use(symmetric.get(), KSPCG);
  check(KSPSetUp(solver.get()), "set the multigrid up");
}

void PetscSystem::set_general(const CellMatrices& matrices) {
  if (general.get() == nullptr) make_matrix(general);
  (void)fill(general, matrices);
  check(KSPSetReusePreconditioner(solver.get(), PETSC_TRUE), "keep the preconditioner");
  use(general.get(), KSPGMRES);
}

LinearSolve PetscSystem::solve(std::span<const double> b, std::span<double> x, double tolerance,
                               int max_iterations) {
  double* values = nullptr;
  check(VecGetArray(right.get(), &values), "open a vector");
  std::copy_n(b.begin(), rows(), values);
  check(VecRestoreArray(right.get(), &values), "close a vector");
  check(KSPSetTolerances(solver.get(), tolerance, 0.0, 1e10, max_iterations), "set the tolerance");
  check(KSPSolve(solver.get(), right.get(), solution.get()), "solve");

  LinearSolve result;
  PetscInt iterations = 0;
  KSPConvergedReason reason = KSP_CONVERGED_ITERATING;
  check(KSPGetIterationNumber(solver.get(), &iterations), "count its iterations");
  check(KSPGetConvergedReason(solver.get(), &reason), "say how it ended");
  result.iterations = iterations;
  result.converged = reason > 0;
  check(MatMult(current, solution.get(), residual.get()), "multiply");
  check(VecAYPX(residual.get(), -1.0, right.get()), "subtract");
  double left = 0, scale = 0;
  check(VecNorm(residual.get(), NORM_2, &left), "take a norm");
  check(VecNorm(right.get(), NORM_2, &scale), "take a norm");
  result.residual = scale > 0 ? left / scale : left;
  const double* solved = nullptr;
  check(VecGetArrayRead(solution.get(), &solved), "open a vector");
  std::copy_n(solved, rows(), x.begin());
  check(VecRestoreArrayRead(solution.get(), &solved), "close a vector");
  return result;
}

void PetscSystem::update_ghosts(std::span<double> values) {
  double* open = nullptr;
  check(VecGetArray(ghosted.get(), &open), "open a vector");
  std::copy_n(values.begin(), rows(), open);
  check(VecRestoreArray(ghosted.get(), &open), "close a vector");
  check(VecGhostUpdateBegin(ghosted.get(), INSERT_VALUES, SCATTER_FORWARD), "send to ghosts");
  check(VecGhostUpdateEnd(ghosted.get(), INSERT_VALUES, SCATTER_FORWARD), "send to ghosts");
  Vec local = nullptr;
  check(VecGhostGetLocalForm(ghosted.get(), &local), "open a vector");
  const double* read = nullptr;
  check(VecGetArrayRead(local, &read), "open a vector");
  std::copy_n(read, values.size(), values.begin());
  check(VecRestoreArrayRead(local, &read), "close a vector");
  check(VecGhostRestoreLocalForm(ghosted.get(), &local), "close a vector");
}

}  // namespace

std::unique_ptr<DistributedSystem> make_distributed_system(const MeshPart& part,
                                                           std::span<const char> prescribed) {
  return std::make_unique<PetscSystem>(part, prescribed);
}

}  // namespace knothe::offline
