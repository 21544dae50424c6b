#include "knothe/posterior/mode_search.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/posterior/random_numbers.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior {
namespace {

using targets::Gaussian;
using targets::Planar;

/// Covariance with standard deviations 10^U(−6, 6) and correlations up to `correlation`.
Eigen::MatrixXd wild_covariance(Eigen::Index d, double correlation, RandomNumbers& random) {
  Eigen::MatrixXd r = Eigen::MatrixXd::Identity(d, d);
  // A chain x_k = ±c x_{k−1} + √(1 − c²) ξ_k.
  for (Eigen::Index k = 1; k < d; ++k) {
    const double c = random.uniform() < 0.5 ? correlation : -correlation;
    r.row(k) = c * r.row(k - 1);
    r(k, k) = std::sqrt(1 - c * c);
  }
  for (Eigen::Index k = 0; k < d; ++k) r.row(k) *= std::pow(10.0, 12 * random.uniform() - 6);
  return r * r.transpose();
}

/// ‖L⁻¹ C L⁻ᵀ − I‖: 0 if the spread found is that of C.
double misfit(const Eigen::MatrixXd& lower, const Eigen::MatrixXd& covariance) {
  const auto l = lower.triangularView<Eigen::Lower>();
  const Eigen::MatrixXd half = l.solve(covariance);
  const Eigen::MatrixXd whole = l.solve(half.transpose());
  return (whole - Eigen::MatrixXd::Identity(whole.rows(), whole.cols())).norm();
}

/// 0 within `half` of the origin along each axis, no density elsewhere.
class Box final : public LogDensity {
 public:
  explicit Box(double half) : half_(half) {}
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int, LogDensityBatch& out) override {
    for (Eigen::Index i = 0; i < points.rows(); ++i)
      out.value[i] =
          points.row(i).cwiseAbs().maxCoeff() <= half_ ? 0 : -std::numeric_limits<double>::infinity();
  }

 private:
  double half_;
};

TEST(ModeSearch, AFlatBoxIsAboutAsWideAsItIs) {
  for (const double half : {0.5, 2.0}) {
    Box box(half);
    CheckedDensity target(box);
    std::vector<Mode> modes;
    ModeSearch().run(target, true, modes);
    ASSERT_FALSE(modes.empty());
    const Eigen::VectorXd spread = modes[0].lower.rowwise().norm();
    EXPECT_GT(spread.minCoeff(), 0.02 * half);
    EXPECT_LT(spread.maxCoeff(), 20 * half);
  }
}

TEST(ModeSearch, GaussiansOfAnyScaleFromACold) {
  RandomNumbers random(11);
  for (int trial = 0; trial < 60; ++trial) {
    const Eigen::Index d = 1 + trial % 4;
    const Eigen::MatrixXd covariance = wild_covariance(d, trial % 3 == 0 ? 0.999 : 0.7, random);
    const Eigen::VectorXd std = covariance.diagonal().cwiseSqrt();
    const Eigen::VectorXd mean = std.cwiseProduct(10 * random.normals(d, 1).col(0));
    Gaussian user(mean, covariance.inverse(), 2.5);
    for (int derivatives : {2, 1, 0}) {
      user.derivatives = derivatives;
      CheckedDensity target(user);
      std::vector<Mode> modes;
      ModeSearch().run(target, true, modes, trial % 2 == 0 ? ScanReach::near : ScanReach::wide);
      ASSERT_FALSE(modes.empty());
      const double error = (modes[0].point - mean).cwiseQuotient(std).norm();
      EXPECT_LT(error, derivatives == 2 ? 1e-6 : 0.05) << trial << " " << derivatives;
      if (derivatives == 0) continue;
      EXPECT_LT(misfit(modes[0].lower, covariance), 0.01) << trial << " " << derivatives;
      EXPECT_NEAR(modes[0].log_mass, 2.5, 0.02) << trial << " " << derivatives;
    }
  }
}

/// −Σ (|u_k|/s_k)^power: flat at its top.
struct Power : LogDensity {
  Eigen::VectorXd centre, scale;
  double power;
  Power(Eigen::VectorXd c, Eigen::VectorXd s, double p)
      : centre(std::move(c)), scale(std::move(s)), power(p) {}
  [[nodiscard]] Eigen::Index dimension() const override { return centre.size(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
    out.value.setZero();
    if (order >= 2) out.hessian.setZero();
    for (Eigen::Index k = 0; k < dimension(); ++k)
      for (Eigen::Index i = 0; i < z.rows(); ++i) {
        const double u = (z(i, k) - centre[k]) / scale[k], size = std::abs(u);
        out.value[i] -= std::pow(size, power);
        if (order >= 1) out.gradient(i, k) = -power * std::copysign(std::pow(size, power - 1), u) / scale[k];
        if (order >= 2)
          out.hessian(i, packed_index(k, k)) =
              -power * (power - 1) * std::pow(size, power - 2) / (scale[k] * scale[k]);
      }
  }
};

TEST(ModeSearch, QuarticsOfAnyScale) {
  RandomNumbers random(5);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::Index d = 1 + trial % 3;
    Eigen::VectorXd scale(d), centre(d);
    for (Eigen::Index k = 0; k < d; ++k) {
      scale[k] = std::pow(10.0, 12 * random.uniform() - 6);
      centre[k] = 3 * scale[k] * random.normal();
    }
    Power user(centre, scale, 4);
    CheckedDensity target(user);
    std::vector<Mode> modes;
    ModeSearch().run(target, true, modes);
    EXPECT_GT(modes[0].value, -0.01) << trial;
    for (Eigen::Index k = 0; k < d; ++k) {
      const double spread = modes[0].lower.row(k).norm() / scale[k];
      EXPECT_GT(spread, 0.3) << trial;  // the standard deviation of exp(−u⁴) is 0.58
      EXPECT_LT(spread, 1.5) << trial;
    }
  }
}

TEST(ModeSearch, LogConvexTailsAreClimbed) {
  // A Student t density with 3 degrees of freedom, width 1e-3, seen from 1,000 to 10,000 widths away.
  Planar user([](double x, double y, double* r) {
    const double s = 1e-3, u = (x - 2) / s, v = (y + 3) / s, q = 1 + (u * u + v * v) / 3;
    r[0] = -2.5 * std::log(q);
    r[1] = -2.5 / q * 2 * u / 3 / s;
    r[2] = -2.5 / q * 2 * v / 3 / s;
    const double f = 2.5 / (q * q) * 4 / 9 / (s * s), g = 2.5 / q * 2 / 3 / (s * s);
    r[3] = f * u * u - g, r[4] = f * u * v, r[5] = f * v * v - g;
  });
  for (int derivatives : {2, 1, 0}) {
    user.derivatives = derivatives;
    CheckedDensity target(user);
    std::vector<Mode> modes;
    ModeSearch().run(target, true, modes);
    EXPECT_LT((modes[0].point - Eigen::Vector2d(2, -3)).norm(), 1e-4) << derivatives;
    EXPECT_EQ(modes.size(), 1u);
  }
}

TEST(ModeSearch, BothModesOfAMixtureAndNoThird) {
  Planar user(targets::mixture(5, 0.2));
  CheckedDensity target(user);
  std::vector<Mode> modes;
  ModeSearch().run(target, true, modes);
  ASSERT_EQ(modes.size(), 2u);
  EXPECT_NEAR(modes[0].point[0], 5, 1e-6);
  EXPECT_NEAR(modes[1].point[0], -5, 1e-6);
  EXPECT_NEAR(modes[0].log_mass, std::log(0.8), 1e-6);
  EXPECT_NEAR(modes[1].log_mass, std::log(0.2), 1e-6);
  // From one side only that side's, and nothing twice.
  modes.clear();
  ModeSearch().ascend_from(target, (Eigen::MatrixXd(3, 2) << 2, 1, 7, -3, 30, 2).finished(), modes);
  EXPECT_EQ(modes.size(), 1u);
}

TEST(ModeSearch, FarModelsThatBreakDownAreSurvived) {
  // exp overflows at a few hundred units, and inf − inf is NaN: the wide scan goes there.
  Planar user([](double x, double y, double* r) {
    targets::banana()(x, y, r);
    const double a = std::exp(x * x), b = std::exp(y * y);
    r[0] += 0 * (a - b);
  });
  CheckedDensity target(user);
  std::vector<Mode> modes;
  ModeSearch().run(target, true, modes, ScanReach::wide);
  EXPECT_LT(modes[0].point.norm(), 1e-6);
}

TEST(ModeSearch, ADensityFarFromTheNearScanIsFoundByTheWideOne) {
  constexpr double k_infinity = std::numeric_limits<double>::infinity();
  Planar user(
      [](double x, double y, double* r) {
        r[0] = x > 100 && x < 1e5 && y > 100 && y < 1e5
                   ? -1e-9 * (std::pow(x - 3e4, 2) + std::pow(y - 2e4, 2))
                   : -k_infinity;
      },
      0);
  CheckedDensity target(user);
  std::vector<Mode> modes;
  ModeSearch().run(target, true, modes);
  EXPECT_NEAR(modes[0].point[0], 3e4, 300);
  EXPECT_NEAR(modes[0].point[1], 2e4, 300);
  Planar nowhere([](double, double, double* r) { r[0] = -k_infinity; }, 0);
  CheckedDensity nothing(nowhere);
  try {
    ModeSearch().run(nothing, true, modes);
    FAIL();
  } catch (const NumericalError& error) {
    EXPECT_EQ(
        std::string(error.what()),
        "the density is zero at z = 0 and at 199 points around it, 1e-6 to 1e6 away; centre and scale the "
        "parameters so that the mass is near 0");
  }
}

TEST(ModeSearch, NoDimensionsAreAClearError) {
  Gaussian user(Eigen::VectorXd(0), Eigen::MatrixXd(0, 0));
  CheckedDensity target(user);
  std::vector<Mode> modes;
  try {
    ModeSearch().run(target, true, modes);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_EQ(std::string(error.what()), "a density in 0 dimensions; there must be at least 1");
  }
}

TEST(ModeSearch, TheSearchIsSmallAndRepeatable) {
  Planar user(targets::Ridge{1, 1.05, 0.02, 1.2, 0.2});
  CheckedDensity target(user);
  std::vector<Mode> first, second;
  ModeSearch search;
  search.run(target, false, first);
  EXPECT_LT(target.evaluations(), 40 + 40);  // the online update pays for this at every step
  Planar other(targets::mixture(3));
  CheckedDensity between(other);
  search.run(between, true, second);
  search.run(target, false, second);
  EXPECT_EQ(first[0].point, second[0].point);
  EXPECT_EQ(first[0].lower, second[0].lower);
}

}  // namespace
}  // namespace knothe::posterior
