#include "knothe/posterior/checked_density.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior {
namespace {

using targets::Planar;

template <class Kind>
std::string message_of(LogDensity& target, int derivatives = 2) {
  LogDensityBatch out;
  CheckedDensity checked(target);
  try {
    checked.evaluate((Eigen::MatrixXd(2, 2) << 0.5, -1, 2, 0.25).finished(), derivatives, out);
  } catch (const Kind& error) {
    return error.what();
  }
  return {};
}

/// A banana whose author made a mistake.
struct Wrong : Planar {
  std::function<void(LogDensityBatch&)> mistake;
  explicit Wrong(std::function<void(LogDensityBatch&)> m)
      : Planar(targets::banana()), mistake(std::move(m)) {}
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
    Planar::evaluate(z, order, out);
    mistake(out);
  }
};

TEST(CheckedDensity, WhatIsNotANumberIsNamedWithItsPoint) {
  const double nan = std::nan("");
  Wrong value([&](LogDensityBatch& out) { out.value[1] = nan; });
  EXPECT_EQ(
      message_of<NumericalError>(value),
      "the log-density is nan at z = (2, 0.25); it must be a number, or -inf where the density is zero");
  Wrong infinite([&](LogDensityBatch& out) { out.value[0] = std::numeric_limits<double>::infinity(); });
  EXPECT_EQ(
      message_of<NumericalError>(infinite),
      "the log-density is inf at z = (0.5, -1); it must be a number, or -inf where the density is zero");
  Wrong gradient([&](LogDensityBatch& out) { out.gradient(0, 1) = nan; });
  EXPECT_EQ(message_of<NumericalError>(gradient),
            "the gradient of the log-density is not finite at z = (0.5, -1); it must be finite "
            "wherever the density is not zero");
  Wrong hessian([&](LogDensityBatch& out) { out.hessian(1, 2) = nan; });
  EXPECT_EQ(message_of<NumericalError>(hessian),
            "the Hessian of the log-density is not finite at z = (2, 0.25); it must be finite "
            "wherever the density is not zero");
  Wrong zero([&](LogDensityBatch& out) { out.value[0] = -std::numeric_limits<double>::infinity(); });
  EXPECT_EQ(message_of<NumericalError>(zero), "");
}

TEST(CheckedDensity, WhereTheDensityIsZeroNoDerivativesAreAskedFor) {
  // Neal's funnel: e^{-x} overflows in the far tail, and its derivatives before its value.
  const double infinity = std::numeric_limits<double>::infinity(), nan = std::nan("");
  for (const double value : {-infinity, -1e101}) {
    Wrong tail([&](LogDensityBatch& out) {
      out.value[0] = value;
      out.gradient(0, 0) = -infinity, out.hessian(0, 2) = nan;
    });
    CheckedDensity checked(tail);
    LogDensityBatch out;
    checked.evaluate(Eigen::MatrixXd::Constant(2, 2, 0.5), 2, out);
    EXPECT_EQ(out.value[0], -infinity);
    EXPECT_EQ(out.gradient.row(0), Eigen::RowVectorXd::Zero(2));
    EXPECT_EQ(out.hessian.row(0), Eigen::RowVectorXd::Zero(3));
    EXPECT_NE(out.gradient.row(1), Eigen::RowVectorXd::Zero(2));
  }
}

TEST(CheckedDensity, ResizedBuffersAreRefused) {
  const auto expected = [](const std::string& what, const std::string& wanted, const std::string& given) {
    return "the log-density was given a buffer for its " + what + " of " + wanted + " and handed back " +
           given + "; it must fill the buffers it is given and leave their sizes alone";
  };
  Wrong value([](LogDensityBatch& out) { out.value = Eigen::VectorXd::Zero(5); });
  EXPECT_EQ(message_of<UsageError>(value), expected("values", "2 × 1", "5 × 1"));
  Wrong gradient([](LogDensityBatch& out) { out.gradient = Eigen::MatrixXd::Zero(2, 3); });
  EXPECT_EQ(message_of<UsageError>(gradient), expected("gradient", "2 × 2", "2 × 3"));
  Wrong hessian([](LogDensityBatch& out) { out.hessian = Eigen::MatrixXd::Zero(2, 4); });
  EXPECT_EQ(message_of<UsageError>(hessian), expected("Hessian", "2 × 3", "2 × 4"));
}

TEST(CheckedDensity, AnEntryNotWrittenIsFound) {
  // The buffers hold a good answer from before; without poison it would pass for this one's.
  struct Lazy : Planar {
    bool lazy = false;
    Lazy() : Planar(targets::banana()) {}
    void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
      Planar::evaluate(lazy ? Eigen::MatrixXd(z.topRows(z.rows() - 1)) : Eigen::MatrixXd(z), order, out);
    }
  } target;
  CheckedDensity checked(target);
  LogDensityBatch out;
  const Eigen::MatrixXd z = Eigen::MatrixXd::Ones(3, 2);
  checked.evaluate(z, 2, out);
  EXPECT_EQ(checked.evaluations(), 3);
  target.lazy = true;
  EXPECT_THROW(checked.evaluate(z, 0, out), NumericalError);
}

TEST(CheckedDensity, WhatTheTargetThrowsComesThroughAsItIs) {
  struct ModelFailure : std::runtime_error {
    using std::runtime_error::runtime_error;
  };
  Wrong target([](LogDensityBatch&) { throw ModelFailure("server said: out of licences"); });
  EXPECT_EQ(message_of<ModelFailure>(target), "server said: out of licences");
}

TEST(CheckedDensity, LenientlyPointsThatBreakHaveNoDensity) {
  Wrong target([](LogDensityBatch& out) {
    out.value[0] = std::nan("");
    out.gradient(1, 0) = std::numeric_limits<double>::infinity();
  });
  CheckedDensity checked(target);
  LogDensityBatch out;
  const Eigen::MatrixXd z = Eigen::MatrixXd::Ones(3, 2);
  {
    const CheckedDensity::Leniency lenient(checked);
    checked.evaluate(z, 2, out);
    EXPECT_EQ(out.value[0], -std::numeric_limits<double>::infinity());
    EXPECT_EQ(out.value[1], -std::numeric_limits<double>::infinity());
    EXPECT_EQ(out.gradient(1, 0), 0);
    EXPECT_TRUE(std::isfinite(out.value[2]));
  }
  EXPECT_THROW(checked.evaluate(z, 2, out), NumericalError);
}

TEST(CheckedDensity, DifferencesFollowTheScale) {
  // A quartic of width s: second derivative of −(x/s)⁴ at s is −12/s².
  for (double s : {1e-6, 1.0, 1e6})
    for (int derivatives : {0, 1}) {
      Planar target(
          [s](double x, double y, double* r) {
            const double u = x / s;
            r[0] = -u * u * u * u - 0.5 * y * y - u * y;
            r[1] = (-4 * u * u * u - y) / s;
            r[2] = -y - u;
          },
          derivatives);
      CheckedDensity checked(target);
      LogDensityBatch out;
      checked.evaluate_with_differences(Eigen::RowVector2d(s, 0.5), 2, Eigen::RowVector2d(s, 1), out);
      EXPECT_NEAR(out.gradient(0, 0) * s, -4.5, 1e-5);
      EXPECT_NEAR(out.hessian(0, packed_index(0, 0)) * s * s, -12, 1e-5);
      EXPECT_NEAR(out.hessian(0, packed_index(1, 0)) * s, -1, 1e-5);
      EXPECT_NEAR(out.hessian(0, packed_index(1, 1)), -1, 1e-5);
    }
}

}  // namespace
}  // namespace knothe::posterior
