#pragma once
/// @file The built-in beam on a grid of parameters from a few runs, by its similarity.
///
/// Strain and √(Y₀/E) scale together, and damage depends on A_d (Y − Y₀) = A_d Y₀ (Y/Y₀ − 1). Under a load
/// that grows in proportion, with s = √(Y₀/E),
///   u(t; E, Y₀, A_d) = s U(t / s; A_d Y₀),   F(t; E, Y₀, A_d) = E s F̂(t / s; A_d Y₀),
/// for every law and regularisation here: Y is quadratic in the strain, everything else linear. Springs under
/// the supports have a stiffness of their own; E is then not scaled.
#include <string>
#include <vector>

#include "knothe/files/command_output.hpp"
#include "knothe/offline/full_order/beam_simulator.hpp"
#include "knothe/offline/grid_solving.hpp"

namespace knothe::offline {

/// How the beam's solution at a point of the box follows from one of the runs.
class Similarity {
 public:
  /// `runs`: values of A_d Y₀, of one common ratio, where both are axes.
  Similarity(const BeamProblem& problem, std::vector<model::Axis> axes, int runs);

  /// Nodes of the axes on which solutions are not similar: ln(A_d Y₀), and what is not scaled.
  [[nodiscard]] const std::vector<std::vector<double>>& nodes() const { return nodes_; }
  /// The coordinates of a point on these axes.
  [[nodiscard]] std::vector<double> invariants(std::span<const double> parameters) const;
  /// Exponents of the axes in A_d Y₀, d; empty where it is none of them.
  [[nodiscard]] std::vector<double> exponents() const;
  /// The points that are solved, one for each node of the tensor grid, last axis fastest: those of the least
  /// Y₀ and the largest E of the box, which need the longest time t / s.
  [[nodiscard]] std::vector<std::vector<double>> points() const;
  /// s of a point over that of the run, and E likewise.
  struct Factors {
    double amplitude, modulus;
  };
  [[nodiscard]] Factors factors(std::span<const double> parameters) const;

 private:
  [[nodiscard]] bool is_scaled(Index axis) const {
    return axis == threshold_ || axis == brittleness_ || axis == modulus_;
  }

  std::vector<model::Axis> axes_;
  Index threshold_, brittleness_, modulus_;  ///< axes; −1: none, or not scaled
  double brittleness_power_;                 ///< −1 of a fracture energy: A_d ∝ 1 / G_f
  std::vector<std::vector<double>> nodes_;
};

/// The runs for a project's grid: of `scaling_steps` load steps up to the last displacement, and on to a
/// little more, so that the states that a point reaches at its end are reached in the runs beside it too.
struct SimilarRuns {
  explicit SimilarRuns(const project::Project& project);
  Similarity similarity;
  BeamSimulator solver;
  std::vector<double> time;  ///< of its load steps, 1 at the project's last displacement
};

/// The solutions on the project's grid, from runs at `scaling_runs` values of A_d Y₀ (model::
/// RegisteredSolutions). Prints a line for each run. Errors: as model::run_points; NumericalError if a run at
/// an end of an axis failed and was to be left out.
[[nodiscard]] SolvedGrid solve_similar_grid(const project::Project& project, const std::string& parts_folder,
                                            const files::CommandOutput& output);

}  // namespace knothe::offline
