#include <gtest/gtest.h>

#include <cmath>

#include "knothe/posterior/draws/nested_laplace.hpp"
#include "knothe/posterior/map/testing/accuracy_support.hpp"

namespace knothe::posterior::accuracy {
namespace {

/// Gradient and Hessian against central differences of value and gradient at a few points.
void expect_exact_derivatives(LogDensity& target, double spread) {
  const Eigen::Index d = target.dimension();
  const Eigen::MatrixXd at = spread * numerics::monte_carlo_normal_points(4, d, 5);
  LogDensityBatch here, forward, backward;
  here.resize(4, d, 2), forward.resize(4, d, 2), backward.resize(4, d, 2);
  target.evaluate(at, 2, here);
  const double step = 1e-5;
  for (Eigen::Index a = 0; a < d; ++a) {
    Eigen::MatrixXd up = at, down = at;
    up.col(a).array() += step;
    down.col(a).array() -= step;
    target.evaluate(up, 1, forward);
    target.evaluate(down, 1, backward);
    for (Eigen::Index i = 0; i < 4; ++i) {
      const double slope = (forward.value[i] - backward.value[i]) / (2 * step);
      EXPECT_NEAR(here.gradient(i, a), slope, 1e-6 * (1 + std::abs(here.value[i]))) << "variable " << a;
      for (Eigen::Index b = 0; b < d; ++b) {
        const double bend = (forward.gradient(i, b) - backward.gradient(i, b)) / (2 * step);
        EXPECT_NEAR(here.hessian(i, packed_index(a, b)), bend,
                    1e-6 * (1 + std::abs(here.gradient(i, a)) + std::abs(bend)))
            << "variables " << a << ", " << b;
      }
    }
  }
}

TEST(ModelTargets, DerivativesAgreeWithDifferences) {
  auto linear = linear_gaussian(10);
  expect_exact_derivatives(linear, 1);
  auto logistic = logistic_regression();
  expect_exact_derivatives(logistic, 1);
  auto schools = eight_schools();
  expect_exact_derivatives(schools, 1);
  auto volatility = stochastic_volatility();
  expect_exact_derivatives(volatility, 0.7);
  targets::OxygenDemandDensity demand;
  expect_exact_derivatives(demand, 1);
}

TEST(Accuracy, LinearGaussianIsTheConjugateFormulaAtOrderOne) {
  for (Eigen::Index d : {2, 10, 50}) {
    auto target = linear_gaussian(d);
    const Accuracy accuracy = measure(target, reference_of(target));
    EXPECT_EQ(accuracy.result.order, 1) << d;
    EXPECT_TRUE(accuracy.correction.trust.trusted) << d;
    EXPECT_LT(accuracy.result.verified_diagnostic, 1e-12) << d;
    EXPECT_LT(accuracy.mean, 1e-8) << d;
    EXPECT_LT(accuracy.standard_deviation, 1e-8) << d;
    EXPECT_LT(accuracy.log_evidence, 1e-8) << d;
    const Eigen::MatrixXd covariance = target.covariance();
    EXPECT_LT((accuracy.correction.covariance - covariance).norm() / covariance.norm(), 1e-8) << d;
  }
}

/// Within 0.05 std in means and 5 % in std of chains whose own errors are far smaller.
void expect_agreement(const Accuracy& accuracy, const Reference& reference) {
  ASSERT_LT(reference.mean_error, 0.015) << "the chains are too short to judge by";
  ASSERT_LT(reference.std_error, 0.015) << "the chains are too short to judge by";
  EXPECT_LT(accuracy.mean, 0.05);
  EXPECT_LT(accuracy.standard_deviation, 0.05);
}

TEST(Accuracy, ChainsAndStudentsTAgreeWithTheConjugateFormula) {  // the references themselves
  auto target = linear_gaussian(10);
  Reference chains = reference_by_chains(target, 20000, 1);
  add_evidence(target, 7, chains);
  const Reference exact = reference_of(target);
  EXPECT_LT(((chains.mean - exact.mean).array() / exact.standard_deviation.array()).abs().maxCoeff(),
            5 * chains.mean_error);
  EXPECT_LT((chains.standard_deviation.array() / exact.standard_deviation.array() - 1).abs().maxCoeff(),
            5 * chains.std_error);
  EXPECT_NEAR(chains.log_evidence, exact.log_evidence, 5 * chains.log_evidence_error + 1e-3);
}

TEST(Accuracy, LogisticRegressionAgreesWithLongChains) {
  auto target = logistic_regression();
  Reference reference = reference_by_chains(target, 10000, 3);
  add_evidence(target, 8, reference);
  const Accuracy accuracy = measure(target, reference, logistic_regression_options());
  expect_agreement(accuracy, reference);
  EXPECT_TRUE(accuracy.correction.trust.trusted) << accuracy.correction.trust.reason;
  EXPECT_LT(accuracy.log_evidence, 0.005 + 4 * reference.log_evidence_error);
}

TEST(Accuracy, EightSchoolsAgreeWithQuadratureOverTheirSpread) {
  auto target = eight_schools();
  const Reference reference = reference_of(target);
  const Accuracy accuracy = measure(target, reference, eight_schools_options());
  EXPECT_LT(accuracy.mean, 0.05);
  EXPECT_LT(accuracy.standard_deviation, 0.05);
  EXPECT_LT(accuracy.log_evidence, 0.02);
}

/// The map is not good enough and says so; its weights make the moments right all the same.
TEST(Accuracy, StochasticVolatilityAgreesWithLongChainsAndIsNotCalledTrusted) {
  auto target = stochastic_volatility();
  const Reference reference = reference_by_chains(target, 16000, 5);
  const Accuracy accuracy = measure(target, reference, stochastic_volatility_options());
  EXPECT_EQ(accuracy.result.order, 2);
  EXPECT_LT(accuracy.result.verified_diagnostic, 0.25);  // 0.5 for the best affine map
  EXPECT_FALSE(accuracy.result.tolerance_reached);
  EXPECT_FALSE(accuracy.correction.trust.trusted);
  EXPECT_LT(accuracy.mean, 0.05);
  EXPECT_LT(accuracy.standard_deviation, 0.05);
}

/// μ and φ first, then the states as a Gaussian: what the map cannot do.
TEST(Accuracy, StochasticVolatilityByAFewVariablesFirstIsTrusted) {
  auto target = stochastic_volatility();
  const Reference reference = reference_by_chains(target, 40000, 5);
  ASSERT_LT(reference.mean_error, 0.015) << "the chains are too short to judge by";
  ASSERT_LT(reference.std_error, 0.015) << "the chains are too short to judge by";
  const NestedLaplaceResult result = nested_laplace(target);
  EXPECT_EQ(result.first, (std::vector<Eigen::Index>{0, 1}));
  EXPECT_TRUE(result.converged);
  EXPECT_GT(result.sample.effective_size, 0.5 * static_cast<double>(result.sample.weights.size()));
  const Eigen::VectorXd std = covariance_of(result.sample).diagonal().cwiseSqrt();
  EXPECT_LT(((mean_of(result.sample) - reference.mean).array() / reference.standard_deviation.array())
                .abs()
                .maxCoeff(),
            0.05);
  EXPECT_LT((std.array() / reference.standard_deviation.array() - 1).abs().maxCoeff(), 0.05);
}

}  // namespace
}  // namespace knothe::posterior::accuracy
