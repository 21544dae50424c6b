#include "knothe/likelihood/data/clock.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <numbers>

#include "knothe/likelihood/step/datum_projector.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::likelihood {
namespace {

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

/// A precision matrix that couples neighbours.
Eigen::SparseMatrix<double> chain(Eigen::Index n) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < n; ++i) {
    entries.emplace_back(i, i, 2.5 + 0.3 * i);
    if (i > 0) entries.emplace_back(i, i - 1, -1), entries.emplace_back(i - 1, i, -1);
  }
  Eigen::SparseMatrix<double> m(n, n);
  m.setFromTriplets(entries.begin(), entries.end());
  return m;
}

/// −2 log N(residual; 0, covariance).
double minus_two_log_normal(const Eigen::VectorXd& residual, const Eigen::MatrixXd& covariance) {
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  const Eigen::VectorXd whitened = factor.matrixL().solve(residual);
  return whitened.squaredNorm() + 2 * factor.matrixLLT().diagonal().array().log().sum() +
         static_cast<double>(residual.size()) * std::log(2 * std::numbers::pi);
}

TEST(StepError, IsTheDenseCovarianceWithAndWithoutMissingValuesAndBias) {
  const auto functions = std::make_shared<test::CurvedFunctions>();
  const auto model = test::random_model(functions, 7, 4, 2, 3);
  const Eigen::VectorXd centre = Eigen::Vector2d(1, 1), p = Eigen::Vector2d(0.8, 1.3);
  const Eigen::MatrixXd factor = Eigen::MatrixXd::Random(7, 2);
  const Eigen::VectorXd std = Eigen::VectorXd::LinSpaced(7, 0.3, 0.9);
  for (const NoiseModel& plain : {NoiseModel::independent(std), NoiseModel::correlated(chain(7))}) {
    const Eigen::MatrixXd r = Eigen::LLT<Eigen::MatrixXd>(Eigen::MatrixXd(plain.measurement().precision()))
                                  .solve(Eigen::MatrixXd::Identity(7, 7));
    DatumProjector projector(model, plain.with_step_error(1, factor), centre);
    model::FunctionBatch w;
    w.resize(1, 2, 3, 0);
    functions->evaluate(p.transpose(), 0, w);
    const Eigen::VectorXd v = w.value.row(0).transpose() - projector.central_functions();
    for (const bool missing : {false, true}) {
      for (const bool biased : {false, true}) {
        Eigen::VectorXd values = Eigen::VectorXd::Random(7);
        std::vector<Eigen::Index> kept = {0, 1, 2, 3, 4, 5, 6};
        if (missing) values[2] = k_nan, kept = {0, 1, 3, 4, 5, 6};
        BiasCorrection bias{Eigen::VectorXd::Constant(7, 0.2), Eigen::VectorXd::LinSpaced(7, 1, 2),
                            Eigen::MatrixXd::Random(7, 1)};
        StepForm form;
        if (biased) {
          projector.project(1, 1, values, bias, form);
        } else {
          projector.project(1, 1, values, form);
        }
        Eigen::VectorXd residual = values - model->predict(p, 1);
        Eigen::MatrixXd covariance = r + factor * factor.transpose();
        if (biased) {
          residual -= bias.mean;
          covariance = bias.scale.asDiagonal() * r * bias.scale.asDiagonal();
          covariance += factor * factor.transpose() + bias.factor * bias.factor.transpose();
        }
        const double exact = minus_two_log_normal(residual(kept), covariance(kept, kept));
        const double form_value =
            v.dot(form.quadratic * v) - 2 * form.linear.dot(v) + form.constant + form.log_normaliser;
        EXPECT_NEAR(form_value, exact, 1e-9 * std::abs(exact)) << missing << biased;
      }
    }
  }
}

TEST(StepError, OfTheClockIsTheSecondMomentOfTheRate) {
  // ∂y/∂t = a + B p with p ~ N((0.5, −1), diag(0.2², 0.1²)): E[y'y'ᵀ] = ȳ'ȳ'ᵀ + B diag Bᵀ.
  const auto rates = test::random_model(std::make_shared<test::LinearFunctions>(2), 5, 3, 1, 7);
  const posterior::PriorTransform transform(
      {posterior::Prior::normal(0.5, 0.2), posterior::Prior::normal(-1, 0.1)});
  const std::vector<double> std = {0.7};
  const NoiseModel noise =
      with_clock_error(NoiseModel::independent(Eigen::VectorXd::Ones(5)), *rates, transform, std);
  const Eigen::MatrixXd& factor = *noise.step_error(0);
  const Eigen::MatrixXd b = rates->space * rates->core[0];
  const Eigen::VectorXd mean = rates->lift.col(0) + b * Eigen::Vector2d(0.5, -1);
  const Eigen::MatrixXd exact =
      0.49 * (mean * mean.transpose() + b * Eigen::Vector2d(0.04, 0.01).asDiagonal() * b.transpose());
  EXPECT_LT((factor * factor.transpose() - exact).norm(), 0.01 * exact.norm());
}

TEST(NoiseModel, ScalarsComeBehindAndHaveNoPartInOffsets) {
  const NoiseModel plain = NoiseModel::correlated(chain(3));
  const NoiseModel both = plain.with_scalars(Eigen::Vector2d(2, 5));
  EXPECT_EQ(both.size(), 5);
  EXPECT_NEAR(both.measurement().log_determinant(), plain.measurement().log_determinant() + 2 * std::log(10),
              1e-12);
  EXPECT_EQ(both.measurement().precision().coeff(4, 4), 1.0 / 25);
  EXPECT_EQ(both.measurement().precision().coeff(0, 1), -1);
  // With offsets of the displacements only: dense covariance of two steps, [R + τ²D τ²D; τ²D R + τ²D].
  const auto model = test::random_model(std::make_shared<test::LinearFunctions>(2), 3, 2, 2, 1);
  const Eigen::Vector3d std(0.5, 0.7, 1.1);
  const NoiseModel offsets = NoiseModel::independent(std.head(2)).with_offsets(0.8).with_scalars(std.tail(1));
  DatumProjector projector(model, offsets, Eigen::Vector2d::Zero());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(6, 6);
  covariance.diagonal() << std.array().square(), std.array().square();
  for (const int a : {0, 3}) {
    for (const int b : {0, 3}) {
      for (int i = 0; i < 2; ++i) covariance(a + i, b + i) += 0.64;
    }
  }
  const Eigen::VectorXd p = Eigen::Vector2d(0.3, -0.4);
  Eigen::VectorXd residual(6);
  double sum = 0;
  for (std::size_t t = 0; t < 2; ++t) {
    const Eigen::VectorXd values = Eigen::VectorXd::Random(3);
    residual.segment(3 * static_cast<Eigen::Index>(t), 3) = values - model->predict(p, t);
    StepForm form;
    projector.project(t, t, values, form);
    sum += p.dot(form.quadratic * p) - 2 * form.linear.dot(p) + form.constant + form.log_normaliser;
  }
  EXPECT_NEAR(sum, minus_two_log_normal(residual, covariance), 1e-9);
}

}  // namespace
}  // namespace knothe::likelihood
