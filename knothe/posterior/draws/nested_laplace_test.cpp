#include "knothe/posterior/draws/nested_laplace.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/posterior/testing/model_targets.hpp"

namespace knothe::posterior {
namespace {

void expect_agreement(const NestedLaplaceResult& result, const targets::ExactMoments& exact) {
  EXPECT_TRUE(result.converged);
  const Eigen::VectorXd mean = mean_of(result.sample);
  const Eigen::VectorXd std = covariance_of(result.sample).diagonal().cwiseSqrt();
  EXPECT_LE(((mean - exact.mean).array() / exact.standard_deviation.array()).abs().maxCoeff(),
            result.mean_error);
  EXPECT_LE((std.array() / exact.standard_deviation.array() - 1).abs().maxCoeff(), result.deviation_error);
  EXPECT_NEAR(result.sample.log_evidence, exact.log_evidence, 4 * result.sample.log_evidence_error + 1e-3);
}

TEST(NestedLaplace, IsTheConjugateFormulaForALinearModel) {
  targets::LinearGaussian target(numerics::monte_carlo_normal_points(15, 12, 3),
                                 numerics::monte_carlo_normal_points(15, 1, 4).col(0), 0.7);
  const NestedLaplaceResult result = nested_laplace(target);
  EXPECT_EQ(result.first.size(), 1U);  // nothing bends
  expect_agreement(result,
                   {target.mean(), target.covariance().diagonal().cwiseSqrt(), target.log_evidence()});
}

TEST(NestedLaplace, FindsTheSpreadOfTheEightSchools) {
  targets::EightSchools target;
  const NestedLaplaceResult result = nested_laplace(target);
  EXPECT_EQ(result.first, std::vector<Eigen::Index>{1});
  expect_agreement(result, targets::exact_moments(target));
  EXPECT_GT(result.sample.effective_size, 0.5 * static_cast<double>(result.sample.weights.size()));
}

TEST(NestedLaplace, DerivativesThatTheTargetLacksAreDifferences) {
  struct WithoutHessian : targets::EightSchools {
    [[nodiscard]] int available_derivatives() const override { return 1; }
  } target;
  expect_agreement(nested_laplace(target), targets::exact_moments(target));
}

/// Two modes in x₃, far apart: the weights around one know nothing of the other.
struct TwoModes : targets::Pointwise {
  [[nodiscard]] Eigen::Index dimension() const override { return 4; }
  double at(const Eigen::VectorXd& z, int order, Eigen::VectorXd& g, Eigen::MatrixXd& h) const override {
    double value = standard_normal_prior(z, order, g, h);
    const double k = 6, t = std::tanh(k * z[3]);
    value += k * std::abs(z[3]) + std::log1p(std::exp(-2 * k * std::abs(z[3])));  // log 2 cosh
    if (order >= 1) g[3] += k * t;
    if (order >= 2) h(3, 3) += k * k * (1 - t * t);
    return value;
  }
};

TEST(NestedLaplace, ASecondModeIsNotConverged) {
  TwoModes target;
  EXPECT_FALSE(nested_laplace(target).converged);
}

TEST(NestedLaplace, RefusesOneVariableAndCanBeInterrupted) {
  targets::LinearGaussian one(Eigen::MatrixXd::Ones(1, 1), Eigen::VectorXd::Ones(1), 1);
  EXPECT_THROW((void)nested_laplace(one), UsageError);
  targets::EightSchools target;
  NestedLaplaceOptions options;
  options.progress = [](double) { return false; };
  EXPECT_THROW((void)nested_laplace(target, options), Interrupted);
}

}  // namespace
}  // namespace knothe::posterior
