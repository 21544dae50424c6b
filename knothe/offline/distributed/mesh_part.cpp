#include "knothe/offline/distributed/mesh_part.hpp"

#include <deal.II/base/multithread_info.h>
#include <deal.II/distributed/tria.h>
#include <deal.II/dofs/dof_handler.h>
#include <deal.II/dofs/dof_tools.h>
#include <deal.II/fe/fe_q.h>
#include <fmt/format.h>
#include <p4est.h>
#include <sc.h>

#include <algorithm>
#include <array>
#include <unordered_map>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/offline/distributed/ranks.hpp"
#include "knothe/offline/mesh/triangulation.hpp"

namespace knothe::offline {
namespace {

using Triangulation = dealii::parallel::distributed::Triangulation<3>;
using DofHandler = dealii::DoFHandler<3>;
using Cell = DofHandler::active_cell_iterator;
using Reference = std::array<double, 3>;  ///< in [0, 1]³; dyadic fractions, so exact

/// The ancestor of a cell in the coarse mesh, and where the cell's eight vertices are in it.
struct Ancestor {
  int cell = 0;
  std::array<std::int64_t, 8> nodes{};  ///< coarse nodes, deal.II's order
  std::array<Reference, 8> vertices{};  ///< of the fine cell, deal.II's order
};

Ancestor ancestor_of(const Cell& fine) {
  Ancestor result;
  for (unsigned v = 0; v < 8; ++v)
    for (unsigned k = 0; k < 3; ++k) result.vertices[v][k] = (v >> k) & 1U;
  Triangulation::cell_iterator cell = fine;
  while (cell->level() > 0) {
    const Triangulation::cell_iterator parent = cell->parent();
    unsigned child = 0;
    while (parent->child(child) != cell) ++child;
    for (Reference& vertex : result.vertices)
      for (unsigned k = 0; k < 3; ++k) vertex[k] = 0.5 * (vertex[k] + ((child >> k) & 1U));
    cell = parent;
  }
  result.cell = cell->index();
  for (unsigned v = 0; v < 8; ++v) result.nodes[v] = cell->vertex_index(v);
  return result;
}

/// The coarse nodes that a place in a coarse cell hangs on: vertices of the vertex, edge, face or cell it is
/// in.
template <class Visit>
void visit_supports(const Ancestor& ancestor, const Reference& place, const Visit& visit) {
  for (unsigned v = 0; v < 8; ++v) {
    bool counts = true;
    for (unsigned k = 0; k < 3; ++k) counts = counts && (((v >> k) & 1U) != 0 ? place[k] > 0 : place[k] < 1);
    if (counts) visit(ancestor.nodes[v]);
  }
}

/// Membership in the node sets of the coarse mesh, a bit each.
class SetBits {
 public:
  explicit SetBits(const HexahedronMesh& mesh) : bits_(mesh.node_count(), 0) {
    for (Index set = 0; set < std::ssize(k_sets); ++set)
      for (const std::int64_t node : mesh.*k_sets[set]) bits_[node] |= 1U << set;
  }

  [[nodiscard]] unsigned of(const Ancestor& ancestor, const Reference& place) const {
    unsigned result = ~0U;
    visit_supports(ancestor, place, [&](std::int64_t node) { result &= bits_[node]; });
    return result;
  }

  static void add(std::int64_t node, unsigned bits, HexahedronMesh& mesh) {
    for (Index set = 0; set < std::ssize(k_sets); ++set)
      if ((bits >> set & 1U) != 0) (mesh.*k_sets[set]).push_back(node);
  }

 private:
  static constexpr std::array k_sets = {&HexahedronMesh::support_left, &HexahedronMesh::support_right,
                                        &HexahedronMesh::load, &HexahedronMesh::symmetry,
                                        &HexahedronMesh::left_face};
  std::vector<unsigned> bits_;
};

/// Numbers the nodes of the cells here: owned ones by their global number, others as they come.
class LocalNumbers {
 public:
  LocalNumbers(const dealii::IndexSet& owned, MeshPart& part) : part_(part) {
    part.owned_nodes = owned.n_elements();
    part.first_owned = owned.n_elements() > 0 ? static_cast<std::int64_t>(owned.nth_index_in_set(0)) : 0;
    part.global_node.resize(part.owned_nodes);
    for (std::int64_t n = 0; n < part.owned_nodes; ++n) part.global_node[n] = part.first_owned + n;
    seen_.assign(part.owned_nodes, 0);
    part.mesh.points.resize(3 * part.owned_nodes);
  }

  /// The local number, and whether the node is met for the first time.
  std::pair<std::int64_t, bool> number(std::int64_t global) {
    const std::int64_t place = global - part_.first_owned;
    if (place >= 0 && place < part_.owned_nodes) {
      const bool fresh = seen_[place] == 0;
      seen_[place] = 1;
      return {place, fresh};
    }
    const auto [found, fresh] = others_.try_emplace(global, std::ssize(part_.global_node));
    if (fresh) {
      part_.global_node.push_back(global);
      part_.mesh.points.resize(part_.mesh.points.size() + 3);
    }
    return {found->second, fresh};
  }

 private:
  MeshPart& part_;
  std::vector<char> seen_;
  std::unordered_map<std::int64_t, std::int64_t> others_;
};

void add_cell(const HexahedronMesh& coarse, const SetBits& sets, const Cell& cell, LocalNumbers& numbers,
              MeshPart& part) {
  const Ancestor ancestor = ancestor_of(cell);
  HexahedronMesh& mesh = part.mesh;
  std::array<std::int64_t, 8> nodes{};
  for (unsigned v = 0; v < 8; ++v) {
    const auto [node, fresh] = numbers.number(cell->vertex_dof_index(v, 0));
    nodes[k_vtk_of_lexicographic[v]] = node;
    if (!fresh) continue;
    for (unsigned k = 0; k < 3; ++k) mesh.points[3 * node + k] = cell->vertex(v)[k];
    SetBits::add(node, sets.of(ancestor, ancestor.vertices[v]), mesh);
    if (node >= part.owned_nodes) continue;
    int supports = 0;
    std::int64_t last = 0;
    visit_supports(ancestor, ancestor.vertices[v], [&](std::int64_t coarse_node) {
      ++supports;
      last = coarse_node;
    });
    if (supports == 1) part.coarse_nodes.emplace_back(last, node);
  }
  mesh.cells.insert(mesh.cells.end(), nodes.begin(), nodes.end());
  const std::size_t number = ancestor.cell;
  mesh.elastic.push_back(coarse.elastic[number]);
  if (!coarse.names.empty()) mesh.names.push_back(coarse.names[number]);
  part.coarse_cell.push_back(ancestor.cell);
}

/// p4est tells nothing on the terminal.
void quieten_p4est() {
  static const bool done = [] {
    sc_init(MPI_COMM_WORLD, 0, 0, nullptr, SC_LP_SILENT);
    p4est_init(nullptr, SC_LP_SILENT);
    return true;
  }();
  (void)done;
}

}  // namespace

MeshPart distribute_mesh(const HexahedronMesh& coarse, int refinements) {
  if (refinements < 0 || refinements > 6)
    throw ProjectError(
        fmt::format("distributed mesh: {} refinements; each makes 8 cells of one: take 0 to 6", refinements));
  Ranks::start();
  quieten_p4est();
  dealii::MultithreadInfo::set_thread_limit(1);
  Triangulation triangulation(MPI_COMM_WORLD);
  make_triangulation(coarse.points, coarse.cells, triangulation);
  triangulation.refine_global(static_cast<unsigned>(refinements));
  const dealii::FE_Q<3> element(1);
  DofHandler dofs(triangulation);
  dofs.distribute_dofs(element);

  MeshPart part;
  part.total_nodes = dofs.n_dofs();
  part.total_cells = triangulation.n_global_active_cells();
  part.mesh.left_support = coarse.left_support;
  part.mesh.support_stiffness = coarse.support_stiffness;
  const SetBits sets(coarse);
  LocalNumbers numbers(dofs.locally_owned_dofs(), part);
  for (const auto& cell : dofs.active_cell_iterators())
    if (cell->is_locally_owned()) add_cell(coarse, sets, cell, numbers, part);
  part.owned_cells = part.mesh.cell_count();
  for (const auto& cell : dofs.active_cell_iterators())
    if (cell->is_ghost()) add_cell(coarse, sets, cell, numbers, part);
  for (NodeSet* set : {&part.mesh.support_left, &part.mesh.support_right, &part.mesh.load,
                       &part.mesh.symmetry, &part.mesh.left_face})
    std::sort(set->begin(), set->end());
  for (const auto& [number, node] : part.coarse_nodes) {
    if (number == coarse.mouth_left) part.mesh.mouth_left = node;
    if (number == coarse.mouth_right) part.mesh.mouth_right = node;
  }
  return part;
}

}  // namespace knothe::offline
