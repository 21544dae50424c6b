#include "knothe/likelihood/step/quadratic_factor.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "knothe/likelihood/step/collapsed_posterior.hpp"
#include "knothe/likelihood/testing/test_models.hpp"
#include "knothe/model/reduced/spline_functions.hpp"

namespace knothe::likelihood {
namespace {

Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index columns, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  return Eigen::MatrixXd::NullaryExpr(rows, columns,
                                      [&](Eigen::Index, Eigen::Index) { return normal(random); });
}

/// The form of random data of rank `rank`, with h in the range of H as data have it, if `consistent`.
StepForm random_form(Eigen::Index r, Eigen::Index rank, double size, bool consistent) {
  StepForm form = StepForm::zero(r);
  const Eigen::MatrixXd root = size * random_matrix(r, rank, 7);
  form.quadratic = root * root.transpose();
  form.linear =
      consistent ? (root * random_matrix(rank, 1, 8)).eval() : (size * random_matrix(r, 1, 9)).eval();
  form.constant = 40;
  form.log_normaliser = 12.5;
  return form;
}

TEST(QuadraticFactor, ReproducesTheForm) {
  for (Eigen::Index r : {1, 5, 12}) {
    for (Eigen::Index rank = 0; rank <= r; ++rank) {
      for (double bound : {10.0, std::numeric_limits<double>::infinity()}) {
        for (bool consistent : {true, false}) {
          const StepForm form = random_form(r, rank, 3.0, consistent);
          QuadraticFactor factor;
          factor.compute(form.quadratic, form.linear, Eigen::VectorXd::Constant(r, bound));
          EXPECT_EQ(factor.rank(), rank);
          const Eigen::VectorXd y = factor.solution();
          for (unsigned seed : {1u, 2u, 3u}) {
            const Eigen::VectorXd v = random_matrix(r, 1, seed);
            const double expected = v.dot(form.quadratic * v) - 2 * form.linear.dot(v);
            const double got = (factor.lower().transpose() * v - y).squaredNorm() - y.squaredNorm() -
                               2 * factor.remainder().dot(v);
            EXPECT_NEAR(got, expected, 1e-9 * (1 + v.dot(form.quadratic * v)));
          }
        }
      }
    }
  }
}

TEST(QuadraticFactor, LeavesAwayWhatCannotBeFelt) {
  StepForm form = StepForm::zero(3);
  form.quadratic.diagonal() << 1e6, 1e-14, 1e-14;
  form.linear << 2, 1e-15, 0;
  QuadraticFactor factor;
  factor.compute(form.quadratic, form.linear, Eigen::Vector3d(1, 1, 1));
  EXPECT_EQ(factor.rank(), 1);
  EXPECT_EQ(factor.remainder(), Eigen::VectorXd::Zero(3));
  factor.compute(form.quadratic, form.linear, Eigen::Vector3d(1, 1, 1e9));
  EXPECT_EQ(factor.rank(), 2);
}

/// −½ (vᵀHv − 2hᵀv + c + log-normaliser) with w as the functions give it.
Eigen::VectorXd direct(const model::ParameterFunctions& functions, const StepForm& form,
                       const Eigen::VectorXd& w0, const Eigen::MatrixXd& p) {
  model::FunctionBatch batch;
  batch.resize(p.rows(), functions.dimension(), functions.count(), 0);
  functions.evaluate(p, 0, batch);
  Eigen::VectorXd value(p.rows());
  for (Eigen::Index i = 0; i < p.rows(); ++i) {
    const Eigen::VectorXd v = batch.value.row(i).transpose() - w0;
    value[i] =
        -0.5 * (v.dot(form.quadratic * v) - 2 * form.linear.dot(v) + form.constant + form.log_normaliser);
  }
  return value;
}

TEST(CollapsedLogDensity, IsTheDirectFormulaForFullAndDeficientRank) {
  for (std::size_t d : {1u, 2u, 3u}) {
    const Eigen::Index r = 10;
    const std::vector<std::vector<double>> nodes(d, {0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1});
    const auto n = static_cast<Eigen::Index>(std::pow(7, d) + 0.5);
    const Eigen::MatrixXd at_nodes = random_matrix(n, r, 3);
    const auto functions = std::make_shared<model::JointFunctions>(
        nodes, std::span<const double>(at_nodes.data(), static_cast<std::size_t>(at_nodes.size())), r);
    const std::vector<posterior::Prior> priors(d,
                                               posterior::Prior::normal(0.8, 0.3).truncated(0.5, 1.1, "p"));
    const Eigen::VectorXd w0 = random_matrix(r, 1, 4);
    CollapsedLogDensity density(functions, std::make_shared<posterior::PriorTransform>(priors), w0);
    const Eigen::MatrixXd p =
        (0.8 + 0.3 * random_matrix(60, static_cast<Eigen::Index>(d), 5).array().sin()).matrix();
    posterior::LogDensityBatch batch;
    batch.resize(p.rows(), p.cols(), 2);
    for (Eigen::Index rank : {0, 3, 10}) {
      for (double size : {1.0, 1e3}) {
        const StepForm form = random_form(r, rank, size, rank > 0);
        density.set_form(form);
        density.evaluate_likelihood(p, 2, batch);
        const Eigen::VectorXd expected = direct(*functions, form, w0, p);
        for (Eigen::Index i = 0; i < p.rows(); ++i)
          EXPECT_NEAR(batch.value[i], expected[i], 1e-8 + 1e-9 * std::abs(expected[i]));
        EXPECT_TRUE(batch.gradient.allFinite() && batch.hessian.allFinite());
      }
    }
  }
}

}  // namespace
}  // namespace knothe::likelihood
