#include "knothe/numerics/statistics/distinct_draws.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::numerics {
namespace {

/// Inside the bounds; what lies beyond one of them is reflected there.
double reflected(double value, double lower, double upper) {
  if (value < lower) value = 2 * lower - value;
  if (value > upper) value = 2 * upper - value;
  return std::clamp(value, lower, upper);
}

}  // namespace

Eigen::MatrixXd distinct_draws(const Eigen::Ref<const Eigen::MatrixXd>& points,
                               const Eigen::Ref<const Eigen::VectorXd>& weights, Eigen::Index count,
                               const Eigen::Ref<const Eigen::VectorXd>& lower,
                               const Eigen::Ref<const Eigen::VectorXd>& upper) {
  const std::vector<Eigen::Index> chosen = equal_draws(weights, count);
  Eigen::MatrixXd draws = points(chosen, Eigen::all);
  // By value: a chain that stayed has the same point several times.
  std::set<std::vector<double>> seen;
  std::vector<Eigen::Index> repeated;
  for (Eigen::Index j = 0; j < count; ++j)
    if (!seen.emplace(draws.row(j).begin(), draws.row(j).end()).second) repeated.push_back(j);
  if (repeated.empty()) return draws;
  const Eigen::Index d = points.cols();
  const Moments moments = moments_of(points, weights);
  const SymmetricEigen axes(moments.covariance);
  const Eigen::MatrixXd root = axes.eigenvectors() * axes.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
  // Silverman 1986, Eq. 4.14; less than 1, so that something is left of the point.
  const double dimension = static_cast<double>(d);
  const double width =
      std::min(0.5, std::pow(4 / ((dimension + 2) * static_cast<double>(seen.size())), 1 / (dimension + 4)));
  const double shrinkage = std::sqrt(1 - width * width);
  const Eigen::MatrixXd normal = monte_carlo_normal_points(count, d, 1);
  for (const Eigen::Index j : repeated) {
    const Eigen::VectorXd point = draws.row(j).transpose();
    const Eigen::VectorXd moved =
        moments.mean + shrinkage * (point - moments.mean) + width * (root * normal.row(j).transpose());
    for (Eigen::Index k = 0; k < d; ++k) draws(j, k) = reflected(moved[k], lower[k], upper[k]);
  }
  return draws;
}

}  // namespace knothe::numerics
