#include "knothe/offline/full_order/finite_elements.hpp"

#include <deal.II/base/multithread_info.h>
#include <deal.II/base/quadrature_lib.h>
#include <deal.II/dofs/dof_handler.h>
#include <deal.II/fe/fe_q.h>
#include <deal.II/fe/fe_values.h>
#include <deal.II/grid/grid_tools.h>
#include <fmt/format.h>

#include <algorithm>
#include <cassert>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/offline/mesh/triangulation.hpp"

namespace knothe::offline {
void make_triangulation(std::span<const double> points, std::span<const std::int64_t> cells,
                        dealii::Triangulation<3>& triangulation) {
  std::vector<dealii::Point<3>> vertices(points.size() / 3);
  for (Index n = 0; n < std::ssize(vertices); ++n)
    vertices[n] = dealii::Point<3>(points[3 * n], points[3 * n + 1], points[3 * n + 2]);
  std::vector<dealii::CellData<3>> data(cells.size() / 8);
  for (Index cell = 0; cell < std::ssize(data); ++cell)
    for (int a = 0; a < 8; ++a)
      data[cell].vertices[a] = static_cast<unsigned>(cells[8 * cell + k_vtk_of_lexicographic[a]]);
  try {
    dealii::GridTools::consistently_order_cells(data);
    triangulation.create_triangulation(vertices, data, {});
  } catch (const std::exception& error) {
    throw DataError(fmt::format("deal.II refuses the mesh of {} hexahedra: {}", data.size(), error.what()));
  }
}

FiniteElements evaluate_finite_elements(std::span<const double> points, std::span<const std::int64_t> cells) {
  // No threads of deal.II's own: the processes of beam_simulator are forked later.
  dealii::MultithreadInfo::set_thread_limit(1);
  dealii::Triangulation<3> triangulation;
  make_triangulation(points, cells, triangulation);
  const dealii::FE_Q<3> element(1);
  dealii::DoFHandler<3> dof_handler(triangulation);
  dof_handler.distribute_dofs(element);
  const dealii::QGauss<3> quadrature(2);
  dealii::FEValues<3> values(element, quadrature,
                             dealii::update_values | dealii::update_gradients | dealii::update_JxW_values);

  FiniteElements result;
  result.gradients.resize(cells.size() / 8 * k_points_per_cell * 24);
  result.values.resize(cells.size() / 8 * k_points_per_cell * k_nodes_per_cell);
  result.weights.resize(cells.size() / 8 * k_points_per_cell);
  for (const auto& cell : dof_handler.active_cell_iterators()) {
    values.reinit(cell);
    const std::size_t number = cell->active_cell_index();
    const auto nodes = cells.subspan(8 * number, 8);
    // Making the edges' directions consistent may have turned a cell: find our place of each of its vertices.
    std::array<std::size_t, 8> place;
    for (unsigned vertex = 0; vertex < 8; ++vertex) {
      const auto found =
          std::find(nodes.begin(), nodes.end(), static_cast<std::int64_t>(cell->vertex_index(vertex)));
      assert(found != nodes.end());
      place[vertex] = found - nodes.begin();
    }
    for (unsigned point = 0; point < k_points_per_cell; ++point) {
      double* gradient = &result.gradients[(number * k_points_per_cell + point) * 24];
      double* value = &result.values[(number * k_points_per_cell + point) * k_nodes_per_cell];
      for (unsigned vertex = 0; vertex < 8; ++vertex) {
        value[place[vertex]] = values.shape_value(vertex, point);
        for (unsigned c = 0; c < 3; ++c)
          gradient[8 * c + place[vertex]] = values.shape_grad(vertex, point)[c];
      }
      result.weights[number * k_points_per_cell + point] = values.JxW(point);
    }
  }
  return result;
}

}  // namespace knothe::offline
