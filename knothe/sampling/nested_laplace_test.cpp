#include "knothe/sampling/nested_laplace.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/sampling/testing/model_targets.hpp"

namespace knothe::sampling {
namespace {

struct Exact {
  Eigen::VectorXd mean, std;
  double log_evidence;
};

void expect_agreement(const NestedLaplaceResult& result, const Exact& exact) {
  EXPECT_TRUE(result.converged);
  const Eigen::VectorXd mean = mean_of(result.sample);
  const Eigen::VectorXd std = covariance_of(result.sample).diagonal().cwiseSqrt();
  EXPECT_LE(((mean - exact.mean).array() / exact.std.array()).abs().maxCoeff(), result.mean_error);
  EXPECT_LE((std.array() / exact.std.array() - 1).abs().maxCoeff(), result.deviation_error);
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

/// Given log τ the schools are a linear model: closed form for each, and the sum over an even grid.
Exact schools_by_quadrature(const targets::EightSchools& target) {
  constexpr int n = 801;
  const double step = 18.0 / (n - 1);
  Eigen::VectorXd log_weight(n);
  Eigen::MatrixXd first(n, 10), second(n, 10);
  for (int i = 0; i < n; ++i) {
    const double z1 = -12 + step * i, tau = std::exp(1 + z1);
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(8, 9);
    Eigen::VectorXd y(8);
    double log_scale = 0;
    for (Eigen::Index j = 0; j < 8; ++j) {
      const double s = target.standard_error[static_cast<std::size_t>(j)];
      a(j, 0) = 5 / s, a(j, 1 + j) = tau / s;
      y[j] = target.effect[static_cast<std::size_t>(j)] / s;
      log_scale += std::log(s);
    }
    const targets::LinearGaussian given(a, y, 1);
    const Eigen::VectorXd mean = given.mean(), variance = given.covariance().diagonal();
    const auto put = [&](Eigen::Index k, double m, double v) { first(i, k) = m, second(i, k) = v + m * m; };
    put(0, mean[0], variance[0]);
    put(1, z1, 0);
    for (Eigen::Index j = 0; j < 8; ++j) put(2 + j, mean[1 + j], variance[1 + j]);
    log_weight[i] =
        given.log_evidence() - log_scale - 0.5 * (z1 * z1 + targets::k_log_two_pi) + std::log(step);
  }
  const double top = log_weight.maxCoeff();
  Eigen::VectorXd weight = (log_weight.array() - top).exp();
  const double sum = weight.sum();
  weight /= sum;
  const Eigen::VectorXd mean = first.transpose() * weight;
  return {mean, (second.transpose() * weight - mean.cwiseAbs2()).cwiseSqrt(), top + std::log(sum)};
}

TEST(NestedLaplace, FindsTheSpreadOfTheEightSchools) {
  targets::EightSchools target;
  const NestedLaplaceResult result = nested_laplace(target);
  EXPECT_EQ(result.first, std::vector<Eigen::Index>{1});
  expect_agreement(result, schools_by_quadrature(target));
  EXPECT_GT(result.sample.effective_size, 0.5 * static_cast<double>(result.sample.weights.size()));
}

TEST(NestedLaplace, DerivativesThatTheTargetLacksAreDifferences) {
  struct WithoutHessian : targets::EightSchools {
    [[nodiscard]] int available_derivatives() const override { return 1; }
  } target;
  expect_agreement(nested_laplace(target), schools_by_quadrature(target));
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
}  // namespace knothe::sampling
