#include "knothe/offline/latin/latin_activation.hpp"

#include <algorithm>

#include "knothe/base/index.hpp"
#include "knothe/offline/latin/latin_local_stage.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;
using Eigen::VectorXd;

Activation find_activation(const LatinBody& body, const MatrixXd& expanded, const MatrixXd& coordinates,
                           std::span<const double> thresholds, double fraction) {
  const Index count = coordinates.cols();
  const Index lanes = padded_lanes(count);
  // The law with a lowered threshold and A_d = 1 / Y₀ tells what is wanted: d > 0 where Y > fraction Y₀, and
  // d / (1 - d) = Y / Y₀ - fraction.
  VectorXd threshold = VectorXd::Constant(lanes, k_never), brittleness = VectorXd::Zero(lanes);
  for (Index i = 0; i < count; ++i) {
    const double y0 = thresholds[i];
    threshold[i] = fraction * y0;
    brittleness[i] = 1 / std::max(y0, 1e-300);
  }
  const VectorXd none = VectorXd::Zero(lanes);
  VectorXd damage(lanes);
  constexpr Index k_width = 6 * k_points_per_cell;
  MatrixXd strain = MatrixXd::Zero(lanes, k_width);
  const MatrixXd strains = body.waiting_strains(expanded);
  Activation result;
  VectorXd largest(lanes);
  for (Index c = 0; c < std::ssize(body.waiting()); ++c) {
    strain.topRows(count).noalias() = coordinates.transpose() * strains.middleCols(k_width * c, k_width);
    largest.setZero();
    for (Index point = 0; point < k_points_per_cell; ++point) {
      evaluate_local_stage({static_cast<std::size_t>(lanes), threshold.data(), brittleness.data(),
                            &strain(0, 6 * point), none.data(), damage.data(), nullptr, nullptr},
                           body.structure().elastic());
      largest = largest.cwiseMax(damage);
    }
    if (!(largest.maxCoeff() > 0)) continue;
    result.joining.push_back(body.waiting()[c]);
    for (Index i = 0; i < count; ++i)
      if (largest[i] / (1 - largest[i]) > 1 - fraction) result.missed.push_back(i);
  }
  std::sort(result.missed.begin(), result.missed.end());
  result.missed.erase(std::unique(result.missed.begin(), result.missed.end()), result.missed.end());
  return result;
}

}  // namespace knothe::offline
