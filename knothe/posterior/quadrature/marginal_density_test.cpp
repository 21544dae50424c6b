#include "knothe/posterior/quadrature/marginal_density.hpp"

#include <gtest/gtest.h>

#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::posterior {
namespace {

double kernel(double u) {
  return 0.5 * (3 - u * u) * numerics::normal_pdf(u);
}

/// The definition: a kernel φ(u) (3 − u²)/2 at every value, reflected at both bounds; below 0 it is cut off.
double kernel_sum(const Eigen::VectorXd& values, const Eigen::VectorXd& weights, double lower, double upper,
                  double point) {
  const double mean = weights.dot(values);
  const double std = std::sqrt(weights.dot((values.array() - mean).square().matrix()));
  const double width = 1.06 * std * std::pow(1 / weights.squaredNorm(), -0.2);
  double sum = 0;
  for (Eigen::Index i = 0; i < values.size(); ++i)
    for (const double centre : {values[i], 2 * lower - values[i], 2 * upper - values[i]})
      sum += weights[i] * kernel((point - centre) / width) / width;
  return std::max(0.0, sum);
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

TEST(MarginalDensity, IsThatOfAnExactPosteriorHoweverFewPointsThereAre) {
  // Quantiles of a Gaussian and of a lognormal: by a Gaussian kernel the peaks would be 8 and 4 % too low.
  for (const Eigen::Index n : {150, 700, 20000}) {
    Eigen::VectorXd normal(n), skewed(n);
    for (Eigen::Index i = 0; i < n; ++i) normal[i] = numerics::normal_quantile((i + 0.5) / n);
    skewed = (0.25 * normal.array()).exp();
    const Eigen::VectorXd weights = Eigen::VectorXd::Constant(n, 1.0 / n);
    const MarginalDensity a = marginal_density(normal, weights, Prior::normal(0, 1));
    const MarginalDensity b = marginal_density(skewed, weights, Prior::lognormal(0, 1));
    double of_normal = 0, of_skewed = 0, integral = 0;
    for (std::size_t k = 0; k < a.points.size(); ++k) {
      const double x = b.points[k], exact = x > 0 ? numerics::normal_pdf(std::log(x) / 0.25) / (0.25 * x) : 0;
      of_normal = std::max(of_normal, std::abs(a.density[k] - numerics::normal_pdf(a.points[k])));
      of_skewed = std::max(of_skewed, std::abs(b.density[k] - exact));
      integral += a.density[k] * (a.points[1] - a.points[0]);
    }
    const double peak = numerics::normal_pdf(0);
    EXPECT_LT(of_normal, 0.015 * peak) << n;
    EXPECT_LT(of_skewed, 0.03 * peak / 0.25) << n;
    EXPECT_NEAR(integral, 1, 1e-3) << n;
  }
}

}  // namespace
}  // namespace knothe::posterior
