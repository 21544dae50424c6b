#include "knothe/posterior/draws/recycled_importance.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/posterior/testing/importance_checks.hpp"
#include "knothe/posterior/testing/model_targets.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior {
namespace {

using targets::KnownMixture;

/// What is stated holds, and no more is asked for than allowed.
void expect_right(const RecycledImportanceResult& r, const Eigen::VectorXd& mean,
                  const Eigen::VectorXd& deviation, double log_evidence) {
  ASSERT_TRUE(r.converged) << r.mean_error << " " << r.deviation_error;
  EXPECT_LE(((mean_of(r.sample).head(mean.size()) - mean).array() / deviation.array()).abs().maxCoeff(),
            r.mean_error);
  const Eigen::VectorXd found = covariance_of(r.sample).diagonal().cwiseSqrt().head(mean.size());
  EXPECT_LE((found.array() / deviation.array() - 1).abs().maxCoeff(), r.deviation_error);
  EXPECT_NEAR(r.sample.log_evidence, log_evidence, 5 * r.sample.log_evidence_error + 1e-3);
  EXPECT_NEAR(r.sample.weights.sum(), 1, 1e-12);
  EXPECT_LE(r.sample.density_evaluations, 20000);
}

void expect_right(const RecycledImportanceResult& r, const KnownMixture& target, double log_evidence) {
  expect_right(r, target.mean(), target.variance().cwiseSqrt(), log_evidence);
}

TEST(RecycledImportance, ANarrowCorrelatedGaussian) {
  const Eigen::Index d = 6;
  Eigen::MatrixXd lower = 0.02 * Eigen::MatrixXd::Identity(d, d);
  lower.bottomLeftCorner(3, 3).setConstant(0.05);
  KnownMixture target({{1.0, Eigen::VectorXd::LinSpaced(d, -1, 1), lower}}, -321.5);
  expect_right(recycled_importance(target), target, -321.5);
}

TEST(RecycledImportance, FarFromTheReference) {
  KnownMixture target({{1.0, Eigen::Vector4d(40, -70, 0, 1), 0.1 * Eigen::MatrixXd::Identity(4, 4)}}, 3);
  expect_right(recycled_importance(target), target, 3);
}

/// A prior N(0, I), and data a hundred of its deviations away: half the likelihood lies elsewhere altogether.
TEST(RecycledImportance, DataFarFromThePrior) {
  Eigen::MatrixXd a(3, 2);
  a << 1 / 0.3, 1 / 0.3, 0.3 / 0.5, -2 / 0.5, 1 / 0.4, 4 / 0.4;
  const Eigen::Vector3d data(400, 8, 2.5);
  const Eigen::MatrixXd covariance = (a.transpose() * a + Eigen::Matrix2d::Identity()).inverse();
  KnownMixture target({{1.0, covariance * a.transpose() * data, covariance.llt().matrixL()}}, -7000);
  expect_right(recycled_importance(target), target, -7000);
}

/// x = 0.5 ± 1 and y − x² = −0.3 ± s observed, with a prior N(0, I). The end of the ridge decides about the
/// deviation of y. Given x the density of y is Gaussian: one integral is left.
TEST(RecycledImportance, Bananas) {
  for (const double s : {0.1, 0.03}) {
    targets::Planar target(
        [s](double x, double y, double* r) {
          r[0] = -0.5 * (std::pow((y - x * x + 0.3) / s, 2) + std::pow(x - 0.5, 2) + x * x + y * y);
        },
        0);
    constexpr int k_nodes = 4000;
    const double variance = s * s / (1 + s * s);
    double sum = 0;
    Eigen::Vector2d mean = Eigen::Vector2d::Zero(), square = mean;
    for (int i = 0; i < k_nodes; ++i) {
      const double x = -6 + 12 * (i + 0.5) / k_nodes, ridge = x * x - 0.3, y = ridge / (1 + s * s);
      const double weight = std::exp(-0.5 * (std::pow(x - 0.5, 2) + x * x + ridge * y)) * 12 / k_nodes;
      sum += weight;
      mean += weight * Eigen::Vector2d(x, y);
      square += weight * Eigen::Vector2d(x * x, y * y + variance);
    }
    mean /= sum;
    const Eigen::Vector2d deviation = (square / sum - mean.cwiseAbs2()).cwiseSqrt();
    const double log_evidence = std::log(sum) + 0.5 * std::log(2 * std::numbers::pi * variance);
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      RecycledImportanceOptions options;
      options.seed = seed;
      SCOPED_TRACE(testing::Message() << "s " << s << ", seed " << seed);
      const RecycledImportanceResult r = recycled_importance(target, options);
      expect_right(r, mean, deviation, log_evidence);
      EXPECT_LE(r.sample.density_evaluations, 12000);
      options.looks_beyond = false;  // the draws alone
      EXPECT_LE(recycled_importance(target, options).sample.density_evaluations, 10000);
    }
  }
}

TEST(RecycledImportance, TwoModesOfUnequalWeightFarApart) {
  for (const Eigen::Index d : {5, 8})
    for (const double light : {0.5, 0.1}) {
      KnownMixture target(
          {{1 - light, Eigen::VectorXd::Constant(d, 0.8), 0.1 * Eigen::MatrixXd::Identity(d, d)},
           {light, Eigen::VectorXd::Constant(d, -0.8), 0.1 * Eigen::MatrixXd::Identity(d, d)}},
          12.0);
      expect_right(recycled_importance(target), target, 12.0);
    }
}

/// Modes that overlap where the target is flattened, and of which fits to few draws may lose one.
TEST(RecycledImportance, AModeLostInTenDimensionsIsNotTrustedAway) {
  const Eigen::Index d = 10;
  const Eigen::VectorXd centre = Eigen::VectorXd::Constant(d, 0.5);
  KnownMixture target({{0.3, -centre, 0.35 * Eigen::MatrixXd::Identity(d, d)},
                       {0.7, centre, 0.25 * Eigen::MatrixXd::Identity(d, d)}},
                      0);
  int trusted = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    RecycledImportanceOptions options;
    options.seed = seed;
    const RecycledImportanceResult r = recycled_importance(target, options);
    if (!r.converged || r.mass_beyond) continue;
    ++trusted;
    SCOPED_TRACE(seed);
    expect_right(r, target, 0);
  }
  EXPECT_GE(trusted, 2);
}

/// [0.5, 0.55]³ in N(0, I)³ has the mass 5e-6: no first draw of 4,000 is in it, but a mode known before
/// tells.
TEST(RecycledImportance, WhereNoFirstDrawIsAKnownModeTells) {
  struct Box : LogDensity {
    [[nodiscard]] Eigen::Index dimension() const override { return 3; }
    [[nodiscard]] int available_derivatives() const override { return 0; }
    void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int, LogDensityBatch& out) override {
      for (Eigen::Index i = 0; i < z.rows(); ++i)
        out.value[i] = z.row(i).minCoeff() > 0.5 && z.row(i).maxCoeff() < 0.55
                           ? 0
                           : -std::numeric_limits<double>::infinity();
    }
  } box;
  RecycledImportanceOptions options;
  EXPECT_THROW((void)recycled_importance(box, options), NumericalError);
  options.modes = {{Eigen::Vector3d::Constant(0.52), 0, 0.03 * Eigen::MatrixXd::Identity(3, 3), 0}};
  expect_right(recycled_importance(box, options), Eigen::Vector3d::Constant(0.525),
               Eigen::Vector3d::Constant(0.05 / std::sqrt(12.0)), 3 * std::log(0.05));
}

/// Given the first two coordinates those of the schools are Gaussian: mean, deviations and evidence of μ and
/// log τ by a grid.
TEST(RecycledImportance, EightSchools) {
  targets::EightSchools schools;
  constexpr int k_nodes = 800;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero(), square = mean;
  double sum = 0;
  for (int i = 0; i < k_nodes; ++i)
    for (int j = 0; j < k_nodes; ++j) {
      const Eigen::Vector2d z(-6 + 12 * (i + 0.5) / k_nodes, -8 + 12 * (j + 0.5) / k_nodes);
      const double tau = std::exp(1 + z[1]);
      double value = -0.5 * z.squaredNorm() - targets::k_log_two_pi;
      for (std::size_t k = 0; k < 8; ++k) {
        const double variance = tau * tau + std::pow(schools.standard_error[k], 2);
        value -= 0.5 * (std::pow(schools.effect[k] - 5 * z[0], 2) / variance + std::log(variance) +
                        targets::k_log_two_pi);
      }
      const double weight = std::exp(value) * std::pow(12.0 / k_nodes, 2);
      sum += weight;
      mean += weight * z;
      square += weight * z.cwiseAbs2();
    }
  mean /= sum;
  const Eigen::VectorXd deviation = (square / sum - mean.cwiseAbs2()).cwiseSqrt();
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    RecycledImportanceOptions options;
    options.seed = seed;
    const RecycledImportanceResult r = recycled_importance(schools, options);
    expect_right(r, mean, deviation, std::log(sum));
    EXPECT_LE(r.sample.density_evaluations, 16000);
    options.looks_beyond = false;  // the draws alone
    EXPECT_LE(recycled_importance(schools, options).sample.density_evaluations, 12000);
  }
}

TEST(RecycledImportance, TheSameTargetGivesTheSameDrawsAndAnotherSeedOthers) {
  targets::expect_a_function_of_target_and_seed<RecycledImportanceOptions>(recycled_importance);
}

TEST(RecycledImportance, StatedErrorsAreFourStandardErrors) {
  RecycledImportanceOptions options;
  const double ratio = targets::errors_in_units_of_those_stated(recycled_importance, options);
  EXPECT_LT(ratio, 1.3);
  EXPECT_GT(ratio, 0.1);  // stratified draws: better than stated
}

TEST(RecycledImportance, VariablesThatCountAreTheUsers) {
  KnownMixture target({{1.0, Eigen::Vector2d(0.5, 0), 0.5 * Eigen::MatrixXd::Identity(2, 2)}}, 0);
  RecycledImportanceOptions options;
  const double own = recycled_importance(target, options).deviation_error;
  options.max_evaluations = 3000;
  options.variables = [](const Eigen::MatrixXd& z) { return Eigen::MatrixXd((2 * z.array()).exp()); };
  EXPECT_GT(recycled_importance(target, options).deviation_error, own);  // a heavy tail
}

TEST(RecycledImportance, SaysThatItHasNotConverged) {
  targets::Shell shell;
  const auto r = recycled_importance(shell);
  EXPECT_FALSE(r.converged);
  EXPECT_TRUE(r.sample.points.allFinite());
  EXPECT_NEAR(r.sample.weights.sum(), 1, 1e-12);
  EXPECT_LE(r.sample.density_evaluations, 20000);
}

/// Zero but far away.
class Elsewhere final : public LogDensity {
 public:
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int /*derivatives*/,
                LogDensityBatch& out) override {
    for (Eigen::Index i = 0; i < points.rows(); ++i) out.value[i] = points(i, 0) > 50 ? 0.0 : -INFINITY;
  }
};

TEST(RecycledImportance, NoDensityAtAllAndAnInterrupt) {
  Elsewhere elsewhere;
  try {
    (void)recycled_importance(elsewhere);
    FAIL();
  } catch (const NumericalError& error) {
    EXPECT_STREQ(error.what(), "smc: the density is zero at all 4000 first draws from N(0, I)");
  }
  KnownMixture target({{1.0, Eigen::Vector2d(0.5, 0), 0.5 * Eigen::MatrixXd::Identity(2, 2)}}, 0);
  RecycledImportanceOptions options;
  options.progress = [](double share) { return share < 0.1; };
  try {
    (void)recycled_importance(target, options);
    FAIL();
  } catch (const Interrupted& interrupted) {
    EXPECT_STREQ(interrupted.what(), "smc: interrupted after 2000 draws");
  }
}

}  // namespace
}  // namespace knothe::posterior
