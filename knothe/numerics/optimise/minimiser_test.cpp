#include "knothe/numerics/optimise/minimiser.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/numerics/optimise/bfgs.hpp"
#include "knothe/numerics/optimise/nelder_mead.hpp"
#include "knothe/numerics/optimise/trust_region.hpp"

namespace knothe::numerics {
namespace {

/// Rosenbrock's function in n variables; minimum 0 at (1, …, 1).
struct Rosenbrock : Objective {
  Eigen::Index n;
  explicit Rosenbrock(Eigen::Index size) : n(size) {}
  Eigen::Index dimension() const override { return n; }
  bool evaluate(const Eigen::VectorXd& x, int derivatives, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd& hessian) override {
    value = 0;
    if (derivatives >= 1) gradient.setZero();
    if (derivatives >= 2) hessian.setZero();
    for (Eigen::Index i = 0; i + 1 < n; ++i) {
      const double a = x[i + 1] - x[i] * x[i], b = 1 - x[i];
      value += 100 * a * a + b * b;
      if (derivatives >= 1) {
        gradient[i] += -400 * a * x[i] - 2 * b;
        gradient[i + 1] += 200 * a;
      }
      if (derivatives >= 2) {
        hessian(i, i) += 1200 * x[i] * x[i] - 400 * x[i + 1] + 2;
        hessian(i + 1, i + 1) += 200;
        hessian(i, i + 1) -= 400 * x[i];
        hessian(i + 1, i) -= 400 * x[i];
      }
    }
    return true;
  }
};

/// (x − 3)² − log x² with the feasible set x > 0: beyond the barrier at 0 there is a second, lower-slope
/// minimum.
struct Barrier : Objective {
  double lowest_seen = 1e9;
  Eigen::Index dimension() const override { return 1; }
  bool evaluate(const Eigen::VectorXd& x, int derivatives, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd& hessian) override {
    lowest_seen = std::min(lowest_seen, x[0]);
    value = (x[0] - 3) * (x[0] - 3) - std::log(x[0] * x[0]);
    if (derivatives >= 1) gradient[0] = 2 * (x[0] - 3) - 2 / x[0];
    if (derivatives >= 2) hessian(0, 0) = 2 + 2 / (x[0] * x[0]);
    return true;
  }
  double step_limit(const Eigen::VectorXd& x, const Eigen::VectorXd& step) override {
    return x[0] + step[0] > 0 ? 1.0 : 0.9 * -x[0] / step[0];
  }
};

const double k_barrier_minimum = (3 + std::sqrt(13.0)) / 2;  // 2(x − 3) = 2/x

TEST(NewtonTrustRegion, Rosenbrock) {
  Rosenbrock f(10);
  NewtonTrustRegion newton;
  Eigen::VectorXd x = Eigen::VectorXd::Constant(10, -0.8);
  const auto summary = newton.minimise(f, {}, x);
  EXPECT_TRUE(summary.converged()) << describe(summary.termination);
  const bool global = (x.array() - 1).abs().maxCoeff() < 1e-8, local = std::abs(x[0] + 0.99) < 0.02;
  EXPECT_TRUE(global || local) << x.transpose();
  Eigen::VectorXd y = Eigen::Vector2d(-1.2, 1.0);
  Rosenbrock two(2);
  const auto again = newton.minimise(two, {}, y);
  EXPECT_NEAR((y.array() - 1).abs().maxCoeff(), 0, 1e-9);
  EXPECT_LT(again.iterations, 40);
}

TEST(NewtonTrustRegion, LeavesASaddle) {
  struct Saddle : Objective {
    Eigen::Index dimension() const override { return 2; }
    bool evaluate(const Eigen::VectorXd& x, int, double& v, Eigen::VectorXd& g, Eigen::MatrixXd& h) override {
      v = x[0] * x[0] - x[1] * x[1] + 0.25 * std::pow(x[1], 4);
      g << 2 * x[0], -2 * x[1] + x[1] * x[1] * x[1];
      h << 2, 0, 0, -2 + 3 * x[1] * x[1];
      return true;
    }
  } f;
  Eigen::VectorXd x = Eigen::Vector2d(0.5, 0.0);
  const auto summary = NewtonTrustRegion().minimise(f, {}, x);
  EXPECT_TRUE(summary.converged());
  EXPECT_NEAR(std::abs(x[1]), std::sqrt(2.0), 1e-8);
  EXPECT_NEAR(summary.value, -1, 1e-12);
}

/// ½ Σ λ_i x_i² − Σ x_i
struct Quadratic : Objective {
  Eigen::VectorXd lambda;
  Eigen::Index dimension() const override { return lambda.size(); }
  bool evaluate(const Eigen::VectorXd& x, int derivatives, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd& hessian) override {
    value = 0.5 * lambda.dot(x.cwiseAbs2()) - x.sum();
    if (derivatives >= 1) gradient = lambda.cwiseProduct(x).array() - 1;
    if (derivatives >= 2) hessian = lambda.asDiagonal();
    return true;
  }
};

TEST(NewtonTrustRegion, ItsStepIsTheMinimumOnTheBallOfTheRadius) {
  // From curvatures far apart to one that is negative by rounding alone, and one that truly is.
  for (const double lowest : {2.0, 1e-9, 1e-15, -1e-16, -3.0}) {
    Quadratic quadratic;
    quadratic.lambda = Eigen::VectorXd::LinSpaced(30, 1, 1e3);
    quadratic.lambda[0] = lowest;
    TrustRegionOptions options;
    options.initial_radius = 0.125;
    options.max_iterations = 1;
    Eigen::VectorXd x = Eigen::VectorXd::Zero(30);
    (void)NewtonTrustRegion().minimise(quadratic, options, x);
    EXPECT_NEAR(x.norm(), 0.125, 2e-4) << lowest;
    // Stationary there: λ_i x_i − 1 = −μ x_i with the same μ ≥ −λ_0 for all i.
    const Eigen::ArrayXd multiplier = 1 / x.array() - quadratic.lambda.array();
    EXPECT_GE(multiplier[0], -lowest);
    for (Eigen::Index i = 1; i < 30; ++i)
      EXPECT_NEAR(multiplier[i], multiplier[0], 0.02 * multiplier[0]) << lowest;
  }
}

TEST(NewtonTrustRegion, DoesNotGoOnWithoutEndForNearlyNothing) {
  /// A slope of 1e-8 for ten million units: each step of the largest radius gains 1e-5.
  struct LongSlope : Objective {
    Eigen::Index dimension() const override { return 1; }
    bool evaluate(const Eigen::VectorXd& x, int derivatives, double& value, Eigen::VectorXd& gradient,
                  Eigen::MatrixXd& hessian) override {
      const double y = x[0] - 1e7, root = std::sqrt(1 + y * y);
      value = 1e-8 * root;
      if (derivatives >= 1) gradient[0] = 1e-8 * y / root;
      if (derivatives >= 2) hessian(0, 0) = 1e-8 / (root * root * root);
      return true;
    }
  } slope;
  TrustRegionOptions options;
  options.gradient_tolerance = 1e-12;
  Eigen::VectorXd x = Eigen::VectorXd::Zero(1);
  EXPECT_EQ(NewtonTrustRegion().minimise(slope, options, x).termination, Termination::iteration_limit);
  x.setZero();
  options.decrease_at_border = 1e-4;
  const MinimiserSummary summary = NewtonTrustRegion().minimise(slope, options, x);
  EXPECT_EQ(summary.termination, Termination::converged);
  EXPECT_LT(x[0], 2000);
}

TEST(Bfgs, Rosenbrock) {
  Rosenbrock f(6);
  Eigen::VectorXd x = Eigen::VectorXd::Constant(6, 0.3);
  const auto summary = Bfgs().minimise(f, {}, x);
  EXPECT_TRUE(summary.converged()) << describe(summary.termination);
  EXPECT_NEAR((x.array() - 1).abs().maxCoeff(), 0, 1e-6);
}

TEST(NelderMead, Rosenbrock) {
  Rosenbrock f(4);
  Eigen::VectorXd x = Eigen::VectorXd::Constant(4, 0.3);
  const auto summary = NelderMead().minimise(f, {}, x);
  EXPECT_TRUE(summary.converged());
  EXPECT_NEAR((x.array() - 1).abs().maxCoeff(), 0, 1e-4);
}

TEST(Minimisers, TheStepFilterIsObeyed) {
  for (int method = 0; method < 3; ++method) {
    Barrier f;
    Eigen::VectorXd x(1);
    x << 20;  // a full first step of every method would jump over the barrier sooner or later
    MinimiserSummary summary;
    if (method == 0) summary = NewtonTrustRegion().minimise(f, {.initial_radius = 100}, x);
    if (method == 1) summary = Bfgs().minimise(f, {}, x);
    if (method == 2) summary = NelderMead().minimise(f, {.initial_step = 30}, x);
    EXPECT_TRUE(summary.converged()) << method;
    EXPECT_NEAR(x[0], k_barrier_minimum, 1e-5) << method;
    EXPECT_GT(f.lowest_seen, 0) << method;
  }
  Barrier f;
  Eigen::VectorXd x(1);
  x << 0.01;  // Newton's step from here goes up, then far; BFGS's too
  EXPECT_TRUE(NewtonTrustRegion().minimise(f, {}, x).converged());
  EXPECT_NEAR(x[0], k_barrier_minimum, 1e-8);
}

TEST(Minimisers, RefuseAnInfeasibleStart) {
  struct Nowhere : Objective {
    Eigen::Index dimension() const override { return 1; }
    bool evaluate(const Eigen::VectorXd&, int, double&, Eigen::VectorXd&, Eigen::MatrixXd&) override {
      return false;
    }
  } f;
  Eigen::VectorXd x = Eigen::VectorXd::Zero(1);
  EXPECT_EQ(NewtonTrustRegion().minimise(f, {}, x).termination, Termination::start_infeasible);
  EXPECT_EQ(Bfgs().minimise(f, {}, x).termination, Termination::start_infeasible);
  EXPECT_EQ(NelderMead().minimise(f, {}, x).termination, Termination::start_infeasible);
}

}  // namespace
}  // namespace knothe::numerics
