#include "knothe/imaging/series/camera_drift.hpp"

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {

/// n × modes: the displacement that each motion of size 1 makes in each observation.
Eigen::MatrixXd motions(Drift drift, const std::vector<double>& points,
                        const std::vector<std::int64_t>& component, Index n) {
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(n, drift_modes(drift));
  const std::size_t first = component[0], second = component[1];
  double middle[2] = {0, 0};
  const auto at = [&](Index i, std::size_t c) { return points[3 * i + c]; };
  for (Index i = 0; i < n; ++i) middle[0] += at(i, first) / n, middle[1] += at(i, second) / n;
  double squares = 0;
  for (Index i = 0; i < n; ++i)
    squares += std::pow(at(i, first) - middle[0], 2) + std::pow(at(i, second) - middle[1], 2);
  const double radius = std::sqrt(squares / n);
  for (Index i = 0; i < n; ++i) {
    const bool is_first = static_cast<std::size_t>(component[i]) == first;
    b(i, is_first ? 0 : 1) = 1;
    if (b.cols() == 3)
      b(i, 2) = (is_first ? -(at(i, second) - middle[1]) : at(i, first) - middle[0]) / radius;
  }
  return b;
}

}  // namespace

int drift_modes(Drift drift) {
  return drift == Drift::none ? 0 : drift == Drift::shift ? 2 : 3;
}

void add_drift_places(Drift drift, std::vector<double>& points, std::vector<std::int64_t>& component) {
  const double first[3] = {points[0], points[1], points[2]};
  for (int k = 0; k < drift_modes(drift); ++k) {
    points.insert(points.end(), first, first + 3);
    component.push_back(component[0]);
  }
}

Eigen::SparseMatrix<double> with_drift(const Eigen::SparseMatrix<double>& precision, Drift drift,
                                       const std::vector<double>& points,
                                       const std::vector<std::int64_t>& component, double std) {
  if (drift == Drift::none) return precision;
  if (!(std > 0)) throw UsageError("drift of the camera: its standard deviation must be positive");
  const Index n = precision.rows(), modes = drift_modes(drift);
  const Eigen::MatrixXd b = motions(drift, points, component, n), weighted = precision * b;
  Eigen::MatrixXd block = b.transpose() * weighted;
  block.diagonal().array() += 1 / (std * std);
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(precision.nonZeros() + 2 * modes * n);
  for (int column = 0; column < precision.outerSize(); ++column)
    for (Eigen::SparseMatrix<double>::InnerIterator it(precision, column); it; ++it)
      entries.emplace_back(it.row(), it.col(), it.value());
  for (Index k = 0; k < modes; ++k) {
    const int at = n + k;
    for (Index i = 0; i < n; ++i)
      if (weighted(i, k) != 0) {
        entries.emplace_back(i, at, -weighted(i, k));
        entries.emplace_back(at, i, -weighted(i, k));
      }
    for (Index j = 0; j < modes; ++j) entries.emplace_back(at, n + j, 0.5 * (block(k, j) + block(j, k)));
  }
  Eigen::SparseMatrix<double> joint(n + modes, n + modes);
  joint.setFromTriplets(entries.begin(), entries.end());
  return joint;
}

}  // namespace knothe::imaging
