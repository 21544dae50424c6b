#include <gtest/gtest.h>

#include <cmath>

#include "knothe/numerics/optimise/lbfgs.hpp"
#include "knothe/numerics/optimise/newton_cg.hpp"

namespace knothe::numerics {
namespace {

/// Gradients by hand, products with the Hessian by hand: no matrix of the dimension's size anywhere.
struct WithProduct : Objective {
  bool gives_products = true;
  int products = 0;
  [[nodiscard]] bool has_hessian_vector() const override { return gives_products; }
};

/// Extended Rosenbrock function (Moré, Garbow, Hillstrom 1981, no. 21): minimum 0 at (1, …, 1).
struct ExtendedRosenbrock : WithProduct {
  Eigen::Index n;
  explicit ExtendedRosenbrock(Eigen::Index size) : n(size) {}
  [[nodiscard]] Eigen::Index dimension() const override { return n; }
  bool evaluate(const Eigen::VectorXd& x, int, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd&) override {
    value = 0;
    for (Eigen::Index i = 0; i < n; i += 2) {
      const double a = x[i + 1] - x[i] * x[i], b = 1 - x[i];
      value += 100 * a * a + b * b;
      gradient[i] = -400 * a * x[i] - 2 * b;
      gradient[i + 1] = 200 * a;
    }
    return true;
  }
  void hessian_vector(const Eigen::VectorXd& x, const Eigen::VectorXd& v, Eigen::VectorXd& product) override {
    ++products;
    for (Eigen::Index i = 0; i < n; i += 2) {
      product[i] = (1200 * x[i] * x[i] - 400 * x[i + 1] + 2) * v[i] - 400 * x[i] * v[i + 1];
      product[i + 1] = -400 * x[i] * v[i] + 200 * v[i + 1];
    }
  }
};

/// Extended Powell singular function (no. 22): minimum 0 at 0, where the Hessian is singular.
struct ExtendedPowell : WithProduct {
  Eigen::Index n;
  explicit ExtendedPowell(Eigen::Index size) : n(size) {}
  [[nodiscard]] Eigen::Index dimension() const override { return n; }
  bool evaluate(const Eigen::VectorXd& x, int, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd&) override {
    value = 0;
    for (Eigen::Index i = 0; i < n; i += 4) {
      const double a = x[i] + 10 * x[i + 1], b = x[i + 2] - x[i + 3], c = x[i + 1] - 2 * x[i + 2],
                   e = x[i] - x[i + 3];
      value += a * a + 5 * b * b + c * c * c * c + 10 * e * e * e * e;
      const double c3 = 4 * c * c * c, e3 = 40 * e * e * e;
      gradient[i] = 2 * a + e3;
      gradient[i + 1] = 20 * a + c3;
      gradient[i + 2] = 10 * b - 2 * c3;
      gradient[i + 3] = -10 * b - e3;
    }
    return true;
  }
  void hessian_vector(const Eigen::VectorXd& x, const Eigen::VectorXd& v, Eigen::VectorXd& product) override {
    ++products;
    for (Eigen::Index i = 0; i < n; i += 4) {
      const double c = x[i + 1] - 2 * x[i + 2], e = x[i] - x[i + 3];
      const double a = v[i] + 10 * v[i + 1], b = v[i + 2] - v[i + 3];
      const double dc = 12 * c * c * (v[i + 1] - 2 * v[i + 2]), de = 120 * e * e * (v[i] - v[i + 3]);
      product[i] = 2 * a + de;
      product[i + 1] = 20 * a + dc;
      product[i + 2] = 10 * b - 2 * dc;
      product[i + 3] = -10 * b - de;
    }
  }
};

/// ½ Σ c_i (x_i − 1)² with condition number c_n.
struct Quadratic : WithProduct {
  Eigen::VectorXd c;
  Quadratic(Eigen::Index n, double condition)
      : c(Eigen::VectorXd::LinSpaced(n, 0, std::log(condition)).array().exp()) {}
  [[nodiscard]] Eigen::Index dimension() const override { return c.size(); }
  bool evaluate(const Eigen::VectorXd& x, int, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd&) override {
    gradient = c.cwiseProduct((x.array() - 1).matrix());
    value = 0.5 * gradient.dot((x.array() - 1).matrix());
    return true;
  }
  void hessian_vector(const Eigen::VectorXd&, const Eigen::VectorXd& v, Eigen::VectorXd& product) override {
    ++products;
    product = c.cwiseProduct(v);
  }
};

/// Σ (x_i − 3)² − log x_i², feasible where all x_i > 0; beyond the barrier there is a second minimum.
struct Barrier : WithProduct {
  Eigen::Index n;
  double lowest_seen = 1e9;
  explicit Barrier(Eigen::Index size) : n(size) {}
  [[nodiscard]] Eigen::Index dimension() const override { return n; }
  bool evaluate(const Eigen::VectorXd& x, int, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd&) override {
    lowest_seen = std::min(lowest_seen, x.minCoeff());
    value = (x.array() - 3).square().sum() - x.array().square().log().sum();
    gradient = 2 * (x.array() - 3) - 2 / x.array();
    return true;
  }
  void hessian_vector(const Eigen::VectorXd& x, const Eigen::VectorXd& v, Eigen::VectorXd& product) override {
    ++products;
    product = (2 + 2 / x.array().square()) * v.array();
  }
  double step_limit(const Eigen::VectorXd& x, const Eigen::VectorXd& step) override {
    double limit = 1;
    for (Eigen::Index i = 0; i < n; ++i)
      if (x[i] + step[i] <= 0) limit = std::min(limit, -0.9 * x[i] / step[i]);
    return limit;
  }
};

const double k_barrier_minimum = (3 + std::sqrt(13.0)) / 2;  // 2(x − 3) = 2/x

Eigen::VectorXd rosenbrock_start(Eigen::Index n) {
  Eigen::VectorXd x(n);
  for (Eigen::Index i = 0; i < n; i += 2) x[i] = -1.2, x[i + 1] = 1;
  return x;
}

TEST(NewtonCg, ExtendedRosenbrockInOneThousandVariables) {
  ExtendedRosenbrock f(1000);
  Eigen::VectorXd x = rosenbrock_start(1000);
  const auto summary = NewtonCg().minimise(f, {}, x);
  EXPECT_TRUE(summary.converged()) << describe(summary.termination);
  EXPECT_LT((x.array() - 1).abs().maxCoeff(), 1e-8);
  EXPECT_LT(summary.iterations, 80);
  EXPECT_LT(f.products, 400);  // not one per variable
}

TEST(NewtonCg, SingularHessianAtTheMinimum) {
  ExtendedPowell f(1000);
  Eigen::VectorXd x(1000);
  for (Eigen::Index i = 0; i < 1000; i += 4) x.segment<4>(i) << 3, -1, 0, 1;
  const auto summary = NewtonCg().minimise(f, {}, x);
  EXPECT_TRUE(summary.converged()) << describe(summary.termination);
  EXPECT_LT(summary.value, 1e-10);
}

TEST(NewtonCg, IllConditionedQuadratic) {
  Quadratic f(1000, 1e4);
  Eigen::VectorXd x = Eigen::VectorXd::Zero(1000);
  const auto summary = NewtonCg().minimise(f, {.max_products = 1000, .initial_radius = 100}, x);
  EXPECT_TRUE(summary.converged());
  EXPECT_LT((x.array() - 1).abs().maxCoeff(), 1e-6);
}

TEST(NewtonCg, FollowsNegativeCurvatureOffASaddle) {
  /// x² − y² + y⁴/4: saddle at 0, minima −1 at y = ±√2.
  struct Saddle : WithProduct {
    [[nodiscard]] Eigen::Index dimension() const override { return 2; }
    bool evaluate(const Eigen::VectorXd& x, int, double& v, Eigen::VectorXd& g, Eigen::MatrixXd&) override {
      v = x[0] * x[0] - x[1] * x[1] + 0.25 * std::pow(x[1], 4);
      g << 2 * x[0], -2 * x[1] + x[1] * x[1] * x[1];
      return true;
    }
    void hessian_vector(const Eigen::VectorXd& x, const Eigen::VectorXd& v, Eigen::VectorXd& p) override {
      p << 2 * v[0], (-2 + 3 * x[1] * x[1]) * v[1];
    }
  } f;
  Eigen::VectorXd x = Eigen::Vector2d(0.5, 1e-3);
  const auto summary = NewtonCg().minimise(f, {}, x);
  EXPECT_TRUE(summary.converged());
  EXPECT_NEAR(std::abs(x[1]), std::sqrt(2.0), 1e-7);
  EXPECT_NEAR(summary.value, -1, 1e-12);
}

TEST(NewtonCg, DifferencesOfGradientsWhereThereAreNoProducts) {
  ExtendedRosenbrock f(1000);
  f.gives_products = false;
  Eigen::VectorXd x = rosenbrock_start(1000);
  const auto summary = NewtonCg().minimise(f, {.gradient_tolerance = 1e-6}, x);
  EXPECT_TRUE(summary.converged()) << describe(summary.termination);
  EXPECT_LT((x.array() - 1).abs().maxCoeff(), 1e-5);
  EXPECT_EQ(f.products, 0);
  Barrier barrier(50);
  barrier.gives_products = false;
  Eigen::VectorXd y = Eigen::VectorXd::LinSpaced(50, 1e-7, 20);
  EXPECT_TRUE(NewtonCg().minimise(barrier, {.gradient_tolerance = 1e-7}, y).converged());
  EXPECT_LT((y.array() - k_barrier_minimum).abs().maxCoeff(), 1e-6);
  EXPECT_GT(barrier.lowest_seen, 0);
}

TEST(Lbfgs, ExtendedRosenbrockInOneThousandVariables) {
  ExtendedRosenbrock f(1000);
  Eigen::VectorXd x = rosenbrock_start(1000);
  const auto summary = Lbfgs().minimise(f, {}, x);
  EXPECT_TRUE(summary.converged()) << describe(summary.termination);
  EXPECT_LT((x.array() - 1).abs().maxCoeff(), 1e-6);
  EXPECT_LT(summary.iterations, 120);
}

TEST(Lbfgs, SingularHessianAtTheMinimumAndIllConditionedQuadratic) {
  ExtendedPowell f(1000);
  Eigen::VectorXd x(1000);
  for (Eigen::Index i = 0; i < 1000; i += 4) x.segment<4>(i) << 3, -1, 0, 1;
  const auto summary = Lbfgs().minimise(f, {}, x);
  EXPECT_TRUE(summary.converged()) << describe(summary.termination);
  EXPECT_LT(summary.value, 1e-8);
  Quadratic quadratic(1000, 1e4);
  Eigen::VectorXd y = Eigen::VectorXd::Zero(1000);
  EXPECT_TRUE(Lbfgs().minimise(quadratic, {}, y).converged());
  EXPECT_LT((y.array() - 1).abs().maxCoeff(), 1e-6);
}

TEST(LargeMinimisers, TheStepFilterIsObeyed) {
  for (int method = 0; method < 2; ++method) {
    for (int start = 0; start < 2; ++start) {
      Barrier f(1000);
      // From far out a full step jumps over the barrier; from nearby the first steps are enormous.
      Eigen::VectorXd x = start == 0 ? Eigen::VectorXd::Constant(1000, 20.0)
                                     : Eigen::VectorXd(Eigen::VectorXd::LinSpaced(1000, 0.01, 30));
      const auto summary =
          method == 0 ? NewtonCg().minimise(f, {.initial_radius = 1e3}, x) : Lbfgs().minimise(f, {}, x);
      // The last steps may be lost in rounding, which depends on the instruction set; where it stopped is
      // what counts.
      EXPECT_TRUE(summary.converged() || summary.termination == Termination::small_step)
          << method << " " << describe(summary.termination);
      EXPECT_LT((x.array() - k_barrier_minimum).abs().maxCoeff(), 1e-6) << method;
      EXPECT_GT(f.lowest_seen, 0) << method;
    }
  }
}

TEST(LargeMinimisers, RefuseAnInfeasibleStart) {
  struct Nowhere : Objective {
    [[nodiscard]] Eigen::Index dimension() const override { return 1; }
    bool evaluate(const Eigen::VectorXd&, int, double&, Eigen::VectorXd&, Eigen::MatrixXd&) override {
      return false;
    }
  } f;
  Eigen::VectorXd x = Eigen::VectorXd::Zero(1);
  EXPECT_EQ(NewtonCg().minimise(f, {}, x).termination, Termination::start_infeasible);
  EXPECT_EQ(Lbfgs().minimise(f, {}, x).termination, Termination::start_infeasible);
}

}  // namespace
}  // namespace knothe::numerics
