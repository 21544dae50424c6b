#pragma once
/// @file The offline phase in a few calls, for the program knothe-offline.
#include <span>
#include <string>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"
#include "knothe/offline/full_order/crack_solutions.hpp"
#include "knothe/offline/full_order/full_order_model.hpp"
#include "knothe/offline/mesh/beam_mesh.hpp"

namespace knothe::offline {

/// The full-order model of a project: geometry, material, loading.
struct BeamProblem {
  BeamOptions beam;
  std::string
      gmsh_file;  ///< if not empty, the mesh is read from here (gmsh_mesh.hpp) instead of made from `beam`
  ElasticConstants elastic;
  DamageParameters reference;  ///< values of parameters that are not on an axis
  SolverOptions solver;
};

/// The mesh of the problem, checked. Errors: ProjectError (options), DataError (mesh file).
[[nodiscard]] HexahedronMesh make_mesh(const BeamProblem& problem);
/// The model, ready to run for any parameters.
[[nodiscard]] FullOrderModel make_full_order_model(const BeamProblem& problem);

/// The axis of one of the parameters that `problem_at` knows, `nodes` equidistant ones from `lower` to
/// `upper` (multiples of `reference`).
[[nodiscard]] model::Axis parameter_axis(const std::string& name, double reference, double lower,
                                         double upper, int nodes);

/// The problem at dimensionless `values` of the axes (value × reference), its `reference` the damage
/// parameters there. The names known are "Y0" (threshold, J/m³), "Ad" (brittleness, m³/J), "E" (Young's
/// modulus, Pa), "support_stiffness" (N/m) and "load_offset" (m); another one is a ProjectError that lists
/// them. The last two are of the beam that `beam` describes, not of a Gmsh mesh: ProjectError.
[[nodiscard]] BeamProblem problem_at(const BeamProblem& problem, std::span<const model::Axis> axes,
                                     std::span<const double> values);
/// Runs the full-order model at a point: `model`, which is that of `problem`, where it has the same elastic
/// body, else one of its own.
[[nodiscard]] FullOrderResult run_at(FullOrderModel& model, const BeamProblem& problem,
                                     std::span<const model::Axis> axes, std::span<const double> values);
/// Whether two problems differ in nothing but the damage parameters (as far as `problem_at` changes them).
[[nodiscard]] bool same_body(const BeamProblem& one, const BeamProblem& other);

/// The damage parameters alone. ProjectError if an axis is not one of them: LATIN-PGD keeps the elastic body.
[[nodiscard]] DamageParameters damage_parameters(const BeamProblem& problem,
                                                 std::span<const model::Axis> axes,
                                                 std::span<const double> values);

/// Model time of each step, the fraction of the last imposed displacement that is reached: (i + 1) / steps.
[[nodiscard]] std::vector<double> model_time(const SolverOptions& solver);

/// Place and component of every degree of freedom, in the order of FullOrderResult::displacement.
[[nodiscard]] model::Dofs dofs(const HexahedronMesh& mesh);
[[nodiscard]] model::Mesh mesh_of(const HexahedronMesh& mesh);
/// The elastic solution for the imposed displacement of every step, [steps, n_dof].
[[nodiscard]] std::vector<double> elastic_lift(const Structure& structure, const SolverOptions& solver);

/// Snapshots of a grid with a single point, i.e. one run, in the same form as those of a grid
/// (model/simulator/grid_runs.hpp).
[[nodiscard]] model::Snapshots as_snapshots(const BeamProblem& problem, const Structure& structure,
                                            const FullOrderResult& result);

/// Crack solutions at the degrees of freedom of a model, for its file.
struct CrackTable {
  std::vector<double> lengths;    ///< [count], m
  std::vector<double> values;     ///< [count, n_dof], m per m of imposed displacement
  std::vector<double> stiffness;  ///< [count], reaction of the whole beam per imposed displacement, N/m
};
/// Solves and interpolates; elastic constants and geometry of `problem`, dofs of its mesh.
[[nodiscard]] CrackTable crack_table(const BeamProblem& problem, const CrackedBeamOptions& options,
                                     const model::Dofs& dofs);

/// Everything the result of a run depends on. Numbers of processes, names of axes and references are not in
/// it: what counts is the physical value.
[[nodiscard]] std::string run_key(const BeamProblem& problem);

}  // namespace knothe::offline
