#include "knothe/assimilation/verdict/model_shift.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>

#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

MatrixXd random_matrix(Index rows, Index columns, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
}

ModelShift shift_of(std::shared_ptr<const model::ParameterFunctions> functions, const MatrixXd& points,
                    const std::vector<posterior::Prior>& priors) {
  model::ObservedModel model;
  model.functions = std::move(functions);
  model::ObservedErrors errors;
  errors.points = points;
  return {model, errors, posterior::PriorTransform(priors)};
}

/// A linear model with normal priors: (G + Λ)⁻¹ h, however large.
TEST(ModelShift, OfALinearModelIsTheConjugateFormula) {
  const Index d = 3;
  const MatrixXd root = random_matrix(d, d, 1), h = 20 * random_matrix(d, 5, 2);
  const MatrixXd quadratic = root * root.transpose();
  const ModelShift shift =
      shift_of(std::make_shared<likelihood::test::LinearFunctions>(d), random_matrix(5, d, 3),
               std::vector<posterior::Prior>(3, posterior::Prior::normal(1, 2)));
  const MatrixXd covariance =
      (quadratic + 0.25 * MatrixXd::Identity(d, d)).llt().solve(MatrixXd::Identity(d, d));
  const MatrixXd expected = covariance.diagonal().cwiseSqrt().cwiseInverse().asDiagonal() * (covariance * h);
  EXPECT_LT((shift.of(quadratic, h) - expected).cwiseAbs().maxCoeff(), 1e-9 * expected.cwiseAbs().maxCoeff());
}

/// A model that bends over the shift: the objective's minimum on a fine grid, derivatives by differences.
TEST(ModelShift, OfACurvedModelIsTheFitToTheKnownSolution) {
  const auto functions = std::make_shared<likelihood::test::CurvedFunctions>();
  const auto w = [&](const Vector2d& p) {
    model::FunctionBatch batch;
    batch.resize(1, 2, 3, 0);
    functions->evaluate(p.transpose(), 0, batch);
    return VectorXd(batch.value.row(0).transpose());
  };
  const MatrixXd points = (MatrixXd(3, 2) << 0.9, 1.1, 1.3, 0.7, 0.7, 0.8).finished();
  const MatrixXd root = 40 * random_matrix(3, 3, 4);
  const MatrixXd quadratic = root * root.transpose();
  MatrixXd h(3, 3);
  for (Index j = 0; j < 3; ++j)
    h.col(j) = quadratic * (0.04 * random_matrix(3, 1, 10 + static_cast<unsigned>(j)));
  const std::vector<posterior::Prior> priors(2, posterior::Prior::normal(1, 0.3).truncated(0.5, 1.5, "p"));
  const MatrixXd found = shift_of(functions, points, priors).of(quadratic, h);
  const posterior::PriorTransform transform(priors);
  const double std = 0.5 * (transform.prior(0).from_standard_normal(1).value -
                            transform.prior(0).from_standard_normal(-1).value);
  const MatrixXd precision = MatrixXd::Identity(2, 2) / (std * std);
  double largest = 0;
  for (Index j = 0; j < 3; ++j) {
    const Vector2d known = points.row(j).transpose();
    const VectorXd there = w(known);
    double best = std::numeric_limits<double>::infinity();
    Vector2d at;
    for (int a = 0; a <= 1000; ++a)
      for (int b = 0; b <= 1000; ++b) {
        const Vector2d p(0.5 + 1e-3 * a, 0.5 + 1e-3 * b);
        const VectorXd v = w(p) - there;
        const double value =
            0.5 * v.dot(quadratic * v) - v.dot(h.col(j)) + 0.5 * (p - known).dot(precision * (p - known));
        if (value < best) best = value, at = p;
      }
    MatrixXd slope(3, 2);
    for (Index a = 0; a < 2; ++a) {
      const Vector2d e = 1e-5 * Vector2d::Unit(a);
      slope.col(a) = (w(at + e) - w(at - e)) / 2e-5;
    }
    const MatrixXd covariance =
        (slope.transpose() * quadratic * slope + precision).llt().solve(MatrixXd::Identity(2, 2));
    const Vector2d expected = (at - known).cwiseQuotient(Vector2d(covariance.diagonal().cwiseSqrt()));
    largest = std::max(largest, expected.cwiseAbs().maxCoeff());
    EXPECT_LT((found.col(j) - expected).cwiseAbs().maxCoeff(), 0.03 * (1 + expected.norm())) << j;
  }
  EXPECT_GT(largest, 1);  // not in the linear range
}

}  // namespace
}  // namespace knothe::assimilation
