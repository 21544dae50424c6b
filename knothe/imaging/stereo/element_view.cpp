#include "knothe/imaging/stereo/element_view.hpp"

#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/imaging/stereo/stereo_surface.hpp"

namespace knothe::imaging {
namespace {

/// Natural coordinates and weights of Gauss's rule with three points a direction.
constexpr std::array<double, 3> k_gauss{-0.7745966692414834, 0, 0.7745966692414834};
constexpr std::array<double, 3> k_weight{5.0 / 9, 8.0 / 9, 5.0 / 9};

struct SampledPlace {
  std::array<double, 4> shape{};
  double weight = 0;  ///< they add up to 1
};

/// Where c is taken: the middles of a triangle's sides, where c, of second order, is largest.
std::vector<SampledPlace> places_in(int nodes) {
  if (nodes == 3) return {{{0.5, 0.5, 0, 0}, 1.0 / 3}, {{0, 0.5, 0.5, 0}, 1.0 / 3}, {{0.5, 0, 0.5, 0}, 1.0 / 3}};
  std::vector<SampledPlace> places;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      const double xi = k_gauss[i], eta = k_gauss[j];
      places.push_back({{0.25 * (1 - xi) * (1 - eta), 0.25 * (1 + xi) * (1 - eta), 0.25 * (1 + xi) * (1 + eta),
                         0.25 * (1 - xi) * (1 + eta)},
                        0.25 * k_weight[i] * k_weight[j]});
    }
  return places;
}

}  // namespace

std::vector<ElementView::Place> ElementView::places_of(const std::array<int, 4>& nodes) const {
  const int count = ImageMesh::nodes_of(nodes);
  const ShapeFunctions shape = seen_.shape_functions(nodes, seen_.x[nodes[0]], seen_.y[nodes[0]]);
  std::vector<Place> places;
  if (!shape.is_valid()) return places;
  for (const SampledPlace& at : places_in(count)) {
    Eigen::Vector3d x = Eigen::Vector3d::Zero();
    for (int a = 0; a < count; ++a) x += at.shape[a] * points_.col(nodes[a]);
    const Eigen::Vector2d pixel = camera_.project(x).pixel;
    places.push_back(
        {nodes, at.shape, shape.values(pixel.x(), pixel.y()), pixel, at.weight * shape.area()});
  }
  return places;
}

ElementView::ElementView(const Camera& camera, const Eigen::Matrix3Xd& points,
                         const std::vector<std::array<int, 4>>& elements, const std::vector<char>& measured)
    : camera_(camera), points_(points), seen_(seen_mesh(camera, points, elements)) {
  std::vector<Eigen::Triplet<double>> entries;
  std::vector<char> determined(points.cols(), 0);
  for (const auto& nodes : elements) {
    const int count = ImageMesh::nodes_of(nodes);
    bool whole = true;
    for (int a = 0; a < count; ++a) whole = whole && measured[nodes[a]] != 0;
    if (!whole) continue;
    for (const Place& place : places_of(nodes)) {
      places_.push_back(place);
      for (int a = 0; a < count; ++a) {
        determined[nodes[a]] = 1;
        for (int b = 0; b < count; ++b)
          entries.emplace_back(nodes[a], nodes[b], place.area * place.in_picture[a] * place.in_picture[b]);
      }
    }
  }
  for (Index a = 0; a < points.cols(); ++a)
    if (determined[a] == 0) entries.emplace_back(a, a, 1);
  Eigen::SparseMatrix<double> mass(points.cols(), points.cols());
  mass.setFromTriplets(entries.begin(), entries.end());
  fit_ = std::make_shared<const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>>(mass);
}

Eigen::VectorXd ElementView::perspective(const Eigen::VectorXd& u) const {
  const Index n = points_.cols();
  Eigen::MatrixX2d at_nodes(n, 2), load = Eigen::MatrixX2d::Zero(n, 2);
  for (Index a = 0; a < n; ++a) {
    const Eigen::Vector2d moved = camera_.project(points_.col(a) + u.segment<3>(3 * a)).pixel;
    at_nodes.row(a) << moved.x() - seen_.x[a], moved.y() - seen_.y[a];
  }
  for (const Place& place : places_) {
    const int count = ImageMesh::nodes_of(place.nodes);
    Eigen::Vector3d moved = Eigen::Vector3d::Zero();
    Eigen::Vector2d followed = Eigen::Vector2d::Zero();
    for (int a = 0; a < count; ++a) {
      const int node = place.nodes[a];
      moved += place.on_surface[a] * (points_.col(node) + u.segment<3>(3 * Index{node}));
      followed += place.in_picture[a] * at_nodes.row(node).transpose();
    }
    const Eigen::Vector2d left = camera_.project(moved).pixel - place.pixel - followed;
    for (int a = 0; a < count; ++a)
      load.row(place.nodes[a]) += place.area * place.in_picture[a] * left.transpose();
  }
  const Eigen::MatrixX2d b = fit_->solve(load);
  Eigen::VectorXd values(2 * n);
  for (Index a = 0; a < n; ++a) values.segment<2>(2 * a) = b.row(a).transpose();
  return values;
}

}  // namespace knothe::imaging
