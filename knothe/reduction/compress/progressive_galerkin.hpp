#pragma once
/// @file PGD of linear parametrised problems: Σ_q (⊗_i A_q^i) u = Σ_q ⊗_i f_q^i, u found term by term.
///
/// Progressive Galerkin: each new term is a rank-one correction found by alternating over the coordinates,
/// then the functions of all coordinates but the first (space) are solved for anew together (A. Nouy, Comput.
/// Methods Appl. Mech. Eng. 199 (2010); F. Chinesta, P. Ladevèze, E. Cueto, Arch. Comput. Methods Eng. 18
/// (2011)). docs/reduction.md, "Linear problems".
#include <Eigen/SparseCore>
#include <functional>
#include <string>
#include <vector>

#include "knothe/reduction/compress/separated_tensor.hpp"
#include "knothe/reduction/model/model_file.hpp"

namespace knothe::reduction {

/// Operator and load in affine (separated) form; coordinate 0 is space, the others time and parameters, any
/// number. Several may share one coordinate (Kronecker products of their matrices): what travels, as a heat
/// source, separates badly from time *and* parameters, and well from both together.
struct SeparatedProblem {
  /// One term: a matrix n_i × n_i per coordinate (parameters by collocation: diagonal).
  std::vector<std::vector<Eigen::SparseMatrix<double>>> operators;
  /// One term: a vector n_i per coordinate.
  std::vector<std::vector<Eigen::VectorXd>> loads;
};

struct ProgressiveGalerkinOptions {
  double tolerance = 1e-6;  ///< on ‖f − A u‖ / ‖f‖ (Frobenius)
  int max_modes = 50;
  int max_sweeps = 30;            ///< of the alternation for one term
  double sweep_tolerance = 1e-3;  ///< relative change of the term that ends them
  std::uint64_t seed = 1;         ///< of the functions a term begins with
  /// Called after every mode with its number and the relative residual; false interrupts (Interrupted).
  std::function<bool(int modes, double residual)> progress = {};
};

/// After m terms.
struct EnrichmentRecord {
  double residual = 0;  ///< ‖f − A u‖ / ‖f‖
  double energy = 0;    ///< ½ uᵀA u − fᵀu: falls with every term if A is symmetric positive definite
  /// |uᵀA u − fᵀu| / |fᵀu|: 0 for a Galerkin solution, in which internal and external work balance.
  double imbalance = 0;
  int sweeps = 0;
};

struct ProgressiveGalerkinResult {
  SeparatedTensor solution;
  std::vector<EnrichmentRecord> history;  ///< one entry per mode
  bool converged = false;
  std::string reason;  ///< in words, if not
};

/// UsageError if matrices and vectors do not fit together, are not finite, or a load is missing;
/// NumericalError if the operator of a coordinate is singular in the first term.
[[nodiscard]] ProgressiveGalerkinResult solve_progressive_galerkin(
    const SeparatedProblem& problem, const ProgressiveGalerkinOptions& options = {});

/// The solution over (space, time, one coordinate per axis) as a canonical model without lift, ready for the
/// online phase. `dofs` names the rows of coordinate 0. UsageError if the sizes do not fit.
[[nodiscard]] ModelContents canonical_model(const SeparatedTensor& solution, std::vector<double> time,
                                            std::vector<Axis> axes, Dofs dofs);

}  // namespace knothe::reduction
