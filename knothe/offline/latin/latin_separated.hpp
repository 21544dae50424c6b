#pragma once
/// @file LATIN-PGD in the fully separated form, Σ U_k(x) λ_k(t) Π γ_ki(p_i), iterated in that form
/// (docs/explanation/latin.md, "Full separation"; Rubio et al. 2019, Eq. 12 and §6.2; Ladevèze 1999).
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"
#include "knothe/offline/latin/latin_pgd.hpp"
#include "knothe/offline/latin/latin_terms.hpp"

namespace knothe::offline {

/// How the separated form is iterated.
struct SeparatedOptions {
  int max_terms = 100;     ///< m at most
  double accuracy = 1e-6;  ///< m: a range of time is left when the worst out-of-balance forces are worth less
  int window = 2;          ///< steps by which the range of time grows; all steps: the whole range at once
  int rounds = 60;         ///< global stages for a range at most
  int sweeps = 2;          ///< updates of all functions in a global stage
  double relaxation = 1;   ///< of updated functions; halved where an iterate got worse, up again where better
  double stagnation = 0.9;     ///< a term is added where a stage leaves more than this of the energy error
  int fixed_point = 3;         ///< passes of the fixed point for a new term, at most
  double recompression = 0.1;  ///< terms and modes may go that change less than this fraction of the error
  double activation = 0.7;     ///< as LatinOptions::activation
  LatinStart start;            ///< hybrid start, separated first; empty: the elastic solution
  std::size_t threads = 0;     ///< 0: all
  bool quiet = true;           ///< no progress on stderr
  /// Where a run that is interrupted leaves its state, and goes on from, and what tells it from other runs,
  /// as in LatinOptions.
  std::string state_file, key;
  std::function<void(int steps)> on_range;  ///< told before each range how many steps are done

  /// Throws ProjectError naming the option that makes no sense.
  void validate() const;
};

/// One global stage.
struct SeparatedIteration {
  int steps = 0;  ///< the range of time, [0, steps)
  int round = 0;
  int terms = 0;            ///< m
  int space_modes = 0;      ///< R
  double energy_error = 0;  ///< √(Σ w ρᵀ G ρ / Σ w cᵀ c), ρ the out-of-balance forces; at most 1
  double residual = 0;      ///< largest out-of-balance forces / reaction force
  double correction = 0;    ///< displacement that would take the worst of them away, m
  double indicator = 0;     ///< relative change of the solution in the stage before (energy norm); 1 at first
  double relaxation = 1;
  double cpu_seconds = 0;  ///< since the start
};

struct SeparatedSolution {
  /// The same, as modes and joint coordinates; accepted: one window, all or none; local_points: of the stages
  /// in `history`.
  LatinSolution solution;
  LatinTerms terms;  ///< coordinates in `solution.space`
  std::vector<SeparatedIteration> history;
};

/// Solves for the grid of `axes` (`parameters`: of its points, the last axis the fastest), in terms alone.
/// The range of time grows from the first steps to all; in each range local stages and updates follow each
/// other, and terms are added, until it is accurate or `max_terms` are there. What is left then is in
/// `solution.accepted` and `history`. Deterministic for any number of threads. Errors and resuming as of
/// solve_latin_pgd; a run that started from a model is one range, and starts again.
[[nodiscard]] SeparatedSolution solve_latin_separated(std::shared_ptr<const Structure> structure,
                                                      const SolverOptions& loading,
                                                      const std::vector<model::Axis>& axes,
                                                      std::span<const DamageParameters> parameters,
                                                      const SeparatedOptions& options);

}  // namespace knothe::offline
