#include "knothe/numerics/statistics/distinct_draws.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
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

/// The points (n × d) in coordinates in which `covariance` is the unit matrix; directions without spread are
/// left out.
Eigen::MatrixXd whitened(const Eigen::MatrixXd& points, const Eigen::MatrixXd& covariance) {
  const SymmetricEigen axes(covariance);
  const double most = axes.eigenvalues().maxCoeff();
  const Eigen::VectorXd scale = axes.eigenvalues().unaryExpr(
      [&](double variance) { return variance > 1e-14 * most ? 1 / std::sqrt(variance) : 0.0; });
  return points * axes.eigenvectors() * scale.asDiagonal();
}

/// From each of the draws `repeated` a normal step of the covariance that the nearest of the draws `distinct`
/// have about their mean. Shortened, all alike, so that the steps add at most 1 % to the variance.
Eigen::MatrixXd local_steps(const Eigen::MatrixXd& draws, const std::vector<Eigen::Index>& distinct,
                            const std::vector<Eigen::Index>& repeated, const Eigen::MatrixXd& covariance) {
  constexpr double k_added_variance = 0.01;
  const Eigen::Index d = draws.cols();
  const auto m = static_cast<Eigen::Index>(distinct.size());
  const Eigen::Index neighbours = std::min(m, 2 * d + 2);
  const Eigen::MatrixXd positions = draws(distinct, Eigen::all), near = whitened(positions, covariance),
                        from = whitened(draws(repeated, Eigen::all), covariance);
  const Eigen::MatrixXd normal = monte_carlo_normal_points(from.rows(), static_cast<unsigned>(neighbours), 1);
  std::vector<Eigen::Index> order(distinct.size());
  Eigen::MatrixXd steps(from.rows(), d);
  double variance = 0;  // of a step, mean over steps and whitened coordinates
  for (Eigen::Index i = 0; i < from.rows(); ++i) {
    const Eigen::VectorXd distance = (near.rowwise() - from.row(i)).rowwise().squaredNorm();
    std::iota(order.begin(), order.end(), Eigen::Index{0});
    std::nth_element(order.begin(), order.begin() + (neighbours - 1), order.end(),
                     [&](Eigen::Index a, Eigen::Index b) { return distance[a] < distance[b]; });
    const auto nearest =
        Eigen::Map<const Eigen::Matrix<Eigen::Index, Eigen::Dynamic, 1>>(order.data(), neighbours);
    const Eigen::VectorXd factors = (normal.row(i).array() - normal.row(i).mean()).matrix().transpose() /
                                    std::sqrt(static_cast<double>(std::max<Eigen::Index>(1, neighbours - 1)));
    steps.row(i) = factors.transpose() * positions(nearest, Eigen::all);
    variance += (factors.transpose() * near(nearest, Eigen::all)).squaredNorm();
  }
  variance /= static_cast<double>(steps.size());
  return steps * std::min(1.0, std::sqrt(k_added_variance / std::max(variance, 1e-300)));
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
  std::vector<Eigen::Index> distinct, repeated;
  for (Eigen::Index j = 0; j < count; ++j)
    (seen.emplace(draws.row(j).begin(), draws.row(j).end()).second ? distinct : repeated).push_back(j);
  if (repeated.empty()) return draws;
  const Eigen::MatrixXd steps =
      local_steps(draws, distinct, repeated, moments_of(points, weights).covariance);
  for (std::size_t j = 0; j < repeated.size(); ++j) {
    for (Eigen::Index k = 0; k < draws.cols(); ++k)
      draws(repeated[j], k) =
          reflected(draws(repeated[j], k) + steps(static_cast<Eigen::Index>(j), k), lower[k], upper[k]);
  }
  return draws;
}

}  // namespace knothe::numerics
