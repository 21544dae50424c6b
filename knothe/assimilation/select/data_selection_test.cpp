#include "knothe/assimilation/select/data_selection.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/assimilation/select/sensitivity.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using likelihood::test::CurvedFunctions;
using likelihood::test::LinearFunctions;
using likelihood::test::random_model;
using Indices = std::vector<Eigen::Index>;

constexpr Eigen::Index k_dofs = 9, k_steps = 5;

likelihood::NoiseModel chain(double scale) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < k_dofs; ++i) {
    entries.emplace_back(i, i, scale * (2.2 + 0.1 * i));
    if (i == 0) continue;
    entries.emplace_back(i, i - 1, -scale);
    entries.emplace_back(i - 1, i, -scale);
  }
  Eigen::SparseMatrix<double> m(k_dofs, k_dofs);
  m.setFromTriplets(entries.begin(), entries.end());
  return likelihood::NoiseModel::correlated(m);
}

Eigen::Matrix<double, Eigen::Dynamic, 3> in_a_row() {
  Eigen::Matrix<double, Eigen::Dynamic, 3> points(k_dofs, 3);
  points.setZero();
  points.col(0).setLinSpaced(0, k_dofs - 1);
  return points;
}

/// I + F of the dofs `s`, written out: all steps at once, dense covariance R_ss ⊗ T.
Eigen::MatrixXd dense_information(const model::ObservedModel& model, const likelihood::NoiseModel& noise,
                                  const Eigen::VectorXd& prior_std, const Eigen::VectorXd& p,
                                  const Indices& s) {
  const auto n = static_cast<Eigen::Index>(s.size());
  const Eigen::MatrixXd r = Eigen::MatrixXd(noise.measurement().precision()).inverse()(s, s);
  const double k = noise.shared_reference();
  Eigen::MatrixXd covariance(n * k_steps, n * k_steps), j(n * k_steps, p.size());
  for (Eigen::Index t = 0; t < k_steps; ++t) {
    j.middleRows(t * n, n) =
        sensitivity_fields(model, p, static_cast<std::size_t>(t))(s, Eigen::all) * prior_std.asDiagonal();
    for (Eigen::Index u = 0; u < k_steps; ++u) {
      const double same = t == u ? 1.0 : k > 0 ? 1 / (k + 1) : 0.0;
      covariance.block(t * n, u * n, n, n) = same * r;
    }
  }
  return Eigen::MatrixXd::Identity(p.size(), p.size()) + j.transpose() * covariance.llt().solve(j);
}

double mean_half_log_det(const model::ObservedModel& model, const likelihood::NoiseModel& noise,
                         const Eigen::VectorXd& prior_std, const Eigen::MatrixXd& points, const Indices& s) {
  double sum = 0;
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    const Eigen::VectorXd p = points.row(i);
    sum += 0.5 * std::log(dense_information(model, noise, prior_std, p, s).determinant());
  }
  return sum / static_cast<double>(points.rows());
}

struct Case {
  const char* name;
  likelihood::NoiseModel noise;
  Eigen::MatrixXd points;
};

std::vector<Case> cases() {
  const Eigen::MatrixXd one = Eigen::RowVector2d(1.0, 0.9);
  Eigen::MatrixXd several(3, 2);
  several << 1.0, 0.9, 0.7, 1.3, 1.4, 0.6;
  const likelihood::NoiseModel independent =
      likelihood::NoiseModel::independent(Eigen::VectorXd::LinSpaced(k_dofs, 0.3, 0.6));
  return {{"independent", independent, one},
          {"correlated", chain(9), one},
          {"shared reference", chain(9).with_shared_reference(1), one},
          {"expected gain", chain(9).with_shared_reference(2), several}};
}

TEST(DataSelection, GreedyChoiceIsThatOfBruteForce) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  const Eigen::Vector2d prior_std(0.2, 0.3);
  for (const Case& c : cases()) {
    const SensorDesign design(*model, c.noise, prior_std, c.points, in_a_row());
    const Selection selection = design.choose(4);
    ASSERT_EQ(selection.dofs.size(), 4u);
    Indices chosen;
    double before = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      double best = -1;
      Eigen::Index best_dof = -1;
      for (Eigen::Index k = 0; k < k_dofs; ++k) {
        if (std::find(chosen.begin(), chosen.end(), k) != chosen.end()) continue;
        Indices with = chosen;
        with.push_back(k);
        const double value = mean_half_log_det(*model, c.noise, prior_std, c.points, with);
        if (value > best) best = value, best_dof = k;
      }
      EXPECT_EQ(selection.dofs[i], best_dof) << c.name;
      EXPECT_NEAR(selection.gain[i], best - before, 1e-9) << c.name;
      chosen.push_back(best_dof);
      before = best;
      const Eigen::VectorXd p = c.points.row(0);
      const Eigen::MatrixXd exact = dense_information(*model, c.noise, prior_std, p, chosen);
      EXPECT_TRUE((selection.information[i] + Eigen::Matrix2d::Identity()).isApprox(exact, 1e-9)) << c.name;
    }
  }
}

TEST(DataSelection, AllDofsOneByOneAreAllDofsAtOnce) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(3),
                                                    k_dofs, 4, k_steps, 3);
  const Eigen::Vector3d prior_std(0.2, 0.3, 1);
  Indices all(k_dofs);
  std::iota(all.begin(), all.end(), Eigen::Index{0});
  for (const Case& c : cases()) {
    const SensorDesign design(*model, c.noise, prior_std, Eigen::RowVector3d(1, 2, 3), in_a_row());
    const Selection one_by_one = design.along(all);
    EXPECT_TRUE(one_by_one.information.back().isApprox(design.information_of_all(), 1e-9)) << c.name;
    // Three parameters: the gains of `choose` come from another formula.
    const Selection chosen = design.choose(k_dofs);
    EXPECT_TRUE(chosen.information.back().isApprox(design.information_of_all(), 1e-9)) << c.name;
    const Selection again = design.along(chosen.dofs);
    for (std::size_t i = 0; i < chosen.gain.size(); ++i) EXPECT_NEAR(chosen.gain[i], again.gain[i], 1e-9);
  }
}

TEST(DataSelection, GreedyIsNearTheBestOfAllSubsets) {
  // (1 − 1/e) of the optimum is guaranteed for independent noise (submodular); here it is far better.
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  const Eigen::Vector2d prior_std(0.2, 0.3);
  const Case c = cases()[0];
  double best = 0;
  for (Eigen::Index i = 0; i < k_dofs; ++i) {
    for (Eigen::Index j = 0; j < i; ++j) {
      for (Eigen::Index k = 0; k < j; ++k)
        best = std::max(best, mean_half_log_det(*model, c.noise, prior_std, c.points, {k, j, i}));
    }
  }
  const Selection greedy = SensorDesign(*model, c.noise, prior_std, c.points, in_a_row()).choose(3);
  EXPECT_GT(greedy.gain[0] + greedy.gain[1] + greedy.gain[2], 0.95 * best);
  EXPECT_LE(greedy.gain[0] + greedy.gain[1] + greedy.gain[2], best + 1e-12);
}

TEST(DataSelection, DistanceIsKept) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  const SensorDesign design(*model, chain(9), Eigen::Vector2d(0.2, 0.3), Eigen::RowVector2d(1, 1),
                            in_a_row());
  const Selection selection = design.choose(100, 3.0);
  EXPECT_GE(selection.dofs.size(), 2u);
  for (std::size_t i = 0; i < selection.dofs.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) EXPECT_GE(std::abs(selection.dofs[i] - selection.dofs[j]), 3);
  }
  const Eigen::VectorXd score = Eigen::VectorXd::LinSpaced(k_dofs, 1, 9);
  EXPECT_EQ(highest(score, 10, in_a_row(), 3.0), (Indices{8, 5, 2}));
  EXPECT_EQ(highest(Eigen::VectorXd::Ones(k_dofs), 3, in_a_row(), 0), (Indices{0, 1, 2}));
}

TEST(Sensitivity, FieldsAgreeWithFiniteDifferences) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  const Eigen::Vector2d p(1.1, 0.8);
  const double h = 1e-5;
  const Eigen::MatrixXd s = sensitivity_fields(*model, p, 2);
  for (Eigen::Index a = 0; a < 2; ++a) {
    const Eigen::Vector2d step = h * Eigen::Vector2d::Unit(a);
    const Eigen::VectorXd first = (model->predict(p + step, 2) - model->predict(p - step, 2)) / (2 * h);
    EXPECT_LT((s.col(a) - first).cwiseAbs().maxCoeff(), 1e-8);
  }
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(k_dofs);
  for (std::size_t t = 0; t < k_steps; ++t) sum += sensitivity_fields(*model, p, t).col(1).cwiseAbs2();
  EXPECT_TRUE(sensitivity_over_time(*model, p).col(1).isApprox(sum.cwiseSqrt(), 1e-14));
}

TEST(Sensitivity, Criteria) {
  Eigen::MatrixXd weighted(2, 2);
  weighted << -2, 3, 5, 1;
  EXPECT_EQ(sensitivity_score(weighted, SensitivityCriterion::product), Eigen::Vector2d(6, 5));
  EXPECT_EQ(sensitivity_score(weighted, SensitivityCriterion::minimum), Eigen::Vector2d(2, 1));
  EXPECT_EQ(sensitivity_score(weighted, SensitivityCriterion::maximum), Eigen::Vector2d(3, 5));
}

}  // namespace
}  // namespace knothe::assimilation
