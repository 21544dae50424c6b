#include "knothe/assimilation/select/run_selection.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

using Function = std::function<VectorXd(const VectorXd&)>;

/// Mean and std of two parameters with uniform priors on [0, 1]² by the trapezoidal rule on `nodes`² points
/// around `centre`.
std::pair<VectorXd, VectorXd> dense_posterior(const Function& predict, const VectorXd& data,
                                              const VectorXd& centre, const VectorXd& width) {
  constexpr int k_nodes = 121;
  VectorXd mean = VectorXd::Zero(2), square = VectorXd::Zero(2);
  double total = 0;
  for (int a = 0; a < k_nodes; ++a)
    for (int b = 0; b < k_nodes; ++b) {
      VectorXd p(2);
      p << centre[0] + width[0] * (2.0 * a / (k_nodes - 1) - 1),
          centre[1] + width[1] * (2.0 * b / (k_nodes - 1) - 1);
      if (p.minCoeff() < 0 || p.maxCoeff() > 1) continue;
      const double weight = std::exp(-0.5 * (predict(p) - data).squaredNorm());
      total += weight;
      mean += weight * p;
      square += weight * p.cwiseAbs2();
    }
  mean /= total;
  return {mean, (square / total - mean.cwiseAbs2()).cwiseSqrt()};
}

/// Predictions in units of their noise.
VectorXd decay(const VectorXd& p) {
  VectorXd y(12);
  for (Index t = 0; t < y.size(); ++t)
    y[t] = 40 * (1 + p[0]) * std::exp(-(0.3 + 0.5 * p[1]) * 0.3 * static_cast<double>(t));
  return y;
}

TEST(ExpectedShift, IsTheShiftOfADenseQuadrature) {
  // An interpolation, and an error of it that is a polynomial of the next degrees.
  numerics::SparseInterpolation interpolation(VectorXd::Zero(2), VectorXd::Ones(2));
  for (int total = 0; total <= 6; ++total)
    for (int a = 0; a <= total; ++a) interpolation.add({a, total - a});
  MatrixXd values(interpolation.count(), 12);
  for (Index n = 0; n < values.rows(); ++n)
    values.row(n) =
        decay(interpolation.node(interpolation.indices()[static_cast<std::size_t>(n)])).transpose();
  const MatrixXd surpluses = interpolation.surpluses(values);
  ExpectedShift expected({posterior::Prior::uniform(0, 1), posterior::Prior::uniform(0, 1)});
  expected.set(interpolation, surpluses);
  const Function model = [&](const VectorXd& p) -> VectorXd {
    return surpluses.transpose() * interpolation.basis(p);
  };
  const Function error = [](const VectorXd& p) {
    VectorXd e(12);
    for (Index t = 0; t < e.size(); ++t)
      e[t] = 0.5 * std::sin(0.4 * static_cast<double>(t) + 2 * p[0]) + 0.4 * p[1];
    return e;
  };
  const Function exact = [&](const VectorXd& p) -> VectorXd { return model(p) + error(p); };
  for (const auto& [first, second] : {std::pair{0.5, 0.5}, {0.35, 0.7}, {0.6, 0.25}}) {
    VectorXd truth(2);
    truth << first, second;
    const VectorXd data = exact(truth);
    const VectorXd width = VectorXd::Constant(2, 0.25);
    const auto [right, std] = dense_posterior(exact, data, truth, width);
    const VectorXd wrong = dense_posterior(model, data, truth, width).first;
    const double shift = (wrong - right).cwiseQuotient(std).cwiseAbs().maxCoeff();
    EXPECT_GT(shift, 0.2);
    EXPECT_NEAR(expected.at(truth, error(truth)), shift, 0.15 * shift);
  }
}

TEST(ExpectedShift, IsExactForLinearPredictionsAndNormalPriors) {
  // y = 3 p + e with noise 1 and a prior of variance 0.25: C = 1/(9 + 4), shift = C 3 e/√C.
  MatrixXd information(1, 1), pull(1, 2);
  information << 9;
  pull << 3 * 0.5, 3 * -2;
  const VectorXd shift = linear_posterior_shift(information, VectorXd::Constant(1, 0.25), pull);
  EXPECT_NEAR(shift[0], 1.5 / std::sqrt(13.0), 1e-14);
  EXPECT_NEAR(shift[1], 6 / std::sqrt(13.0), 1e-14);
}

Predictions from(const Function& f, std::size_t* count = nullptr) {
  return [f, count](const std::vector<std::vector<double>>& points) {
    MatrixXd result;
    for (std::size_t n = 0; n < points.size(); ++n) {
      const VectorXd y =
          f(Eigen::Map<const VectorXd>(points[n].data(), static_cast<Index>(points[n].size())));
      if (n == 0) result.resize(static_cast<Index>(points.size()), y.size());
      result.row(static_cast<Index>(n)) = y.transpose();
    }
    if (count != nullptr) *count += points.size();
    return result;
  };
}

std::vector<posterior::Prior> uniform_priors(std::size_t d) {
  return std::vector<posterior::Prior>(d, posterior::Prior::uniform(0, 1));
}

TEST(RunSelection, StopsAtTheShiftWithFewRunsWhereOneParameterIsNearlyLinear) {
  std::size_t asked = 0;
  const SelectedRuns selected = select_runs(uniform_priors(2), VectorXd::Zero(2), VectorXd::Ones(2),
                                            {.shift = 0.05, .runs = 200}, from(decay, &asked));
  EXPECT_TRUE(selected.reached);
  EXPECT_EQ(asked, selected.history.back().runs);
  EXPECT_EQ(selected.points.size() + selected.held_out_points.size(), asked);
  EXPECT_EQ(selected.interpolation.degree(0), 2);  // linear in p₀: degree 1, and one to see it
  EXPECT_GE(selected.interpolation.degree(1), 3);
  EXPECT_LT(asked, 30U);
  // What it promises holds at truths it has not seen.
  ExpectedShift judge(uniform_priors(2));
  judge.set(selected.interpolation, selected.surpluses);
  const MatrixXd truths = judge.draw(50, 99);
  double square = 0;
  for (Index n = 0; n < truths.rows(); ++n) {
    const VectorXd p = truths.row(n).transpose();
    const double shift =
        judge.at(p, decay(p) - selected.surpluses.transpose() * selected.interpolation.basis(p));
    square += shift * shift / 50;
  }
  EXPECT_LT(std::sqrt(square), 0.05);
}

TEST(RunSelection, IsTheSameWheneverItIsRepeated) {
  const auto run = [] {
    return select_runs(uniform_priors(2), VectorXd::Zero(2), VectorXd::Ones(2), {.shift = 0.01, .runs = 60},
                       from(decay));
  };
  const SelectedRuns first = run(), second = run();
  EXPECT_EQ(first.points, second.points);
  EXPECT_EQ(first.surpluses, second.surpluses);
}

TEST(RunSelection, HeldOutRunsUncoverWhatTheNodesDoNotSee) {
  // Zero at 0, ½ and 1, where the first three nodes of p₁ are: its surpluses say that there is nothing.
  const Function hidden = [](const VectorXd& p) {
    VectorXd y(2);
    y << 100 * p[0], 100 * p[0] + 30 * std::sin(2 * 3.14159265358979 * p[1]);
    return y;
  };
  const SelectedRuns selected = select_runs(uniform_priors(2), VectorXd::Zero(2), VectorXd::Ones(2),
                                            {.shift = 0.2, .runs = 200}, from(hidden));
  EXPECT_TRUE(selected.reached);
  EXPECT_GE(selected.interpolation.degree(1), 5);
}

TEST(RunSelection, EndsAtTheNumberOfRunsAndSaysSo) {
  std::size_t asked = 0;
  const SelectedRuns selected = select_runs(uniform_priors(2), VectorXd::Zero(2), VectorXd::Ones(2),
                                            {.shift = 1e-9, .runs = 25}, from(decay, &asked));
  EXPECT_FALSE(selected.reached);
  EXPECT_LE(asked, 25U);
  EXPECT_GE(asked, 23U);
  try {
    (void)select_runs(uniform_priors(2), VectorXd::Zero(2), VectorXd::Ones(2), {.shift = 0.1, .runs = 12},
                      from(decay));
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_STREQ(
        error.what(),
        "12 runs are allowed, and 13 are the least for 2 parameters: 8 held out to judge by, and three "
        "values of each parameter");
  }
}

TEST(RunSelection, EstimatesTheRunsToGoFromAPower) {
  std::vector<RunSelectionStep> history;
  for (const std::size_t runs : {20U, 30U, 40U, 50U})
    history.push_back({runs, 0, 100 * std::pow(static_cast<double>(runs), -2.0)});
  // 100 n⁻² = 0.01 at n = 100.
  EXPECT_NEAR(static_cast<double>(runs_to_go(history, {.shift = 0.01, .runs = 400})), 50, 1);
  EXPECT_EQ(runs_to_go(history, {.shift = 0.01, .runs = 60}), 10U);
  history.back().held_out = 1;  // it no longer falls
  EXPECT_EQ(runs_to_go(history, {.shift = 0.01, .runs = 400}), 350U);
}

/// Signals without a term of both parameters, in units of the noise; no solution near one corner of the box.
VectorXd sum_of_two(const VectorXd& p) {
  VectorXd y(12);
  for (Index t = 0; t < y.size(); ++t)
    y[t] = 40 * std::exp(-(0.3 + 0.5 * p[1]) * 0.3 * static_cast<double>(t)) +
           20 * std::sin(p[0]) * static_cast<double>(t);
  if (p[0] > 0.9 && p[1] > 0.9) y.setConstant(std::nan(""));
  return y;
}

TEST(RunSelection, APointWithoutASolutionIsLeftOutWithAllThatBuildsOnIt) {
  std::size_t asked = 0;
  const SelectedRuns selected = select_runs(uniform_priors(2), VectorXd::Zero(2), VectorXd::Ones(2),
                                            {.shift = 0.05, .runs = 200}, from(sum_of_two, &asked));
  EXPECT_TRUE(selected.reached);
  EXPECT_GE(selected.failed, 1u);
  EXPECT_EQ(selected.points.size() + selected.held_out_points.size() + selected.failed, asked);
  EXPECT_EQ(asked, selected.history.back().runs);
  for (const numerics::MultiIndex& index : selected.interpolation.indices())
    EXPECT_TRUE(index[0] == 0 || index[1] == 0);
  // What is left is right wherever there is a solution.
  for (const auto& [a, b] : {std::pair{0.3, 0.8}, {0.85, 0.1}, {0.95, 0.5}}) {
    const VectorXd p = Eigen::Vector2d(a, b);
    EXPECT_LT((selected.surpluses.transpose() * selected.interpolation.basis(p) - sum_of_two(p)).norm(),
              0.05);
  }
}

TEST(RunSelection, WithoutTheMiddleOrAnEndOfAnAxisThereIsNothingToBuildOn) {
  const auto without = [](const Function& fails) {
    const Function f = [fails](const VectorXd& p) {
      VectorXd y = decay(p);
      if (fails(p)[0] > 0) y.setConstant(std::nan(""));
      return y;
    };
    try {
      (void)select_runs(uniform_priors(2), VectorXd::Zero(2), VectorXd::Ones(2), {.shift = 0.1, .runs = 50},
                        from(f));
    } catch (const NumericalError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const auto flag = [](bool yes) { return VectorXd::Constant(1, yes ? 1.0 : 0.0); };
  EXPECT_THAT(without([&](const VectorXd& p) -> VectorXd { return flag(p[0] == 0.5 && p[1] == 0.5); }),
              testing::HasSubstr("no solution in the middle of the box"));
  EXPECT_THAT(without([&](const VectorXd& p) -> VectorXd { return flag(p[1] == 1); }),
              testing::HasSubstr("no solution at the upper end of parameter 2"));
  EXPECT_THAT(without([&](const VectorXd& p) -> VectorXd { return flag(p[1] > 0.3); }),
              testing::HasSubstr("of 8 held-out runs have a solution, too few to judge by"));
}

}  // namespace
}  // namespace knothe::assimilation
