#include "knothe/posterior/prior/prior.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::posterior {
namespace {

constexpr double k_infinity = std::numeric_limits<double>::infinity();

std::vector<Prior> every_kind() {
  return {Prior::normal(0.9, 0.4472135954999579),
          Prior::normal(0.9, 0.4472135954999579).truncated(0.5, 1.5, "Y0"),
          Prior::normal(1.1, 0.4472135954999579).truncated(0.5, 1.5, "Ad"),
          Prior::normal(-3, 1).truncated(0, k_infinity, "far"),
          Prior::uniform(-2, 5),
          Prior::uniform(-2, 5).truncated(0, 1, "part"),
          Prior::lognormal(0.2, 0.25),
          Prior::lognormal(0.2, 0.25).truncated(0.9, 1.4, "log")};
}

/// ∫ π₀ by Simpson's rule over the support (or ± 12 scales of it).
double mass(const Prior& prior) {
  const double lower = std::isfinite(prior.lower()) ? prior.lower() : prior.from_standard_normal(-9).value;
  const double upper = std::isfinite(prior.upper()) ? prior.upper() : prior.from_standard_normal(9).value;
  const int n = 200000;
  const double h = (upper - lower) / n;
  double sum = 0;
  for (int i = 0; i <= n; ++i) {
    const double weight = i == 0 || i == n ? 1 : i % 2 ? 4 : 2;
    sum += weight * std::exp(prior.log_density(lower + i * h));
  }
  return sum * h / 3;
}

TEST(Prior, DensityIntegratesToOne) {
  for (const Prior& prior : every_kind()) EXPECT_NEAR(mass(prior), 1, 1e-6) << prior.describe();
}

TEST(Prior, DensityIsThatOfTheTransform) {
  // π₀(p) dp/dz = N(z; 0, 1): links density, distribution function and slope without a common formula.
  for (const Prior& prior : every_kind()) {
    for (double z : {-4.0, -1.3, -0.2, 0.0, 0.7, 2.5, 4.0}) {
      const auto [p, slope, curvature] = prior.from_standard_normal(z);
      EXPECT_NEAR(prior.log_density(p) + std::log(slope), -0.5 * z * z - 0.5 * std::log(2 * M_PI), 1e-9)
          << prior.describe() << " at z = " << z;
    }
  }
}

TEST(Prior, NormalScoresAreTheInverseOfTheTransform) {
  for (const Prior& prior : every_kind()) {
    for (double z : {-5.0, -3.0, -0.2, 0.0, 0.7, 2.5, 6.0})
      EXPECT_NEAR(prior.to_standard_normal(prior.from_standard_normal(z).value), z, 1e-7)
          << prior.describe() << " at z = " << z;
    for (double p : {-1e9, prior.lower(), prior.upper(), 1e9})
      EXPECT_LE(std::abs(prior.to_standard_normal(p)), 38) << prior.describe() << " at " << p;
  }
  EXPECT_DOUBLE_EQ(Prior::normal(2, 0.5).to_standard_normal(8), 12);
}

TEST(Prior, TransformDerivativesAgreeWithFiniteDifferences) {
  const double h = 1e-4;
  for (const Prior& prior : every_kind()) {
    for (double z : {-3.0, -0.5, 0.1, 1.7, 3.2}) {
      const auto left = prior.from_standard_normal(z - h), here = prior.from_standard_normal(z),
                 right = prior.from_standard_normal(z + h);
      EXPECT_NEAR(here.first, (right.value - left.value) / (2 * h), 1e-6 * (1 + here.first))
          << prior.describe();
      EXPECT_NEAR(here.second, (right.first - left.first) / (2 * h), 1e-6 * (1 + std::abs(here.second)));
    }
  }
}

TEST(Prior, LogDensityDerivativesAgreeWithFiniteDifferences) {
  const double h = 1e-5;
  for (const Prior& prior : every_kind()) {
    const double p = prior.from_standard_normal(0.3).value;
    EXPECT_NEAR(prior.log_density_slope(p), (prior.log_density(p + h) - prior.log_density(p - h)) / (2 * h),
                1e-6);
    EXPECT_NEAR(prior.log_density_curvature(p),
                (prior.log_density_slope(p + h) - prior.log_density_slope(p - h)) / (2 * h), 1e-5);
  }
}

TEST(Prior, TransformInvertsAndStaysInside) {
  for (const Prior& prior : every_kind()) {
    for (double z : {-30.0, -8.0, -3.0, 0.0, 3.0, 8.0, 30.0}) {
      const auto [p, first, second] = prior.from_standard_normal(z);
      EXPECT_TRUE(std::isfinite(p) && std::isfinite(first) && std::isfinite(second)) << prior.describe() << z;
      EXPECT_GE(p, prior.lower());
      EXPECT_LE(p, prior.upper());
    }
  }
}

TEST(Prior, TheTruncationOfThePapersPriorIsRenormalised) {
  // N(0.9, 0.2) on [0.5, 1.5] keeps Φ(0.6/√0.2) − Φ(−0.4/√0.2), from the tables of the normal distribution.
  const double kept = 0.5 * (std::erf(0.6 / std::sqrt(0.4)) + std::erf(0.4 / std::sqrt(0.4)));
  EXPECT_NEAR(every_kind()[1].log_density(0.9), -0.5 * std::log(2 * M_PI * 0.2) - std::log(kept), 1e-13);
}

TEST(Prior, TooLittleMassInTheBoxIsRefused) {
  try {
    (void)Prior::normal(9, 1).truncated(0.5, 1.5, "Y0");
    FAIL();
  } catch (const ProjectError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("the prior of \"Y0\", normal(9, 1)"), std::string::npos) << text;
    EXPECT_NE(text.find("[0.5, 1.5] (at least 1e-6 is needed)"), std::string::npos) << text;
    EXPECT_NE(text.find("move or widen the prior"), std::string::npos) << text;
  }
}

TEST(PriorTransform, TableAgreesWithTheExactFormula) {
  const std::vector<Prior> priors = every_kind();
  const PriorTransform transform(priors);
  const Eigen::Index n = 4001, d = transform.dimension();
  Eigen::MatrixXd z(n, d), p(n, d), first(n, d), second(n, d);
  for (Eigen::Index k = 0; k < d; ++k) z.col(k).setLinSpaced(n, -9.03, 9.01);
  transform.evaluate(z, 2, p, first, second);
  for (Eigen::Index k = 0; k < d; ++k) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto exact = priors[k].from_standard_normal(z(i, k));
      const double scale = 1 + std::abs(exact.value);
      ASSERT_NEAR(p(i, k), exact.value, 1e-12 * scale) << priors[k].describe() << z(i, k);
      ASSERT_NEAR(first(i, k), exact.first, 1e-9 * scale);
      ASSERT_NEAR(second(i, k), exact.second, 1e-6 * scale);
    }
  }
}

}  // namespace
}  // namespace knothe::posterior
