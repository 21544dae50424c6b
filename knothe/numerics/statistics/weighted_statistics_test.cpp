#include "knothe/numerics/statistics/weighted_statistics.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/kernel_density.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::numerics {
namespace {

/// The definition, by sorting everything.
double quantile_by_sorting(std::vector<double> x, std::vector<double> w, double level) {
  std::vector<std::size_t> order(x.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](auto a, auto b) { return x[a] < x[b]; });
  const double total = std::accumulate(w.begin(), w.end(), 0.0);
  double cumulative = 0, previous_c = -1, previous_x = 0;
  for (std::size_t i : order) {
    if (w[i] == 0) continue;
    const double c = cumulative + 0.5 * w[i] / total;
    if (c >= level)
      return previous_c < 0 ? x[i]
                            : previous_x + (x[i] - previous_x) * (level - previous_c) / (c - previous_c);
    cumulative += w[i] / total;
    previous_c = c;
    previous_x = x[i];
  }
  return previous_x;
}

TEST(WeightedQuantiles, AgreeWithTheDefinition) {
  std::mt19937 generator(3);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  WeightedQuantiles quantiles;
  const std::vector<double> levels = {0, 0.001, 0.025, 0.25, 0.5, 0.75, 0.975, 0.9999, 1};
  for (std::size_t n : {1u, 2u, 7u, 100u, 3000u})
    for (bool outlier : {false, true}) {
      std::vector<double> x(n), w(n), q(levels.size());
      for (std::size_t i = 0; i < n; ++i)
        x[i] = normal(generator), w[i] = i % 5 == 4 ? 0 : uniform(generator);
      if (outlier) x[0] = 1e9;  // everything else in one bin
      quantiles.compute(x, w, levels, q);
      for (std::size_t l = 0; l < levels.size(); ++l)
        EXPECT_NEAR(q[l], quantile_by_sorting(x, w, levels[l]), 1e-9 * (1 + std::abs(q[l])))
            << n << " " << levels[l];
    }
  std::vector<double> one(1);
  EXPECT_THROW(quantiles.compute({}, {}, std::vector<double>{0.5}, one), UsageError);
  EXPECT_THROW(
      quantiles.compute(std::vector<double>{1}, std::vector<double>{0}, std::vector<double>{0.5}, one),
      UsageError);
}

TEST(OrderStatistics, MedianAndQuantiles) {
  EXPECT_EQ(quantile({3, 1, 2}, 0.5), 2.0);
  EXPECT_EQ(quantile({3, 1, 2}, 0.0), 1.0);
  EXPECT_EQ(quantile({3, 1, 2}, 1.0), 3.0);
  EXPECT_DOUBLE_EQ(quantile({0, 10}, 0.99), 9.9);
  EXPECT_EQ(quantile({7}, 0.3), 7.0);
  EXPECT_EQ(upper_median(std::vector<double>{3, 1, 2}), 2);
  EXPECT_EQ(upper_median(std::vector<double>{4, 1, 3, 2}), 3);
  EXPECT_EQ(upper_median(std::vector<double>{}), 0);
}

TEST(KernelDensity, SilvermansBandwidth) {
  EXPECT_DOUBLE_EQ(silverman_bandwidth(3, 2, 2.68, 32), 0.9);  // 32^(−1/5) = ½
  EXPECT_DOUBLE_EQ(silverman_bandwidth(3, 2, 1.34, 32), 0.45);
  EXPECT_DOUBLE_EQ(silverman_bandwidth(3, 2, 0, 32), 0.9);  // half of the points are the same
  EXPECT_GT(silverman_bandwidth(2, 0, 0, 1), 0);
}

TEST(KernelDensity, IsTheSumOfItsKernels) {
  const std::vector<double> x = {0, 1, 5, 1e9}, w = {1, 2, 1, 0};
  const KernelDensity found = kernel_density(x, w, 0.7);
  const auto exact = [&](double at) {
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) sum += w[k] / 4 * normal_pdf((at - x[k]) / 0.7) / 0.7;
    return sum;
  };
  EXPECT_EQ(found.points.size(), 161U);
  EXPECT_DOUBLE_EQ(found.points.front(), -3.5 * 0.7);
  EXPECT_NEAR(found.points.back(), 5 + 3.5 * 0.7, 1e-12);
  for (std::size_t i = 0; i < found.points.size(); ++i)
    EXPECT_NEAR(found.density[i], exact(found.points[i]), 5e-4) << found.points[i];
  EXPECT_GT(exact(found.top), exact(found.top - 0.02));
  EXPECT_GT(exact(found.top), exact(found.top + 0.02));
}

TEST(KernelDensity, RefusesWhatItCannotUse) {
  const std::vector<double> x = {0, 1};
  EXPECT_THROW((void)kernel_density(x, std::vector<double>{1, 1}, 0), UsageError);
  EXPECT_THROW((void)kernel_density(x, std::vector<double>{1, -1}, 1), UsageError);
  EXPECT_THROW((void)kernel_density(x, std::vector<double>{0, 0}, 1), UsageError);
}

TEST(LatticeQuantiles, OfANormalDensityFromFewNodes) {
  const std::vector<double> levels = {0.025, 0.25, 0.5, 0.975};
  for (const double h : {0.1, 0.2, 0.4}) {
    std::vector<double> nodes, weights, found(levels.size());
    for (double x = -9 + 0.37 * h; x < 9; x += h) {
      nodes.push_back(5 - 2 * x);  // in any order
      weights.push_back(3 * normal_pdf(x));
    }
    lattice_quantiles(nodes, weights, std::vector(nodes.size(), 1.3 * 2 * h), levels, found);
    for (std::size_t i = 0; i < levels.size(); ++i)
      EXPECT_NEAR((found[i] - 5) / 2, normal_quantile(levels[i]), 1e-5) << h;
  }
  std::vector<double> one(1);
  lattice_quantiles(std::vector<double>{7}, std::vector<double>{2}, std::vector{0.1},
                    std::vector<double>{0.5}, one);
  EXPECT_NEAR(one[0], 7, 1e-9);
  for (const double width : {0.0, 1e-300, 1e-17}) {  // nothing of it is left beside the node
    lattice_quantiles(std::vector<double>{7}, std::vector<double>{2}, std::vector{width},
                      std::vector<double>{0.975}, one);
    EXPECT_NEAR(one[0], 7, 1e-12) << width;
  }
  EXPECT_THROW(
      lattice_quantiles(std::vector<double>{7}, std::vector<double>{0}, std::vector{0.1}, levels, one),
      UsageError);
}

}  // namespace
}  // namespace knothe::numerics
