#pragma once
/// @file A mesh that is refined and distributed over the ranks of an MPI job (deal.II with p4est).
#include <cstdint>
#include <utility>
#include <vector>

#include "knothe/offline/mesh/hexahedron_mesh.hpp"

namespace knothe::offline {

/// What one rank has of the mesh: the cells that it owns and, behind them, *ghosts*, the cells of other ranks
/// that share a node with one of its own. Local nodes are those of its cells: first the nodes that it owns,
/// in their global order, then the others. A node belongs to one rank only, and all cells around an owned
/// node are here: rows of owned nodes can be summed without asking anybody.
struct MeshPart {
  HexahedronMesh mesh;           ///< in local numbers; node sets and crack mouth as far as they are here
  std::int64_t owned_cells = 0;  ///< the first ones of `mesh`
  std::int64_t owned_nodes = 0;  ///< the first ones of `mesh`
  std::int64_t first_owned = 0;  ///< global number of the first owned node
  std::int64_t total_nodes = 0;  ///< of all ranks
  std::int64_t total_cells = 0;
  std::vector<std::int64_t> global_node;  ///< of each local node
  std::vector<std::int64_t>
      coarse_cell;  ///< of each local cell: the cell of the given mesh that it is part of
  /// Nodes of the given mesh that this rank owns: (number there, local number).
  std::vector<std::pair<std::int64_t, std::int64_t>> coarse_nodes;

  [[nodiscard]] std::int64_t node_count() const { return mesh.node_count(); }
};

/// Divides each cell of `coarse` into 8, `refinements` times, and gives each rank its share. All ranks call
/// it with the same mesh; MPI is started if it was not. A node of the finer mesh is in a node set when it
/// lies on a vertex, edge or face whose vertices all are. Throws DataError where deal.II refuses the mesh,
/// ProjectError for a number of refinements outside 0…6.
[[nodiscard]] MeshPart distribute_mesh(const HexahedronMesh& coarse, int refinements);

}  // namespace knothe::offline
