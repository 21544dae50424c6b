#include "knothe/imaging/stereo/stereo_surface.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"
#include "knothe/imaging/stereo/element_view.hpp"

namespace knothe::imaging {
namespace {

using Sparse = Eigen::SparseMatrix<double>;

constexpr int k_max_steps = 30;
constexpr double k_converged = 1e-9;  // last step, relative to the size of the surface
/// What keeps nodes without information regular, relative to the information of the others.
constexpr double k_ridge = 1e-9;

/// Block diagonal matrix with one block of 2 rows a node.
template <class Blocks>
Sparse block_diagonal(const Blocks& blocks) {
  constexpr int k_columns = Blocks::value_type::ColsAtCompileTime;
  std::vector<Eigen::Triplet<double>> entries;
  for (Index a = 0; a < std::ssize(blocks); ++a)
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < k_columns; ++j) entries.emplace_back(2 * a + i, k_columns * a + j, blocks[a](i, j));
  Sparse matrix(2 * std::ssize(blocks), k_columns * std::ssize(blocks));
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

/// A small multiple of 1 for the unknowns of the nodes that are not determined.
Sparse ridge(const Sparse& normal, const std::vector<char>& determined, int unknowns) {
  const double level = k_ridge * normal.diagonal().maxCoeff();
  std::vector<Eigen::Triplet<double>> entries;
  for (Index a = 0; a < std::ssize(determined); ++a)
    for (int k = 0; k < unknowns && determined[a] == 0; ++k)
      entries.emplace_back(unknowns * a + k, unknowns * a + k, level);
  Sparse matrix(normal.rows(), normal.cols());
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

/// Solves A x = b. Errors: NumericalError where A is singular.
Eigen::VectorXd solved(const Sparse& normal, const Eigen::VectorXd& right) {
  const Eigen::SimplicialLDLT<Sparse> factor(normal);
  if (factor.info() == Eigen::Success && factor.vectorD().minCoeff() > 0) {
    Eigen::VectorXd x = factor.solve(right);
    if (x.allFinite()) return x;
  }
  throw NumericalError(
      "the cameras do not determine the surface's position: their lines of sight are (nearly) parallel, or "
      "the speckle says nothing in places; take cameras 15° to 35° apart, or larger elements");
}

/// d_0c of another camera: where its reference shows the nodes of the mesh in the first camera's.
struct Match {
  Eigen::VectorXd place;  ///< px, 2 per node
  Sparse weight;
  std::vector<char> element_valid, measured;
};

/// Sharp speckle and small elements need a filter where the two views differ much.
Match match(const files::Picture& reference, const ImageMesh& mesh_of_first, CorrelationOptions options,
            const files::Picture& other, Index camera) {
  ImageCorrelation correlation(reference, mesh_of_first, options);
  const CorrelationResult result = correlation.correlate(other);
  if (!result.converged && options.prefilter_sigma < 1) {
    options.prefilter_sigma = 1;
    return match(reference, mesh_of_first, options, other, camera);
  }
  if (!result.converged)
    throw DataError(fmt::format(
        "the reference pictures of cameras 0 and {} cannot be matched ({}): they must show the same "
        "surface at the same time, from directions less than some 35° apart; or take larger elements",
        camera, result.message));
  const ImageMesh& mesh = correlation.mesh();
  Match found;
  found.place = result.displacement;
  for (int a = 0; a < mesh.node_count(); ++a)
    found.place.segment<2>(2 * a) += Eigen::Vector2d(mesh.x[a], mesh.y[a]);
  const double noise = std::max(1e-6, result.residual_rms);
  found.weight = correlation.matrix(result.element_valid) / (noise * noise);
  found.element_valid = result.element_valid;
  found.measured = measured_nodes(mesh, result.element_valid);
  return found;
}

/// Depth on a line of sight that comes nearest to another camera's.
double crossing_depth(const Ray& ray, const Ray& other) {
  const Eigen::Vector3d across = other.origin - ray.origin;
  const double aa = ray.direction.squaredNorm(), ab = ray.direction.dot(other.direction),
               bb = other.direction.squaredNorm();
  const double parallel = aa * bb - ab * ab;
  if (!(parallel > 1e-12 * aa * bb)) return 0;
  return (bb * ray.direction.dot(across) - ab * other.direction.dot(across)) / parallel;
}

/// Nodes that every camera matched, and their lines of sight from the first.
struct Sight {
  std::vector<Ray> rays;
  std::vector<char> measured;
  Eigen::VectorXd depth;
  [[nodiscard]] SurfacePoints points() const {
    SurfacePoints x(3, std::ssize(rays));
    for (Index a = 0; a < std::ssize(rays); ++a) x.col(a) = rays[a].origin + depth[a] * rays[a].direction;
    return x;
  }
};

/// The first depths; a node that is not matched takes the mean of the others.
Sight first_sight(const std::vector<Camera>& cameras, const ImageMesh& mesh,
                  const std::vector<Match>& matches) {
  Sight sight;
  sight.measured = matches.front().measured;
  for (const Match& m : matches)
    for (Index a = 0; a < std::ssize(sight.measured); ++a) sight.measured[a] &= m.measured[a];
  sight.depth = Eigen::VectorXd::Zero(mesh.node_count());
  double sum = 0, count = 0;
  for (int a = 0; a < mesh.node_count(); ++a) {
    sight.rays.push_back(cameras[0].ray({mesh.x[a], mesh.y[a]}));
    if (sight.measured[a] == 0) continue;
    sight.depth[a] = crossing_depth(sight.rays[a], cameras[1].ray(matches.front().place.segment<2>(2 * a)));
    sum += sight.depth[a], count += 1;
  }
  if (count == 0) throw UsageError("no node of the mesh is seen by all cameras");
  for (int a = 0; a < mesh.node_count(); ++a)
    if (sight.measured[a] == 0) sight.depth[a] = sum / count;
  return sight;
}

/// Gauss–Newton for the depths; returns the root of the mean square residual per redundant value, px.
double refine_depths(const std::vector<Camera>& cameras, const ImageMesh& mesh,
                     const std::vector<Match>& matches, Sight& sight) {
  const Index n = std::ssize(sight.rays), others = std::ssize(matches);
  double squares = 0, step = 1;
  for (int k = 0; k < k_max_steps && step > 1e-9; ++k) {
    Sparse normal(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    const SurfacePoints x = sight.points();
    const ElementView view(cameras[0], x, mesh.elements, sight.measured);
    squares = 0;
    for (Index c = 0; c < others; ++c) {
      std::vector<Eigen::Vector2d> slope(n);
      const Eigen::VectorXd perspective = view.perspective(cameras[c + 1], x);
      Eigen::VectorXd residual = Eigen::VectorXd::Zero(2 * n);
      for (Index a = 0; a < n; ++a) {
        const Projection p = cameras[c + 1].project(x.col(a));
        slope[a] = p.jacobian * sight.rays[a].direction;
        if (sight.measured[a] != 0)
          residual.segment<2>(2 * a) =
              matches[c].place.segment<2>(2 * a) - p.pixel - perspective.segment<2>(2 * a);
      }
      const Sparse j = block_diagonal(slope);
      const Sparse weighted = matches[c].weight * j;
      normal += Sparse(j.transpose() * weighted);
      right += weighted.transpose() * residual;
      squares += residual.squaredNorm();
    }
    const Eigen::VectorXd change = solved(normal + ridge(normal, sight.measured, 1), right);
    step = 0;
    for (Index a = 0; a < n; ++a)
      if (sight.measured[a] != 0) {
        sight.depth[a] += change[a];
        step = std::max(step, std::abs(change[a] / sight.depth[a]));
      }
  }
  const double seen = std::count(sight.measured.begin(), sight.measured.end(), 1);
  return std::sqrt(squares / (seen * (2 * others - 1)));
}

/// The elements that are wanted, with the nodes they need.
StereoSurface kept(const std::vector<Camera>& cameras, const SurfacePoints& points, const ImageMesh& mesh,
                   const std::vector<char>& wanted) {
  std::vector<int> number(mesh.x.size(), -1);
  std::vector<Index> nodes;
  std::vector<std::array<int, 4>> elements;
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    if (wanted[e] == 0) continue;
    auto element = mesh.elements[e];
    for (int& node : element) {
      if (node < 0) continue;
      if (number[node] < 0) number[node] = std::ssize(nodes), nodes.push_back(node);
      node = number[node];
    }
    elements.push_back(element);
  }
  StereoSurface surface;
  surface.points = points(Eigen::all, nodes);
  for (const Camera& camera : cameras) surface.meshes.push_back(seen_mesh(camera, surface.points, elements));
  // The first camera's mesh is the one that was given, to the last digit.
  for (Index a = 0; a < std::ssize(nodes); ++a)
    surface.meshes[0].x[a] = mesh.x[nodes[a]], surface.meshes[0].y[a] = mesh.y[nodes[a]];
  return surface;
}

}  // namespace

ImageMesh seen_mesh(const Camera& camera, const SurfacePoints& points,
                    const std::vector<std::array<int, 4>>& elements) {
  ImageMesh mesh;
  mesh.elements = elements;
  for (Index a = 0; a < points.cols(); ++a) {
    const Eigen::Vector2d pixel = camera.project(points.col(a)).pixel;
    mesh.x.push_back(pixel.x()), mesh.y.push_back(pixel.y());
  }
  return mesh;
}

StereoSurface find_surface(const std::vector<Camera>& cameras, const std::vector<files::Picture>& references,
                           const ImageMesh& mesh, const CorrelationOptions& options, double epipolar_bound) {
  if (cameras.size() < 2 || cameras.size() != references.size())
    throw UsageError(fmt::format("{} cameras and {} reference pictures: two or more of either, and as many",
                                 cameras.size(), references.size()));
  std::vector<Match> matches;
  for (Index c = 1; c < std::ssize(cameras); ++c)
    matches.push_back(match(references[0], mesh, options, references[c], c));
  Sight sight = first_sight(cameras, mesh, matches);
  const double epipolar = refine_depths(cameras, mesh, matches, sight);
  if (!(epipolar <= epipolar_bound))
    throw DataError(fmt::format(
        "the lines of sight of matched points miss each other by {:.3g} px (root mean square), more than {} "
        "px: the calibration does not belong to these pictures; check their order, the file's convention, "
        "and whether a camera moved since",
        epipolar, epipolar_bound));
  const SurfacePoints points = sight.points();
  std::vector<char> wanted(mesh.elements.size(), 1);
  for (const Match& m : matches)
    for (Index e = 0; e < std::ssize(wanted); ++e) wanted[e] &= m.element_valid[e];
  for (Index c = 1; c < std::ssize(cameras); ++c) {
    const ImageMesh seen = seen_mesh(cameras[c], points, mesh.elements);
    const auto inside = [&](int node) {
      return node < 0 || (seen.x[node] >= 0 && seen.y[node] >= 0 && seen.x[node] <= references[c].width - 1 &&
                          seen.y[node] <= references[c].height - 1);
    };
    for (Index e = 0; e < std::ssize(wanted); ++e)
      wanted[e] &= std::all_of(mesh.elements[e].begin(), mesh.elements[e].end(), inside) ? 1 : 0;
  }
  if (std::count(wanted.begin(), wanted.end(), 1) == 0)
    throw UsageError(
        "no element of the mesh is seen by all cameras: choose the region where their views overlap");
  StereoSurface surface = kept(cameras, points, mesh, wanted);
  surface.epipolar_rms = epipolar;
  return surface;
}

SurfaceMotion surface_motion(const std::vector<Camera>& cameras, const StereoSurface& surface,
                             const std::vector<CameraMotion>& motions) {
  const SurfacePoints& points = surface.points;
  const Index n = points.cols();
  if (cameras.size() != motions.size()) throw UsageError("as many motions as cameras are needed");
  SurfaceMotion result;
  std::vector<int> views(n, 0);
  for (const CameraMotion& m : motions) {
    if (m.displacement.size() != 2 * n || m.precision.rows() != 2 * n || std::ssize(m.measured) != n)
      throw UsageError("a camera's displacements, precision or nodes are not those of the surface");
    for (Index a = 0; a < n; ++a) views[a] += m.measured[a] != 0 ? 1 : 0;
  }
  result.measured.resize(n);
  for (Index a = 0; a < n; ++a) {
    result.measured[a] = views[a] >= 2 ? 1 : 0;
    if (views[a] >= 2) result.redundancy += 2 * views[a] - 3;
  }
  result.displacement = Eigen::VectorXd::Zero(3 * n);
  if (result.redundancy == 0) throw NumericalError("no node is measured by two cameras");
  std::vector<ImageMesh> seen;
  std::vector<ElementView> elements;
  std::vector<Eigen::VectorXd> before;  // of the lens alone
  for (Index c = 0; c < std::ssize(cameras); ++c) {
    seen.push_back(seen_mesh(cameras[c], points, {}));
    elements.emplace_back(cameras[c], points, surface.meshes.front().elements, motions[c].measured);
    before.push_back(elements[c].perspective(cameras[c], points));
  }
  const double reach = (points.rowwise().maxCoeff() - points.rowwise().minCoeff()).norm();
  double squares = 0, step = reach;
  for (int k = 0; k < k_max_steps && step > k_converged * reach; ++k) {
    Sparse normal(3 * n, 3 * n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(3 * n);
    result.chi_square = squares = 0;
    const SurfacePoints moved_points =
        points + Eigen::Map<const SurfacePoints>(result.displacement.data(), 3, n);
    for (Index c = 0; c < std::ssize(cameras); ++c) {
      std::vector<Eigen::Matrix<double, 2, 3>> gradient(n);
      const Eigen::VectorXd perspective = elements[c].perspective(cameras[c], moved_points) - before[c];
      Eigen::VectorXd residual = Eigen::VectorXd::Zero(2 * n);
      for (Index a = 0; a < n; ++a) {
        const Projection moved = cameras[c].project(moved_points.col(a));
        gradient[a] = moved.jacobian;
        if (motions[c].measured[a] != 0)
          residual.segment<2>(2 * a) = motions[c].displacement.segment<2>(2 * a) -
                                       (moved.pixel - Eigen::Vector2d(seen[c].x[a], seen[c].y[a])) -
                                       perspective.segment<2>(2 * a);
        if (result.measured[a] != 0) squares += residual.segment<2>(2 * a).squaredNorm();
      }
      const Sparse j = block_diagonal(gradient), weighted = motions[c].precision * j;
      normal += Sparse(j.transpose() * weighted);
      right += weighted.transpose() * residual;
      result.chi_square += residual.dot(motions[c].precision * residual);
    }
    result.precision = normal + ridge(normal, result.measured, 3);
    const Eigen::VectorXd change = solved(result.precision, right);
    result.displacement += change;
    step = change.cwiseAbs().maxCoeff();
  }
  if (!(step <= k_converged * reach))
    throw NumericalError(
        "no motion in space was found that explains what the cameras measured: were their pictures taken at "
        "the same time?");
  result.epipolar_rms = std::sqrt(squares / result.redundancy);
  result.std = displacement_std(result.precision);
  for (Index a = 0; a < n; ++a)
    if (result.measured[a] == 0)
      result.displacement.segment<3>(3 * a).setZero(), result.std.segment<3>(3 * a).setZero();
  return result;
}

Eigen::MatrixXd surface_strains(const SurfacePoints& points, const SurfaceMotion& motion,
                                const std::vector<std::array<int, 4>>& elements) {
  constexpr std::array<std::array<int, 2>, 6> k_components{{{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {0, 2}}};
  const SurfacePoints moved =
      points + Eigen::Map<const SurfacePoints>(motion.displacement.data(), 3, points.cols());
  Eigen::MatrixXd strains = Eigen::MatrixXd::Zero(6, points.cols());
  Eigen::RowVectorXd count = Eigen::RowVectorXd::Zero(points.cols());
  for (const auto& nodes : elements) {
    const int n = ImageMesh::nodes_of(nodes);
    if (!std::all_of(nodes.begin(), nodes.begin() + n, [&](int a) { return motion.measured[a] != 0; }))
      continue;
    for (int k = 0; k < n; ++k) {
      // At a corner of a triangle or bilinear quadrilateral the edges that meet there are its tangents.
      const int at = nodes[k], next = nodes[(k + 1) % n], before = nodes[(k + n - 1) % n];
      Eigen::Matrix<double, 3, 2> tangents, after;
      tangents << points.col(next) - points.col(at), points.col(before) - points.col(at);
      after << moved.col(next) - moved.col(at), moved.col(before) - moved.col(at);
      const Eigen::Matrix2d metric = tangents.transpose() * tangents;
      const Eigen::Matrix<double, 3, 2> dual = tangents * metric.inverse();
      const Eigen::Matrix3d e = 0.5 * dual * (after.transpose() * after - metric) * dual.transpose();
      for (int i = 0; i < 6; ++i) strains(i, at) += e(k_components[i][0], k_components[i][1]);
      count[at] += 1;
    }
  }
  return strains.array().rowwise() / count.array().max(1);
}

}  // namespace knothe::imaging
