#include "knothe/imaging/stereo/calibration_error.hpp"

#include <fmt/format.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"

namespace knothe::imaging {
namespace {

using Factor = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>;

/// Of one camera at the nodes of a surface.
struct Derivatives {
  std::vector<Eigen::Matrix<double, 2, 3>> by_place;
  Eigen::MatrixXd by_change;  ///< 2n × 19
};

Derivatives derivatives_of(const Camera& camera, const SurfacePoints& points) {
  Derivatives d;
  d.by_change.resize(2 * points.cols(), k_camera_parameters);
  for (Index a = 0; a < points.cols(); ++a) {
    d.by_place.push_back(camera.project(points.col(a)).jacobian);
    d.by_change.middleRows<2>(2 * a) = camera.parameter_jacobian(points.col(a));
  }
  return d;
}

/// Jᵀ Π values.
Eigen::MatrixXd weighted(const Derivatives& at, const Eigen::SparseMatrix<double>& precision,
                         const Eigen::MatrixXd& values) {
  const Eigen::MatrixXd forces = precision * values;
  Eigen::MatrixXd sum(3 * std::ssize(at.by_place), values.cols());
  for (Index a = 0; a < std::ssize(at.by_place); ++a)
    sum.middleRows<3>(3 * a) = at.by_place[a].transpose() * forces.middleRows<2>(2 * a);
  return sum;
}

void factorise(Factor& factor, const Eigen::SparseMatrix<double>& normal) {
  factor.compute(normal);
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 0))
    throw NumericalError(
        "the cameras do not determine the surface's motion, and so not what a change of them does");
}

/// Names of the entries of CameraChange, of each camera in turn.
std::vector<std::string> parameter_names(Index cameras) {
  std::vector<std::string> names;
  for (Index c = 0; c < cameras; ++c)
    for (const char* name : {"fx", "fy", "cx", "cy", "skew", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2",
                             "wx", "wy", "wz", "tx", "ty", "tz"})
      names.push_back(fmt::format("camera{}.{}", c, name));
  return names;
}

/// Which parameter each row is of.
std::vector<Index> parameters_of(const files::CsvTable& table, Index cameras) {
  const std::vector<std::string> known = parameter_names(cameras), rows = table.texts("parameter");
  std::vector<Index> places;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Index place = std::find(known.begin(), known.end(), rows[i]) - known.begin();
    if (place == std::ssize(known))
      table.fail(i, "parameter",
                 fmt::format("\"{}\" is no parameter of these {} cameras{}; the first is camera0.fx", rows[i],
                             cameras, did_you_mean(rows[i], known)));
    if (std::find(places.begin(), places.end(), place) != places.end())
      table.fail(i, "parameter", fmt::format("{} is there twice", rows[i]));
    places.push_back(place);
  }
  return places;
}

}  // namespace

CalibrationError read_calibration_error(const std::string& path, Index cameras, double unit) {
  const files::CsvTable table = files::CsvTable::read(path);
  const std::vector<Index> places = parameters_of(table, cameras);
  const Index n = std::ssize(places);
  if (n == 0) throw DataError(path + ": error: it names no parameter");
  CalibrationError error{table.texts("parameter"), {}};
  Eigen::MatrixXd root = Eigen::MatrixXd::Zero(n, n);
  if (table.has("std")) {
    root.diagonal() = Eigen::Map<const Eigen::VectorXd>(table.numbers("std").data(), n);
    for (Index i = 0; i < n; ++i)
      if (!(root(i, i) > 0))
        table.fail(i, "std", "a standard deviation is positive: leave out what is exact");
  } else {
    for (Index j = 0; j < n; ++j)
      root.col(j) = Eigen::Map<const Eigen::VectorXd>(table.numbers(error.names[j]).data(), n);
    const auto refuse = [&] {
      throw DataError(path +
                      ": error: this is no covariance: it must be symmetric, positive semidefinite, and "
                      "have a positive diagonal (leave out what is exact)");
    };
    if (!(root.diagonal().minCoeff() > 0)) refuse();
    const Eigen::VectorXd scale = root.diagonal().cwiseSqrt(), inverse = scale.cwiseInverse();
    const Eigen::MatrixXd correlation = inverse.asDiagonal() * root * inverse.asDiagonal();
    const numerics::SymmetricEigen axes(correlation);
    if ((correlation - correlation.transpose()).norm() > 1e-6 * n || axes.eigenvalues()[0] < -1e-6 * n)
      refuse();
    root = scale.asDiagonal() * axes.eigenvectors() * axes.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
    for (Index j = 0; j < n; ++j) error.names[j] = fmt::format("calibration.{}", j + 1);
  }
  error.factor = Eigen::MatrixXd::Zero(cameras * k_camera_parameters, n);
  for (Index i = 0; i < n; ++i) {
    const bool is_length = places[i] % k_camera_parameters >= k_camera_parameters - 3;
    error.factor.row(places[i]) = (is_length ? unit : 1) * root.row(i);
  }
  return error;
}

Eigen::MatrixXd calibration_sensitivity(const std::vector<Camera>& cameras, const StereoSurface& surface,
                                        const std::vector<CameraMotion>& motions,
                                        const SurfaceMotion& found) {
  const SurfacePoints& points = surface.points;
  const Index n = points.cols(), count = std::ssize(cameras), size = k_camera_parameters;
  const SurfacePoints moved = points + Eigen::Map<const SurfacePoints>(found.displacement.data(), 3, n);
  std::vector<CameraMotion> rest = motions;
  for (CameraMotion& m : rest) m.displacement.setZero();
  Factor of_shape, of_motion;
  factorise(of_shape, surface_motion(cameras, surface, rest).precision);
  factorise(of_motion, found.precision);
  std::vector<Derivatives> before, after;
  for (const Camera& camera : cameras)
    before.push_back(derivatives_of(camera, points)), after.push_back(derivatives_of(camera, moved));
  Eigen::MatrixXd shape(3 * n, size * count), right = Eigen::MatrixXd::Zero(3 * n, size * count);
  for (Index c = 0; c < count; ++c)
    shape.middleCols(size * c, size) =
        -of_shape.solve(weighted(before[c], motions[c].precision, before[c].by_change));
  for (Index c = 0; c < count; ++c) {
    Eigen::MatrixXd change(2 * n, size * count);
    for (Index a = 0; a < n; ++a)
      change.middleRows<2>(2 * a) =
          (after[c].by_place[a] - before[c].by_place[a]) * shape.middleRows<3>(3 * a);
    change.middleCols(size * c, size) += after[c].by_change - before[c].by_change;
    right -= weighted(after[c], motions[c].precision, change);
  }
  Eigen::MatrixXd sensitivity = of_motion.solve(right);
  for (Index a = 0; a < n; ++a)
    if (found.measured[a] == 0) sensitivity.middleRows<3>(3 * a).setZero();
  return sensitivity;
}

}  // namespace knothe::imaging
