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
  if (nodes == 3)
    return {{{0.5, 0.5, 0, 0}, 1.0 / 3}, {{0, 0.5, 0.5, 0}, 1.0 / 3}, {{0.5, 0, 0.5, 0}, 1.0 / 3}};
  std::vector<SampledPlace> places;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      const double xi = k_gauss[i], eta = k_gauss[j];
      places.push_back({{0.25 * (1 - xi) * (1 - eta), 0.25 * (1 + xi) * (1 - eta),
                         0.25 * (1 + xi) * (1 + eta), 0.25 * (1 - xi) * (1 + eta)},
                        0.25 * k_weight[i] * k_weight[j]});
    }
  return places;
}

Eigen::Vector3d interpolated(const Eigen::Matrix3Xd& points, const std::array<int, 4>& nodes,
                             const std::array<double, 4>& shape) {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  for (int a = 0; a < ImageMesh::nodes_of(nodes); ++a) x += shape[a] * points.col(nodes[a]);
  return x;
}

}  // namespace

ElementView::ElementView(const Camera& camera, const Eigen::Matrix3Xd& points,
                         const std::vector<std::array<int, 4>>& elements, const std::vector<char>& measured) {
  const ImageMesh seen = seen_mesh(camera, points, elements);
  std::vector<Eigen::Triplet<double>> entries;
  std::vector<char> determined(points.cols(), 0);
  for (const auto& nodes : elements) {
    const int count = ImageMesh::nodes_of(nodes);
    bool whole = true;
    for (int a = 0; a < count; ++a) whole = whole && measured[nodes[a]] != 0;
    const ShapeFunctions shape = seen.shape_functions(nodes, seen.x[nodes[0]], seen.y[nodes[0]]);
    if (!whole || !shape.is_valid()) continue;
    for (const SampledPlace& at : places_in(count)) {
      const Eigen::Vector2d pixel = camera.project(interpolated(points, nodes, at.shape)).pixel;
      const Place place{nodes, at.shape, shape.values(pixel.x(), pixel.y()), at.weight * shape.area()};
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

Eigen::VectorXd ElementView::perspective(const Camera& other, const Eigen::Matrix3Xd& points) const {
  const ImageMesh seen = seen_mesh(other, points, {});
  Eigen::MatrixX2d load = Eigen::MatrixX2d::Zero(points.cols(), 2);
  for (const Place& place : places_) {
    const int count = ImageMesh::nodes_of(place.nodes);
    Eigen::Vector2d left = other.project(interpolated(points, place.nodes, place.on_surface)).pixel;
    for (int a = 0; a < count; ++a)
      left -= place.in_picture[a] * Eigen::Vector2d(seen.x[place.nodes[a]], seen.y[place.nodes[a]]);
    for (int a = 0; a < count; ++a)
      load.row(place.nodes[a]) += place.area * place.in_picture[a] * left.transpose();
  }
  const Eigen::MatrixX2d b = fit_->solve(load);
  return b.transpose().reshaped();
}

}  // namespace knothe::imaging
