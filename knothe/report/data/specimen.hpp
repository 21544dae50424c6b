#pragma once
/// @file What a page draws of a model: one face of its mesh and fields on it, its functions, its load curve.
#include <array>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/record/results.hpp"

namespace knothe::report {

/// The quadrilaterals of a mesh that lie in its outermost plane of constant z.
struct OuterFace {
  std::vector<std::size_t> nodes;                 ///< of the mesh, the face's own numbering is their order
  std::vector<std::array<double, 2>> points;      ///< x, y of the face's nodes, m
  std::vector<std::array<std::size_t, 4>> cells;  ///< in the face's numbering, around each quadrilateral
};

/// Errors: DataError unless the cells are hexahedra of 8 nodes whose indices exist.
[[nodiscard]] OuterFace outer_face(const model::Mesh& mesh);

/// Index of the dof with component `component` (0 x, 1 y, 2 z) at each node of the face (matched within 1e-7
/// m); -1 where the model has none.
[[nodiscard]] std::vector<std::ptrdiff_t> dofs_of_face(const OuterFace& face, const model::Dofs& dofs,
                                                       std::int64_t component);

/// Whether the model has hexahedra and displacement dofs to draw.
[[nodiscard]] bool can_be_drawn(const model::SeparatedModel& model);

/// {points, cells}.
[[nodiscard]] nlohmann::ordered_json face_record(const OuterFace& face);

/// {points, cells, fields, modes, crack}: displacements at the last posterior mean at some times, the first
/// space modes, and the elastic solutions of four crack lengths. The model must be one that can be drawn.
[[nodiscard]] nlohmann::ordered_json specimen_record(const model::SeparatedModel& model,
                                                     std::span<const double> p);

/// Curves of the first modes: time functions at `p`, then parameter functions along each axis through it.
[[nodiscard]] nlohmann::ordered_json functions_record(const model::SeparatedModel& model,
                                                      std::span<const double> p);

/// {time, displacement, mean, low, high}: the load curve that the results hold, with the band that 95 % of
/// the last posterior's draws lie in where a model is given. Null where the results hold no curve.
[[nodiscard]] nlohmann::ordered_json load_record(const record::Results& results,
                                                 const model::SeparatedModel* model);

/// The last posterior mean, moved into the model's box, in the model's order of parameters; the box's middle
/// for a parameter that the results do not have.
[[nodiscard]] std::vector<double> drawing_point(const record::Results& results,
                                                const model::SeparatedModel& model);

}  // namespace knothe::report
