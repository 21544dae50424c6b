#include "knothe/posterior/map/solve/kl_objective.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/posterior/map/testing/map_examples.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior {
namespace {

/// A correlated, skewed density in R^d with exact derivatives: Gaussian minus a quartic in a slanted
/// direction.
struct Quartic : LogDensity {
  Eigen::Index d;
  explicit Quartic(Eigen::Index dimension) : d(dimension) {}
  [[nodiscard]] Eigen::Index dimension() const override { return d; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
    const Eigen::VectorXd slant = Eigen::VectorXd::LinSpaced(d, 1, -0.5);
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      const double s = z.row(i).dot(slant);
      out.value[i] = -0.5 * z.row(i).squaredNorm() - 0.05 * s * s * s * s + 0.3 * std::sin(s);
      if (order >= 1)
        out.gradient.row(i) = -z.row(i) + (-0.2 * s * s * s + 0.3 * std::cos(s)) * slant.transpose();
      if (order >= 2)
        for (Eigen::Index a = 0; a < d; ++a)
          for (Eigen::Index b = 0; b <= a; ++b)
            out.hessian(i, packed_index(a, b)) =
                (a == b ? -1.0 : 0.0) + (-0.6 * s * s - 0.3 * std::sin(s)) * slant[a] * slant[b];
    }
  }
};

Eigen::MatrixXd rotation_in_first_plane(Eigen::Index d) {
  Eigen::MatrixXd rotation = Eigen::MatrixXd::Identity(d, d);
  rotation(0, 0) = rotation(1, 1) = 0.8;
  rotation(1, 0) = 0.6, rotation(0, 1) = -0.6;
  return rotation;
}

AffineMap some_pre_map(Eigen::Index d) {
  AffineMap map = AffineMap::identity(d);
  for (Eigen::Index i = 0; i < d; ++i) {
    map.shift[i] = 0.1 * static_cast<double>(i + 1);
    for (Eigen::Index j = 0; j <= i; ++j) map.lower(i, j) = i == j ? 0.8 + 0.1 * static_cast<double>(i) : 0.2;
  }
  return map;
}

/// Gradient, Hessian and Hessian-vector products of the objective at coefficients near the identity, all
/// against central differences.
void expect_exact_derivatives(const TriangularMap& map, int nodes, const AffineMap& pre_map,
                              LogDensity& density) {
  const TrainingTables tables(numerics::tensor_rule(numerics::gauss_hermite(nodes), map.dimension(), 1e-11),
                              map);
  CheckedDensity target(density);
  KullbackLeiblerObjective objective(tables, pre_map, target);
  const Eigen::Index n = objective.dimension();
  Eigen::VectorXd a, gradient(n), up(n), down(n);
  tables.layout.gather(map.coefficients(), a);
  std::mt19937 generator(3);
  std::normal_distribution<double> normal(0, 0.02);
  for (auto& x : a) x += normal(generator);
  Eigen::MatrixXd hessian(n, n), unused(n, n);
  double value = 0, high = 0, low = 0;
  ASSERT_TRUE(objective.evaluate(a, 2, value, gradient, hessian));
  const double e = 1e-5, largest = 1 + hessian.cwiseAbs().maxCoeff();
  for (Eigen::Index m = 0; m < n; ++m) {
    Eigen::VectorXd moved = a;
    moved[m] += e;
    ASSERT_TRUE(objective.evaluate(moved, 1, high, up, unused));
    moved[m] -= 2 * e;
    ASSERT_TRUE(objective.evaluate(moved, 1, low, down, unused));
    EXPECT_NEAR(gradient[m], (high - low) / (2 * e), 1e-7 * (1 + std::abs(gradient[m])));
    EXPECT_LT((hessian.col(m) - (up - down) / (2 * e)).cwiseAbs().maxCoeff(), 1e-6 * largest) << m;
  }
  EXPECT_LT((hessian - hessian.transpose()).cwiseAbs().maxCoeff(), 1e-12 * largest);
  ASSERT_TRUE(objective.has_hessian_vector());
  const Eigen::VectorXd v = Eigen::VectorXd::LinSpaced(n, -1, 0.7);
  Eigen::VectorXd product;
  objective.hessian_vector(a, v, product);
  EXPECT_LT((product - hessian * v).cwiseAbs().maxCoeff(), 1e-10 * largest);
}

TEST(KullbackLeiblerObjective, GradientAndHessianAgainstFiniteDifferences) {
  for (Eigen::Index d : {1, 2, 3})
    for (int order : {1, 3}) {
      Quartic density(d);
      expect_exact_derivatives(TriangularMap(d, order), d == 3 ? 6 : 8, some_pre_map(d), density);
    }
}

TEST(KullbackLeiblerObjective, EveryRectifierHasExactDerivatives) {
  Quartic density(2);
  AffineMap turned = some_pre_map(2);
  turned.rotation = rotation_in_first_plane(2);
  for (const Rectifier rectifier : {Rectifier::square, Rectifier::softplus, Rectifier::exponential}) {
    SCOPED_TRACE(to_text(rectifier));
    expect_exact_derivatives(TriangularMap(total_order_map(2, 2, {rectifier, {}})), 7, turned, density);
  }
}

TEST(KullbackLeiblerObjective, EveryIndexSetHasExactDerivatives) {
  Quartic density(3);
  MapSpecification by_hand = total_order_map(3, 2, {Rectifier::softplus, {}});
  std::reverse(by_hand.components[2].constant.begin(), by_hand.components[2].constant.end());
  std::reverse(by_hand.components[2].monotone.begin(), by_hand.components[2].monotone.end());
  by_hand.components[1].monotone.push_back(examples::multi_index(std::vector<int>{3, 1}));
  for (const MapSpecification& specification : {per_variable_map(std::vector<int>{3, 1, 2}), by_hand,
                                                sparse_map(total_order_map(3, 3), {{}, {0}, {1}})})
    expect_exact_derivatives(TriangularMap(specification), 5, some_pre_map(3), density);
}

TEST(KullbackLeiblerObjective, RefusesDimensionsThatDoNotFit) {
  Quartic density(4);
  const TrainingTables tables(numerics::tensor_rule(numerics::gauss_hermite(6), 2), TriangularMap(2, 2));
  CheckedDensity target(density);
  KullbackLeiblerObjective objective;
  EXPECT_THROW(objective.begin(tables, some_pre_map(2), target, 0), UsageError);
  EXPECT_THROW(objective.begin(tables, some_pre_map(4), target, 0), UsageError);
}

TEST(TemperedDensity, GoesFromThePriorToTheTarget) {
  Quartic density(2);
  const Eigen::MatrixXd z = (Eigen::MatrixXd(2, 2) << 0.3, -1, 2, 0.4).finished();
  LogDensityBatch tempered_values, target_values;
  tempered_values.resize(2, 2, 2), target_values.resize(2, 2, 2);
  density.evaluate(z, 2, target_values);
  TemperedDensity tempered(density, 1);
  tempered.evaluate(z, 2, tempered_values);
  EXPECT_EQ(tempered_values.value, target_values.value);
  tempered.set_beta(0);
  tempered.evaluate(z, 2, tempered_values);
  EXPECT_EQ(tempered_values.value, standard_normal_log_density(z));
  EXPECT_EQ(tempered_values.gradient, -z);
  tempered.set_beta(0.25);
  tempered.evaluate(z, 2, tempered_values);
  EXPECT_LT(
      (tempered_values.value - 0.25 * target_values.value - 0.75 * standard_normal_log_density(z)).norm(),
      1e-14);
  EXPECT_LT((tempered_values.gradient - 0.25 * target_values.gradient + 0.75 * z).norm(), 1e-14);
  EXPECT_NEAR(tempered_values.hessian(1, 2), 0.25 * target_values.hessian(1, 2) - 0.75, 1e-14);
  EXPECT_NEAR(tempered_values.hessian(0, 1), 0.25 * target_values.hessian(0, 1), 1e-14);
}

TEST(KullbackLeiblerObjective, IsTheObjectiveOfThePublicMap) {
  // The fast tables against the readable implementation: F = Σ w (log ρ − log π̄(T(x)) − log det).
  const Eigen::Index d = 3;
  for (const Rectifier rectifier : {Rectifier::square, Rectifier::softplus, Rectifier::exponential}) {
    TriangularMap map(total_order_map(d, 3, {rectifier, {}}));
    const TrainingTables tables(numerics::tensor_rule(numerics::gauss_hermite(7), d), map);
    Quartic density(d);
    CheckedDensity target(density);
    AffineMap pre_map = some_pre_map(d);
    pre_map.rotation = rotation_in_first_plane(d);
    KullbackLeiblerObjective objective;
    objective.begin(tables, pre_map, target, 0);
    Eigen::VectorXd a, c = map.coefficients();
    for (Eigen::Index i = 0; i < c.size(); ++i) c[i] += 0.01 * std::sin(static_cast<double>(7 * i));
    map.set_coefficients(c);
    tables.layout.gather(c, a);
    Eigen::VectorXd back;
    tables.layout.scatter(a, back);
    EXPECT_EQ(back, c);
    double value = 0;
    Eigen::VectorXd gradient;
    Eigen::MatrixXd hessian;
    ASSERT_TRUE(objective.evaluate(a, 0, value, gradient, hessian));
    ComposedMap composed(d);
    composed.append(pre_map);
    composed.append(map);
    MapBatch batch;
    composed.evaluate(tables.rule.points, 0, batch);
    LogDensityBatch values;
    target.evaluate(batch.value, 0, values);
    const Eigen::VectorXd r = tables.log_reference - values.value - batch.log_determinant;
    EXPECT_NEAR(value, tables.rule.weights.dot(r), 1e-11);
    const double mean = tables.rule.weights.dot(r);
    EXPECT_NEAR(objective.variance_diagnostic(a),
                0.5 * tables.rule.weights.dot((r.array() - mean).square().matrix()), 1e-11);
  }
}

TEST(KullbackLeiblerObjective, VarianceDiagnosticOfAMisfitGaussian) {
  // T(x) = x against N(m, s²): r = log ρ − log π = x²(1/s² − 1)/2 − x m/s² + const, ½ Var r = ((1/s² − 1)²/2
  // + m²/s⁴)/2.
  const double m = 0.7, s = 1.4, k = 1 / (s * s) - 1;
  targets::Gaussian density(Eigen::VectorXd::Constant(1, m), Eigen::MatrixXd::Constant(1, 1, 1 / (s * s)));
  CheckedDensity target(density);
  const TrainingTables tables(numerics::tensor_rule(numerics::gauss_hermite(6), 1),
                              TriangularMap(1, 1, {6, 0.5, 6}));
  KullbackLeiblerObjective objective;
  const AffineMap pre_map = AffineMap::identity(1);
  objective.begin(tables, pre_map, target, 0);
  Eigen::VectorXd a;
  tables.layout.gather(TriangularMap(1, 1).coefficients(), a);
  EXPECT_NEAR(objective.variance_diagnostic(a), 0.5 * (0.5 * k * k + m * m / std::pow(s, 4)), 1e-12);
}

TEST(KullbackLeiblerObjective, TheStepFilterKeepsTheSlopePositive) {
  const TrainingTables tables(numerics::tensor_rule(numerics::gauss_hermite(8), 2), TriangularMap(2, 3));
  Quartic density(2);
  CheckedDensity target(density);
  const AffineMap pre_map = AffineMap::identity(2);
  KullbackLeiblerObjective objective;
  objective.begin(tables, pre_map, target, 0);
  Eigen::VectorXd a;
  tables.layout.gather(TriangularMap(2, 3).coefficients(), a);
  std::mt19937 generator(5);
  std::normal_distribution<double> normal(0, 3);
  for (int trial = 0; trial < 50; ++trial) {
    Eigen::VectorXd step(a.size());
    for (auto& x : step) x = normal(generator);
    const double limit = objective.step_limit(a, step);
    ASSERT_GT(limit, 0);
    ASSERT_LE(limit, 1);
    for (Eigen::Index k = 0; k < 2; ++k) {
      ComponentValues values;
      values.evaluate_slope(tables.points, tables.layout, k, a + limit * step);
      EXPECT_GT(values.h.minCoeff(), 0);
    }
  }
}

}  // namespace
}  // namespace knothe::posterior
