#include "knothe/posterior/quadrature/marginal_density.hpp"

#include <gtest/gtest.h>

#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::posterior {
namespace {

/// The definition: a Gaussian kernel at every value, reflected at both bounds.
double kernel_sum(const Eigen::VectorXd& values, const Eigen::VectorXd& weights, double lower, double upper,
                  double point) {
  const double mean = weights.dot(values);
  const double std = std::sqrt(weights.dot((values.array() - mean).square().matrix()));
  const double width = 1.06 * std * std::pow(1 / weights.squaredNorm(), -0.2);
  double sum = 0;
  for (Eigen::Index i = 0; i < values.size(); ++i)
    for (const double centre : {values[i], 2 * lower - values[i], 2 * upper - values[i]})
      sum += weights[i] * numerics::normal_pdf((point - centre) / width) / width;
  return sum;
}

TEST(MarginalDensity, IsTheSumOfKernelsForFewAndManyValues) {
  for (const Eigen::Index n : {5, 300, 20000}) {
    // Weighted values that press against the upper bound.
    const Eigen::VectorXd values =
        (1.4 + 0.1 * numerics::monte_carlo_normal_points(n, 1, 1).col(0).array()).min(1.5).max(0.5);
    Eigen::VectorXd weights = numerics::monte_carlo_points(n, 1, 2).col(0);
    weights /= weights.sum();
    const MarginalDensity density = marginal_density(values, weights, Prior::uniform(0.5, 1.5));
    double largest = 0, difference = 0;
    for (std::size_t k = 0; k < density.points.size(); ++k) {
      const double exact = kernel_sum(values, weights, 0.5, 1.5, density.points[k]);
      largest = std::max(largest, exact);
      difference = std::max(difference, std::abs(exact - density.density[k]));
    }
    EXPECT_LT(difference, 4e-4 * largest) << n;
  }
}

}  // namespace
}  // namespace knothe::posterior
