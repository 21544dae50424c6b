#include "knothe/assimilation/update/sequential_update.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "knothe/assimilation/testing/dense_quadrature.hpp"
#include "knothe/assimilation/testing/test_priors.hpp"
#include "knothe/base/error.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using numerics::k_quantile_levels;

using likelihood::test::CurvedFunctions;
using likelihood::test::LinearFunctions;
using likelihood::test::random_model;
using likelihood::test::synthetic_data;
using test::papers_priors;

/// Mean, covariance and log-evidence of the Kalman filter for y_t = lift_t + (OU) C_t p + e.
struct Kalman {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  double log_evidence = 0;

  void update(const Eigen::MatrixXd& h, const Eigen::VectorXd& y, const Eigen::MatrixXd& r) {
    const Eigen::MatrixXd s = h * covariance * h.transpose() + r;
    const Eigen::VectorXd innovation = y - h * mean;
    const Eigen::LLT<Eigen::MatrixXd> factor(s);
    log_evidence -= 0.5 * (innovation.dot(factor.solve(innovation)) +
                           static_cast<double>(y.size()) * std::log(2 * M_PI)) +
                    Eigen::MatrixXd(factor.matrixL()).diagonal().array().log().sum();
    const Eigen::MatrixXd gain =
        covariance * h.transpose() * factor.solve(Eigen::MatrixXd::Identity(y.size(), y.size()));
    mean += gain * innovation;
    covariance = (Eigen::MatrixXd::Identity(mean.size(), mean.size()) - gain * h) * covariance;
  }
};

/// To `tolerance` in mean and covariance.
void expect_kalman_filter(posterior::Method kind, int map_order, double tolerance) {
  const Eigen::Index d = 3, n = 7;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d), n, 4, 6, 11);
  const Eigen::VectorXd std = Eigen::VectorXd::LinSpaced(n, 0.2, 0.5);
  const Eigen::MatrixXd data =
      likelihood::test::synthetic_data(*model, Eigen::Vector3d(0.3, -1.0, 2.0), std, 5);
  const std::vector<posterior::Prior> priors = {
      posterior::Prior::normal(0, 1), posterior::Prior::normal(-0.5, 2), posterior::Prior::normal(1, 0.7)};
  UpdateOptions options;
  options.kind = kind;
  SequentialUpdate update(model, likelihood::NoiseModel::independent(std), priors, options);
  Kalman kalman{Eigen::Vector3d(0, -0.5, 1), Eigen::Vector3d(1, 4, 0.49).asDiagonal(), 0};
  for (std::size_t t = 0; t < model->time.size(); ++t) {
    const auto i = static_cast<Eigen::Index>(t);
    const UpdateResult& r = update.update(t, t, data.col(i));
    kalman.update(model->space * model->core[t], data.col(i) - model->lift.col(i),
                  std.cwiseAbs2().asDiagonal().toDenseMatrix());
    EXPECT_EQ(r.map_order, map_order);
    EXPECT_EQ(r.method, map_order > 0 ? posterior::Method::transport : posterior::Method::grid);
    EXPECT_TRUE(r.trusted) << r.remark;
    EXPECT_LT((r.mean - kalman.mean).cwiseAbs().maxCoeff(), tolerance);
    EXPECT_LT((r.covariance - kalman.covariance).cwiseAbs().maxCoeff(), tolerance);
    EXPECT_NEAR(r.log_evidence, kalman.log_evidence, tolerance * (std::abs(kalman.log_evidence) + 10));
    EXPECT_LT((r.maximum_a_posteriori - kalman.mean).cwiseAbs().maxCoeff(), 1e-9);
    for (Eigen::Index k = 0; k < d; ++k) {
      const double s = std::sqrt(kalman.covariance(k, k));
      EXPECT_NEAR((r.quantiles(k, 4) - kalman.mean[k]) / s, 1.959963984540054, 0.1);
      EXPECT_NEAR((r.quantiles(k, 2) - kalman.mean[k]) / s, 0, 0.05);
    }
  }
}

TEST(SequentialUpdate, LinearGaussianIsTheKalmanFilter) {
  expect_kalman_filter(posterior::Method::transport, 1, 1e-10);
}

TEST(SequentialUpdate, LinearGaussianByQuadratureIsTheKalmanFilter) {
  expect_kalman_filter(posterior::Method::automatic, 0, 1e-7);
}

TEST(SequentialUpdate, MissingValuesAreAsIfNeverMeasured) {
  const Eigen::Index n = 9;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 3, 3);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.05);
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.1, 0.8), std, 8);
  const std::vector<Eigen::Index> kept = {0, 2, 3, 7, 8};
  auto reduced = std::make_shared<model::ObservedModel>(*model);
  reduced->space = model->space(kept, Eigen::all);
  reduced->lift = model->lift(kept, Eigen::all);
  for (Eigen::Index j : {1, 4, 5, 6}) data.row(j).setConstant(std::nan(""));
  SequentialUpdate with_gaps(model, likelihood::NoiseModel::independent(std), papers_priors());
  SequentialUpdate small(reduced, likelihood::NoiseModel::independent(std(kept)), papers_priors());
  for (std::size_t t = 0; t < 3; ++t) {
    const auto i = static_cast<Eigen::Index>(t);
    const UpdateResult& a = with_gaps.update(t, t, data.col(i));
    const UpdateResult& b = small.update(t, t, Eigen::VectorXd(data(kept, i)));
    EXPECT_EQ(a.used, 5);
    EXPECT_EQ(a.missing, 4);
    EXPECT_LT((a.mean - b.mean).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_NEAR(a.log_evidence, b.log_evidence, 1e-9);
  }
}

/// With the evidence to `tolerance`.
void expect_the_prior_of_nothing(posterior::Method kind, double tolerance) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), 4, 3, 2, 3);
  UpdateOptions options;
  options.kind = kind;
  SequentialUpdate update(model, likelihood::NoiseModel::independent(Eigen::Vector4d::Constant(0.1)),
                          papers_priors(), options);
  const UpdateResult r = update.update(0, 0, Eigen::Vector4d::Constant(std::nan("")));
  EXPECT_EQ(r.used, 0);
  EXPECT_NEAR(r.log_evidence, 0, tolerance);
  // Mean of the truncated normal in closed form: μ + σ (φ(a) − φ(b))/(Φ(b) − Φ(a)).
  const auto phi = [](double x) { return std::exp(-0.5 * x * x) / std::sqrt(2 * M_PI); };
  const auto below = [](double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); };
  for (Eigen::Index k = 0; k < 2; ++k) {
    const double mu = k == 0 ? 0.9 : 1.1, s = std::sqrt(0.2), a = (0.5 - mu) / s, b = (1.5 - mu) / s;
    EXPECT_NEAR(r.mean[k], mu + s * (phi(a) - phi(b)) / (below(b) - below(a)), 1e-4);
  }
}

TEST(SequentialUpdate, ADatumWithNothingInItChangesNothing) {
  expect_the_prior_of_nothing(posterior::Method::transport, 1e-12);
  expect_the_prior_of_nothing(posterior::Method::automatic, 1e-10);
}

/// The posterior of a curved two-parameter model, hard against the box, compared with dense quadrature of the
/// likelihood written out term by term (no collapsed form).
class DirectLogDensity final : public posterior::LogDensity {
 public:
  DirectLogDensity(const model::ObservedModel& model, const Eigen::MatrixXd& data, const Eigen::VectorXd& std,
                   const std::vector<posterior::Prior>& priors, Eigen::Index steps)
      : model_(model), data_(data), std_(std), priors_(priors), steps_(steps) {}
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int, posterior::LogDensityBatch& out) override {
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      Eigen::Vector2d p;
      double value = -std::log(2 * M_PI) - 0.5 * z.row(i).squaredNorm();
      for (int k = 0; k < 2; ++k) p[k] = priors_[k].from_standard_normal(z(i, k)).value;
      for (Eigen::Index t = 0; t < steps_; ++t) {
        const Eigen::ArrayXd e =
            (data_.col(t) - model_.predict(p, static_cast<std::size_t>(t))).array() / std_.array();
        value -= 0.5 * e.square().sum() + std_.array().log().sum() +
                 0.5 * static_cast<double>(e.size()) * std::log(2 * M_PI);
      }
      out.value[i] = value;
    }
  }

 private:
  const model::ObservedModel& model_;
  const Eigen::MatrixXd& data_;
  const Eigen::VectorXd& std_;
  std::vector<posterior::Prior> priors_;
  Eigen::Index steps_;
};

void expect_agrees(const UpdateResult& r, const test::DenseQuadrature& exact,
                   const std::vector<posterior::Prior>& priors) {
  EXPECT_TRUE(exact.resolved);
  for (Eigen::Index k = 0; k < 2; ++k) {
    const double std = std::sqrt(exact.covariance(k, k));
    EXPECT_NEAR(r.mean[k], exact.mean[k], 0.02 * std) << "step " << r.step << " " << r.remark;
    EXPECT_NEAR(std::sqrt(r.covariance(k, k)), std, 0.02 * std) << "step " << r.step;
    for (int j : {0, 4}) {
      const double q = priors[k].from_standard_normal(exact.quantile(k, k_quantile_levels[j])).value;
      EXPECT_NEAR(r.quantiles(k, j), q, 0.1 * std) << "step " << r.step;
    }
  }
  const auto correlation = [](const Eigen::MatrixXd& c) { return c(0, 1) / std::sqrt(c(0, 0) * c(1, 1)); };
  EXPECT_NEAR(correlation(r.covariance), correlation(exact.covariance), 0.02);
  EXPECT_NEAR(r.log_evidence, exact.log_evidence, 0.02) << "step " << r.step;
}

TEST(SequentialUpdate, CurvedPosteriorAgreesWithDenseQuadratureAtEveryStep) {
  const Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 6, 21);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.4);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.45, 0.7), std, 17);
  SequentialUpdate update(model, likelihood::NoiseModel::independent(std), papers_priors());
  for (std::size_t t = 0; t < model->time.size(); ++t) {
    const UpdateResult& r = update.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    DirectLogDensity direct(*model, data, std, update.transform().priors(), static_cast<Eigen::Index>(t) + 1);
    const auto priors = update.transform().priors();
    const test::DenseQuadrature exact(
        direct, [&](Eigen::Index k, double z) { return priors[k].from_standard_normal(z).value; });
    expect_agrees(r, exact, priors);
  }
}

TEST(SequentialUpdate, ComposedMapsAgreeWithTheCollapsedPosterior) {
  const Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 12, 33);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.6);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, 4);
  UpdateOptions options;
  SequentialUpdate collapsed(model, likelihood::NoiseModel::independent(std), papers_priors(), options);
  options.form = UpdateOptions::Form::composed;
  SequentialUpdate composed(model, likelihood::NoiseModel::independent(std), papers_priors(), options);
  for (std::size_t t = 0; t < model->time.size(); ++t) {
    const auto column = data.col(static_cast<Eigen::Index>(t));
    const UpdateResult& a = collapsed.update(t, t, column);
    const UpdateResult& b = composed.update(t, t, column);
    for (Eigen::Index k = 0; k < 2; ++k) {
      EXPECT_NEAR(a.mean[k], b.mean[k], 0.1 * std::sqrt(a.covariance(k, k))) << "step " << t;
    }
    EXPECT_NEAR(a.log_evidence, b.log_evidence, 0.05) << "step " << t;
  }
}

bool identical(const UpdateResult& a, const UpdateResult& b) {
  return a.mean == b.mean && a.covariance == b.covariance && a.quantiles == b.quantiles &&
         a.maximum_a_posteriori == b.maximum_a_posteriori && a.log_evidence == b.log_evidence &&
         a.log_evidence_increment == b.log_evidence_increment && a.map_order == b.map_order &&
         a.variance_diagnostic == b.variance_diagnostic && a.step == b.step && a.used == b.used;
}

TEST(SequentialUpdate, AStepTakenOutLeavesNoTrace) {
  const Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 6, 33);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.6);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, 4);
  for (auto form : {UpdateOptions::Form::collapsed, UpdateOptions::Form::composed}) {
    UpdateOptions options;
    options.form = form;
    SequentialUpdate all(model, likelihood::NoiseModel::independent(std), papers_priors(), options);
    SequentialUpdate without(model, likelihood::NoiseModel::independent(std), papers_priors(), options);
    SequentialUpdate late(model, likelihood::NoiseModel::independent(std), papers_priors(), options);
    for (std::size_t t : {0u, 1u, 2u, 3u, 4u, 5u}) {
      all.update(t, t, data.col(static_cast<Eigen::Index>(t)));
      if (t != 2 && t != 4) without.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    }
    const UpdateResult complete = all.result();
    all.remove(2);
    EXPECT_TRUE(identical(all.remove(4), without.result()));
    EXPECT_EQ(all.result().points, without.result().points);
    EXPECT_EQ(all.result().weights, without.result().weights);
    // And put back, out of order: as if all had come in order.
    for (std::size_t t : {5u, 0u, 3u, 1u, 4u, 2u}) late.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    EXPECT_TRUE(identical(late.result(), complete));
    EXPECT_THROW(all.remove(2), UsageError);
    EXPECT_THROW(all.update(0, 0, data.col(0)), UsageError);
  }
}

TEST(SequentialUpdate, DataAddedInAnyOrderGiveThePosteriorOfEveryStep) {
  const Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 5, 33);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.6);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, 4);
  for (auto form : {UpdateOptions::Form::collapsed, UpdateOptions::Form::composed}) {
    UpdateOptions options;
    options.form = form;
    SequentialUpdate in_order(model, likelihood::NoiseModel::independent(std), papers_priors(), options);
    SequentialUpdate late(model, likelihood::NoiseModel::independent(std), papers_priors(), options);
    std::vector<UpdateResult> lines;
    std::vector<Eigen::MatrixXd> points;
    for (std::size_t t = 0; t < 5; ++t) {
      lines.push_back(in_order.update(t, t, data.col(static_cast<Eigen::Index>(t))));
      points.push_back(in_order.result().points);
    }
    const auto add = [&](std::size_t t) {
      late.add(likelihood::test::datum(t, data.col(static_cast<Eigen::Index>(t))), t);
    };
    for (std::size_t t : {3u, 0u, 4u, 2u}) add(t);
    late.posterior_without_monitor(4);
    add(1);
    for (std::size_t t : {4u, 1u, 0u, 2u, 3u, 4u}) {
      EXPECT_TRUE(identical(late.posterior_without_monitor(t), lines[t])) << t;
      EXPECT_EQ(late.result().log_evidence_increment, lines[t].log_evidence_increment) << t;
      EXPECT_EQ(late.result().points, points[t]) << t;
    }
    EXPECT_THROW(late.posterior_without_monitor(7), UsageError);
  }
}

TEST(SequentialUpdate, ADatumFarBackIsAsIfItHadComeInOrder) {
  const Eigen::Index n = 3;
  const std::size_t steps = 450, late = 100;  // further back than every step is remembered
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, steps, 33);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 6.0);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, 4);
  const auto update_without = [&](std::optional<std::size_t> left_out) {
    SequentialUpdate update(model, likelihood::NoiseModel::independent(std), papers_priors(), {});
    for (std::size_t t = 0; t < steps; ++t)
      if (t != left_out) update.add(likelihood::test::datum(t, data.col(static_cast<Eigen::Index>(t))), t);
    return update;
  };
  const auto results = [&](SequentialUpdate& update) {
    std::vector<UpdateResult> found;
    for (std::size_t t = late + 1; t < steps; ++t) found.push_back(update.posterior_at(t));
    return found;
  };
  const auto expect_same = [&](const std::vector<UpdateResult>& a, const std::vector<UpdateResult>& b) {
    for (std::size_t k = 0; k < a.size(); ++k) {
      EXPECT_TRUE(identical(a[k], b[k])) << k;
      EXPECT_EQ(a[k].points, b[k].points) << k;
      EXPECT_EQ(a[k].monitor.cumulative_sum, b[k].monitor.cumulative_sum) << k;
    }
  };
  SequentialUpdate all = update_without(std::nullopt), update = update_without(late);
  const auto with = results(all), without = results(update);
  update.add(likelihood::test::datum(late, data.col(late)), late);
  EXPECT_EQ(update.preview(steps - 1).mean, with.back().mean);
  expect_same(results(update), with);
  update.withdraw(late, {});
  EXPECT_EQ(update.preview(steps - 1).mean, without.back().mean);
  expect_same(results(update), without);
}

TEST(SequentialUpdate, AValueInTheWrongUnitIsRefusedByName) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), 4, 3, 2, 3);
  SequentialUpdate update(model, likelihood::NoiseModel::independent(Eigen::Vector4d::Constant(0.1)),
                          papers_priors());
  try {
    update.update(0, 0, Eigen::Vector4d(0.1, 0.2, -1e200, 0.3));
    FAIL();
  } catch (const DataError& error) {
    EXPECT_STREQ(
        error.what(),
        "the misfit of a datum overflows: the largest measured value is -1e+200 (observation 2); values and "
        "noise are in metres");
  }
}

TEST(SequentialUpdate, DerivativesOfTheTargetAgreeWithFiniteDifferences) {
  const Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 2, 33);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.6);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, 4);
  UpdateOptions options;
  SequentialUpdate update(model, likelihood::NoiseModel::independent(std), papers_priors(), options);
  update.update(0, 0, data.col(0));
  update.update(1, 1, data.col(1));
  likelihood::test::expect_exact_derivatives(update.target(), {{0.1, -0.4}, {-1.3, 0.9}, {2.0, 2.0}});
}

TEST(SequentialUpdate, TheComposedTargetHasExactDerivatives) {
  const Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 2, 33);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.6);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, 4);
  SequentialUpdate update(model, likelihood::NoiseModel::independent(std), papers_priors());
  update.update(0, 0, data.col(0));
  posterior::MapSolver solver;
  const posterior::MapResult first = solver.solve(update.target());
  const posterior::ComposedMap map = first.composed();
  likelihood::ComposedStepDensity density(likelihood::CollapsedLogDensity(
      model->functions, std::make_shared<posterior::PriorTransform>(update.transform().priors()),
      Eigen::VectorXd::Zero(model->functions->count())));
  likelihood::StepForm form = likelihood::StepForm::zero(model->functions->count());
  form.quadratic.setIdentity();
  form.linear.setLinSpaced(-1, 1);
  density.set(map, form);
  likelihood::test::expect_exact_derivatives(density, {{0.1, -0.4}, {-1.3, 0.9}, {1.5, 1.0}});
}

}  // namespace
}  // namespace knothe::assimilation
