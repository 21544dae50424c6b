#include "knothe/assimilation/update/robust_update.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "knothe/assimilation/testing/dense_quadrature.hpp"
#include "knothe/assimilation/update/posterior_solver.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/testing/long_form.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/likelihood/testing/test_models.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

using likelihood::test::CurvedFunctions;
using likelihood::test::random_model;
using likelihood::test::synthetic_data;

constexpr Eigen::Index k_sensors = 40, k_steps = 8;
const double k_nan = std::nan("");

class Robust : public ::testing::Test {
 protected:
  std::shared_ptr<const model::ObservedModel> model_ = likelihood::test::random_model(
      std::make_shared<likelihood::test::CurvedFunctions>(), k_sensors, 4, k_steps, 33);
  Eigen::VectorXd std_ = Eigen::VectorXd::Constant(k_sensors, 0.6);
  Eigen::Vector2d truth_{1.0, 1.1};
  Eigen::MatrixXd clean_ = likelihood::test::synthetic_data(*model_, truth_, std_, 4);
  std::vector<posterior::Prior> priors_ = {posterior::Prior::normal(0.9, 0.45),
                                           posterior::Prior::normal(1.1, 0.45)};

  /// 5 % of the values are 20 σ off, on either side.
  [[nodiscard]] Eigen::MatrixXd contaminated() const {
    Eigen::MatrixXd data = clean_;
    for (Eigen::Index t = 0; t < k_steps; ++t) {
      for (const Eigen::Index i : {(7 * t + 3) % k_sensors, (11 * t + 8) % k_sensors})
        data(i, t) += (i % 2 == 0 ? 20 : -20) * std_[i];
    }
    return data;
  }

  [[nodiscard]] RobustUpdate make(likelihood::RobustOptions options) const {
    return RobustUpdate(model_, likelihood::NoiseModel::independent(std_), priors_, {}, options);
  }

  static const UpdateResult& run(RobustUpdate& update, const Eigen::MatrixXd& data) {
    for (std::size_t t = 0; t < k_steps; ++t) update.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    return update.result();
  }
};

TEST_F(Robust, OutliersMoveAStudentPosteriorByLessThanAQuarterOfItsStd) {
  // Against the same data without them: to lose 5 % of the values moves any posterior by 0.2 std or so.
  Eigen::MatrixXd without = contaminated();
  without = (without.array() == clean_.array()).select(without.array(), k_nan);
  RobustUpdate of_good = make({0, 4}), of_bad = make({0, 4}), gaussian = make({}), gated = make({4, 0});
  const UpdateResult &a = run(of_good, without), &b = run(of_bad, contaminated());
  const UpdateResult &c = run(gaussian, contaminated()), &d = run(gated, contaminated());
  double gaussian_shift = 0;
  for (Eigen::Index k = 0; k < 2; ++k) {
    const double s = std::sqrt(a.covariance(k, k));
    EXPECT_LT(std::abs(b.mean[k] - a.mean[k]), 0.25 * s);
    EXPECT_LT(std::abs(d.mean[k] - a.mean[k]), 0.5 * s);
    gaussian_shift = std::max(gaussian_shift, std::abs(c.mean[k] - a.mean[k]) / s);
  }
  EXPECT_GT(gaussian_shift, 1);  // that is what it is for
  EXPECT_EQ(d.rejected, 2);
  EXPECT_EQ(d.used, k_sensors - 2);
  EXPECT_EQ(d.missing, 0);
  for (const Eigen::Index i : gated.sensors().rejected) {
    EXPECT_GT(gated.sensors().test_ratio[i], 10);
    EXPECT_LT(of_bad.sensors().weight[i], 0.05);
  }
}

/// The exact posterior with Student-t noise of all data given, all values at every point,
/// constants included.
class StudentDensity final : public posterior::LogDensity {
 public:
  StudentDensity(const model::ObservedModel& model, Eigen::MatrixXd data, const Eigen::VectorXd& std,
                 const std::vector<posterior::Prior>& priors, double nu, Eigen::VectorXd powers = {})
      : model_(model),
        data_(std::move(data)),
        std_(std),
        transform_(priors),
        nu_(nu),
        powers_(powers.size() > 0 ? std::move(powers) : Eigen::VectorXd::Ones(data_.cols())) {}
  [[nodiscard]] Eigen::Index dimension() const override { return transform_.dimension(); }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int, posterior::LogDensityBatch& out) override {
    const double of_one =
        std::lgamma((nu_ + 1) / 2) - std::lgamma(nu_ / 2) - 0.5 * std::log(nu_ * std::numbers::pi);
    Eigen::MatrixXd p(z.rows(), z.cols()), none;
    transform_.evaluate(z, 0, p, none, none);
    model::FunctionBatch w;
    w.resize(z.rows(), z.cols(), model_.functions->count(), 0);
    model_.functions->evaluate(p, 0, w);
    out.value.setZero();
    for (Eigen::Index t = 0; t < data_.cols(); ++t) {
      const Eigen::MatrixXd y =
          w.value * (model_.space * model_.core[static_cast<std::size_t>(t)]).transpose();
      for (Eigen::Index i = 0; i < data_.rows(); ++i) {
        if (std::isnan(data_(i, t))) continue;
        const Eigen::ArrayXd e = (data_(i, t) - model_.lift(i, t) - y.col(i).array()) / std_[i];
        out.value.array() +=
            powers_[t] * (of_one - std::log(std_[i]) - 0.5 * (nu_ + 1) * (1 + e.square() / nu_).log());
      }
    }
    likelihood::add_standard_normal(z, 0, out);
  }
  [[nodiscard]] double parameter(Eigen::Index k, double z) const {
    return transform_.prior(k).from_standard_normal(z).value;
  }

 private:
  const model::ObservedModel& model_;
  Eigen::MatrixXd data_;
  Eigen::VectorXd std_;
  posterior::PriorTransform transform_;
  double nu_;
  Eigen::VectorXd powers_;  ///< to which each datum's likelihood counts
};

/// By how much an answer may be off: in standard deviations, relative, and of the log-evidence.
struct Tolerance {
  double mean = 0.02, std = 0.02, quantile = 0.1, evidence = 0.01;
};

/// Moments, quantiles and evidence at every step against dense quadrature. `forgetting`: the power to which
/// the data before are raised at each step.
void expect_exact_student(RobustUpdate& update, const model::ObservedModel& model,
                          const Eigen::MatrixXd& data, const Eigen::VectorXd& std,
                          const std::vector<posterior::Prior>& priors, double nu, Eigen::Index nodes,
                          const Tolerance& tolerance = {}, double forgetting = 1) {
  double before = 0, total = 0;
  Eigen::VectorXd powers;
  for (std::size_t t = 0; t < static_cast<std::size_t>(data.cols()); ++t) {
    SCOPED_TRACE(t);
    const UpdateResult& r = update.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    const auto seen = static_cast<Eigen::Index>(t) + 1;
    powers = (forgetting * powers).eval();
    if (forgetting < 1 && t > 0) {
      StudentDensity widened(model, data.leftCols(seen - 1), std, priors, nu, powers);
      before = test::DenseQuadrature(
                   widened, [&](Eigen::Index k, double z) { return widened.parameter(k, z); }, nodes)
                   .log_evidence;
    }
    powers.conservativeResize(seen);
    powers[seen - 1] = 1;
    StudentDensity exact(model, data.leftCols(seen), std, priors, nu, powers);
    const test::DenseQuadrature grid(
        exact, [&](Eigen::Index k, double z) { return exact.parameter(k, z); }, nodes);
    for (Eigen::Index k = 0; k < exact.dimension(); ++k) {
      const double s = std::sqrt(grid.covariance(k, k)), middle = grid.quantile(k, 0.5);
      // The rule is exact to rounding at three nodes per standard deviation.
      ASSERT_LT(exact.parameter(k, middle + grid.spacing(k)) - exact.parameter(k, middle), s / 3);
      EXPECT_LT(std::abs(r.mean[k] - grid.mean[k]), tolerance.mean * s);
      EXPECT_NEAR(std::sqrt(r.covariance(k, k)) / s, 1, tolerance.std);
      for (Eigen::Index j = 0; j < r.quantiles.cols(); ++j) {
        const double z = grid.quantile(k, numerics::k_quantile_levels[static_cast<std::size_t>(j)]);
        EXPECT_LT(std::abs(r.quantiles(k, j) - exact.parameter(k, z)), tolerance.quantile * s) << j;
      }
    }
    total += grid.log_evidence - before;
    EXPECT_NEAR(r.log_evidence, total, tolerance.evidence * (forgetting < 1 ? 1.0 + t : 1.0));
    EXPECT_NEAR(r.log_evidence_increment, grid.log_evidence - before, 2 * tolerance.evidence);
    EXPECT_LE(r.log_evidence_lower_bound, r.log_evidence + 1e-9);
    EXPECT_TRUE(r.trusted) << r.remark;
    before = grid.log_evidence;
  }
}

TEST_F(Robust, AStudentPosteriorIsTheExactOneAtEveryStep) {
  std::vector<posterior::Prior> priors;
  for (const posterior::Prior& prior : priors_) priors.push_back(prior.truncated(0.5, 1.5, "p"));
  for (unsigned seed = 4; seed <= knothe::test::by_form(4U, 7U); ++seed) {
    clean_ = likelihood::test::synthetic_data(*model_, truth_, std_, seed);
    for (const bool outliers : {false, true}) {
      SCOPED_TRACE(seed);
      RobustUpdate update = make({0, 4});
      expect_exact_student(update, *model_, outliers ? contaminated() : clean_, std_, priors, 4, 251);
    }
  }
}

TEST_F(Robust, AStudentPosteriorOfDataThatGrowOldIsTheExactOne) {
  std::vector<posterior::Prior> priors;
  for (const posterior::Prior& prior : priors_) priors.push_back(prior.truncated(0.5, 1.5, "p"));
  UpdateOptions options;
  options.forgetting = 0.7;
  RobustUpdate update(model_, likelihood::NoiseModel::independent(std_), priors_, options, {0, 4});
  expect_exact_student(update, *model_, contaminated(), std_, priors, 4, 251, {}, 0.7);
}

TEST_F(Robust, AfterAKnownChangeAStudentPosteriorIsThatOfTheLaterData) {
  UpdateOptions options;
  options.change_points = {5};
  RobustUpdate both(model_, likelihood::NoiseModel::independent(std_), priors_, options, {0, 4});
  RobustUpdate early = make({0, 4}), late = make({0, 4});
  for (std::size_t t = 0; t < k_steps; ++t) {
    const auto values = contaminated().col(static_cast<Eigen::Index>(t)).eval();
    both.update(t, t, values);
    (t < 5 ? early : late).update(t, t, values);
  }
  EXPECT_EQ(both.result().mean, late.result().mean);
  EXPECT_EQ(both.result().covariance, late.result().covariance);
  EXPECT_NEAR(both.result().log_evidence, early.result().log_evidence + late.result().log_evidence, 1e-9);
}

TEST_F(Robust, AnAlarmOfStudentValuesIsTakenForAChange) {
  const auto model = random_model(std::make_shared<CurvedFunctions>(), k_sensors, 4, 24, 33);
  const Eigen::Vector2d after(1.3, 0.8);
  Eigen::MatrixXd data = synthetic_data(*model, truth_, std_, 4);
  data.rightCols(12) = synthetic_data(*model, after, std_, 5).rightCols(12);
  UpdateOptions options;
  options.restart_on_alarm = true;
  const likelihood::NoiseModel noise = likelihood::NoiseModel::independent(std_);
  RobustUpdate found(model, noise, priors_, options, {0, 4});
  std::string words;
  for (std::size_t t = 0; t < 24; ++t)
    words += found.update(t, t, data.col(static_cast<Eigen::Index>(t))).notice;
  ASSERT_FALSE(found.changes().found().empty());
  EXPECT_NE(words.find("treated as a change of the structure at step"), std::string::npos) << words;
  // As if that had been known.
  UpdateOptions known;
  known.change_points = found.changes().found();
  RobustUpdate told(model, noise, priors_, known, {0, 4});
  for (std::size_t t = 0; t < 24; ++t) told.update(t, t, data.col(static_cast<Eigen::Index>(t)));
  EXPECT_EQ(found.result().mean, told.result().mean);
  EXPECT_EQ(found.result().log_evidence, told.result().log_evidence);
  EXPECT_NEAR(static_cast<double>(found.changes().found().back()), 12, 1);
}

TEST_F(Robust, WithFewValuesAStudentPosteriorIsByQuadrature) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), 5,
                                                    4, k_steps, 34);
  const Eigen::VectorXd std = std_.head(5);
  std::vector<posterior::Prior> priors;
  for (const posterior::Prior& prior : priors_) priors.push_back(prior.truncated(0.5, 1.5, "p"));
  for (const unsigned seed : {1U, 2U}) {
    SCOPED_TRACE(seed);
    Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, truth_, std, seed);
    data(1, 0) += 8 * std[1], data(3, 2) -= 5 * std[3], data(2, 4) = k_nan;
    RobustUpdate update(model, likelihood::NoiseModel::independent(std), priors_, {}, {0, 2});
    expect_exact_student(update, *model, data, std, priors, 2, 501);
  }
}

TEST_F(Robust, WithThreeParametersAndFewValuesAStudentPosteriorIsByWeightedDraws) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(3), 5, 4, 3, 35);
  const Eigen::VectorXd std = 2 * std_.head(5);
  const std::vector<posterior::Prior> priors(3, posterior::Prior::normal(0, 1));
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector3d(0.5, -0.5, 1), std, 3);
  data(1, 0) += 6 * std[1], data(2, 0) -= 4 * std[2], data(3, 2) -= 5 * std[3], data(2, 1) = k_nan;
  RobustUpdate update(model, likelihood::NoiseModel::independent(std), priors, {}, {0, 1});
  RobustUpdate first(model, likelihood::NoiseModel::independent(std), priors, {}, {0, 1});
  expect_exact_student(update, *model, data, std, priors, 1, 141, {0.05, 0.04, 0.15, 0.06});
  const UpdateResult& r = first.update(0, 0, data.col(0));
  EXPECT_EQ(r.method, posterior::Method::sequential_monte_carlo);
  EXPECT_NE(r.remark.find("moments, quantiles and evidence are by weighted draws"), std::string::npos)
      << r.remark;
}

TEST_F(Robust, TheMostProbablePointOfAStudentPosteriorIsItsMaximum) {
  const Eigen::MatrixXd data = contaminated();
  RobustUpdate update = make({0, 4});
  const UpdateResult& r = run(update, data);
  StudentDensity exact(*model_, data, std_,
                       std::vector<posterior::Prior>(2, posterior::Prior::uniform(0.5, 1.5)), 4);
  const auto density = [&](const Eigen::Vector2d& p) {  // of p: the likelihood times the normal priors
    Eigen::RowVector2d z;
    for (Eigen::Index k = 0; k < 2; ++k) z[k] = numerics::normal_quantile(p[k] - 0.5);
    posterior::LogDensityBatch batch;
    batch.resize(1, 2, 0);
    exact.evaluate(z, 0, batch);
    double value = batch.value[0] + 0.5 * z.squaredNorm();
    for (std::size_t k = 0; k < 2; ++k) value += priors_[k].log_density(p[static_cast<Eigen::Index>(k)]);
    return value;
  };
  const double highest = density(r.maximum_a_posteriori);
  for (Eigen::Index k = 0; k < 2; ++k) {
    for (const double side : {-0.02, 0.02}) {
      Eigen::Vector2d p = r.maximum_a_posteriori;
      p[k] += side * std::sqrt(r.covariance(k, k));
      EXPECT_LT(density(p), highest);
    }
  }
}

TEST_F(Robust, StuckAndAbsentSensorsAreFound) {
  Eigen::MatrixXd data = clean_;
  data.row(5).setConstant(data(5, 0));
  data.row(9).tail(6).setConstant(k_nan);
  RobustUpdate update = make({6, 0});
  run(update, data);
  EXPECT_EQ(update.sensors().absent, std::vector<Eigen::Index>{9});
  EXPECT_EQ(update.sensors().stuck, std::vector<Eigen::Index>{5});
  EXPECT_EQ(update.result().missing, 1);
  EXPECT_EQ(update.result().used + update.result().rejected, k_sensors - 1);
  EXPECT_TRUE(std::isnan(update.sensors().test_ratio[9]));
}

TEST_F(Robust, AWrongModelIsNotAllItsSensorsFault) {
  RobustUpdate update = make({4, 0});
  run(update, clean_);
  RobustUpdate other = make({4, 0});
  Eigen::MatrixXd data = clean_;
  data.col(k_steps - 1).array() += 30;
  EXPECT_EQ(run(other, data).rejected, 0);
}

TEST_F(Robust, WithoutOutliersGatingChangesNothing) {
  RobustUpdate gated = make({8, 0});
  SequentialUpdate plain(model_, likelihood::NoiseModel::independent(std_), priors_);
  for (std::size_t t = 0; t < k_steps; ++t) plain.update(t, t, clean_.col(static_cast<Eigen::Index>(t)));
  EXPECT_EQ(run(gated, clean_).mean, plain.result().mean);
}

TEST_F(Robust, AGateAllowsForTheErrorOfTheClock) {
  // One sensor in three is off by 10 σ together at the last step: with a clock that explains it, none goes.
  Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(k_sensors, 1);
  for (Eigen::Index i = 0; i < k_sensors; i += 3) factor(i, 0) = 10 * std_[i];
  Eigen::MatrixXd data = clean_;
  data.col(k_steps - 1) += factor;
  const likelihood::NoiseModel plain = likelihood::NoiseModel::independent(std_);
  RobustUpdate without(model_, plain, priors_, {}, {6, 0});
  EXPECT_GT(run(without, data).rejected, 10);
  RobustUpdate with(model_, plain.with_step_error(k_steps - 1, factor), priors_, {}, {6, 0});
  EXPECT_EQ(run(with, data).rejected, 0);
  const likelihood::NoiseModel clock = plain.with_step_error(1, factor);
  EXPECT_THROW(RobustUpdate(model_, clock, priors_, {}, {0, 4}), UsageError);
}

TEST_F(Robust, AGateGoesWithDataThatGrowOld) {
  UpdateOptions options;
  options.forgetting = 0.8;
  options.change_points = {5};
  options.change_retention = 0.3;
  // A gate that rejects nothing: to the bit what there is without it.
  RobustUpdate wide(model_, likelihood::NoiseModel::independent(std_), priors_, options, {50, 0});
  SequentialUpdate plain(model_, likelihood::NoiseModel::independent(std_), priors_, options);
  const UpdateResult& gated = run(wide, clean_);
  for (std::size_t t = 0; t < k_steps; ++t) plain.update(t, t, clean_.col(static_cast<Eigen::Index>(t)));
  EXPECT_EQ(gated.mean, plain.result().mean);
  EXPECT_EQ(gated.log_evidence, plain.result().log_evidence);
  // And one that takes the outliers out.
  RobustUpdate narrow(model_, likelihood::NoiseModel::independent(std_), priors_, options, {6, 0});
  const UpdateResult& cleaned = run(narrow, contaminated());
  EXPECT_GT(cleaned.rejected, 0);
  for (Eigen::Index k = 0; k < 2; ++k)
    EXPECT_NEAR(cleaned.mean[k], plain.result().mean[k], 0.5 * std::sqrt(plain.result().covariance(k, k)));
}

TEST_F(Robust, StudentNeedsIndependentNoise) {
  try {
    RobustUpdate(model_, likelihood::NoiseModel::independent(std_).with_offsets(0.1), priors_, {}, {0, 4});
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_TRUE(std::string(error.what()).starts_with("a Student-t likelihood is for sensors"))
        << error.what();
  }
}

/// The likelihood with the noise level integrated out numerically, over log s.
double by_quadrature(double misfit, double log_normaliser, double n, double a, double b) {
  double sum = 0;
  const double step = 0.002;
  for (double log_s = -12; log_s < 12; log_s += step) {
    const double s = std::exp(log_s);
    const double log_prior = a * std::log(b) - std::lgamma(a) - (a + 1) * log_s - b / s;
    sum += step * std::exp(-0.5 * (log_normaliser + n * log_s + misfit / s) + log_prior + log_s);
  }
  return std::log(sum);
}

TEST_F(Robust, AnUnknownNoiseLevelIsIntegratedOut) {
  const double a = 2.5, b = 1.2;
  const Eigen::Index n = 5;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 1, 3);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.5);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1, 1), 2 * std, 8);
  likelihood::DatumProjector projector(model, likelihood::NoiseModel::independent(std),
                                       Eigen::Vector2d(1, 1));
  likelihood::CollapsedLogDensity density(
      model->functions,
      std::make_shared<posterior::PriorTransform>(
          std::vector<posterior::Prior>(2, posterior::Prior::uniform(0.5, 1.5))),
      projector.central_functions());
  density.infer_noise_level({a, b});
  likelihood::StepForm form;
  projector.project(0, 0, data.col(0), form);
  density.set_form(form);
  posterior::LogDensityBatch batch;
  batch.resize(1, 2, 0);
  for (const Eigen::Vector2d& p : {Eigen::Vector2d(1, 1), Eigen::Vector2d(0.7, 1.3)}) {
    density.evaluate_likelihood(p.transpose(), 0, batch);
    const double misfit = ((data.col(0) - model->predict(p, 0)).array() / std.array()).square().sum();
    EXPECT_NEAR(batch.value[0], by_quadrature(misfit, form.log_normaliser, n, a, b), 1e-8);
    EXPECT_NEAR(density.noise_level()->expected(batch.value[0]), (b + misfit / 2) / (a + n / 2.0 - 1), 1e-10);
  }
  likelihood::test::expect_exact_derivatives(density, {{0.1, -0.4}, {-1.3, 0.9}});
}

TEST_F(Robust, TheNoiseLevelOfTheDataIsFound) {
  UpdateOptions options;
  options.noise_level = likelihood::NoiseLevel(2, 1);
  SequentialUpdate update(model_, likelihood::NoiseModel::independent(std_ / 3), priors_, options);
  for (std::size_t t = 0; t < k_steps; ++t) update.update(t, t, clean_.col(static_cast<Eigen::Index>(t)));
  // 320 values: the factor 9 of the variance to within 8 % (one std), three of them allowed.
  EXPECT_NEAR(update.result().noise_level.value(), 9, 9 * 0.24);
  SequentialUpdate known(model_, likelihood::NoiseModel::independent(std_), priors_);
  for (std::size_t t = 0; t < k_steps; ++t) known.update(t, t, clean_.col(static_cast<Eigen::Index>(t)));
  for (Eigen::Index k = 0; k < 2; ++k) {
    const double s = std::sqrt(known.result().covariance(k, k));
    EXPECT_NEAR(update.result().mean[k], known.result().mean[k], 0.2 * s);
    EXPECT_NEAR(std::sqrt(update.result().covariance(k, k)) / s, 1, 0.15);
  }
}

TEST_F(Robust, OffsetsAreIntegratedOut) {
  // Against the dense covariance σ² I + τ² 1 1ᵀ of each sensor's values.
  const double tau = 0.8;
  likelihood::DatumProjector projector(model_, likelihood::NoiseModel::independent(std_).with_offsets(tau),
                                       Eigen::Vector2d(1, 1));
  likelihood::CollapsedLogDensity density(
      model_->functions,
      std::make_shared<posterior::PriorTransform>(
          std::vector<posterior::Prior>(2, posterior::Prior::uniform(0.5, 1.5))),
      projector.central_functions());
  likelihood::StepForm sum = likelihood::StepForm::zero(3), form;
  for (std::size_t t = 0; t < k_steps; ++t) {
    projector.project(t, t, clean_.col(static_cast<Eigen::Index>(t)), form);
    sum.add(form);
  }
  density.set_form(sum);
  const Eigen::Vector2d p(0.8, 1.2);
  posterior::LogDensityBatch batch;
  batch.resize(1, 2, 0);
  density.evaluate_likelihood(p.transpose(), 0, batch);
  const Eigen::MatrixXd covariance = 0.36 * Eigen::MatrixXd::Identity(k_steps, k_steps) +
                                     tau * tau * Eigen::MatrixXd::Ones(k_steps, k_steps);
  double exact =
      -0.5 * k_sensors * (std::log(covariance.determinant()) + k_steps * std::log(2 * std::numbers::pi));
  Eigen::MatrixXd residual = clean_;
  for (std::size_t t = 0; t < k_steps; ++t)
    residual.col(static_cast<Eigen::Index>(t)) -= model_->predict(p, t);
  for (Eigen::Index i = 0; i < k_sensors; ++i)
    exact -= 0.5 * residual.row(i).dot(covariance.inverse() * residual.row(i).transpose());
  EXPECT_NEAR(batch.value[0], exact, 1e-9 * std::abs(exact));
}

TEST(MissingData, AnySplitOfMissingDataIsTheReducedProblem) {
  const Eigen::Index n = 12;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 3, 3);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.3);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.1, 0.8), std, 8);
  const std::vector<posterior::Prior> priors(2, posterior::Prior::uniform(0.5, 1.5));
  for (int split = 0; split < 6; ++split) {
    Eigen::MatrixXd gaps = data;
    for (Eigen::Index t = 0; t < 3; ++t) {
      for (Eigen::Index i = 0; i < n; ++i) {
        if ((i * (split + 2) + t * 5 + split) % 7 < 1 + split % 4) gaps(i, t) = k_nan;
      }
    }
    SequentialUpdate with_gaps(model, likelihood::NoiseModel::independent(std), priors);
    // The reduced problem: at every step a model of the values that are there, forms added up.
    const auto transform = likelihood::truncated_to_box(*model, priors);
    const Eigen::VectorXd central =
        likelihood::DatumProjector(model, likelihood::NoiseModel::independent(std),
                                   likelihood::medians(*transform))
            .central_functions();
    likelihood::FormSums reduced = likelihood::FormSums::zero(central.size());
    for (std::size_t t = 0; t < 3; ++t) {
      const Eigen::VectorXd column = gaps.col(static_cast<Eigen::Index>(t));
      with_gaps.update(t, t, column);
      std::vector<Eigen::Index> kept;
      for (Eigen::Index i = 0; i < n; ++i) {
        if (!std::isnan(column[i])) kept.push_back(i);
      }
      auto part = std::make_shared<model::ObservedModel>(*model);
      part->space = model->space(kept, Eigen::all);
      part->lift = model->lift(kept, Eigen::all);
      likelihood::DatumProjector projector(part, likelihood::NoiseModel::independent(std(kept)),
                                           likelihood::medians(*transform));
      likelihood::StepForm form;
      projector.project(t, t, column(kept), form);
      reduced.form.add(form);
    }
    PosteriorSolver solver(*model, transform, central, {});
    posterior::Posterior expected;
    UpdateTimes times;
    solver.set(reduced, {});
    solver.solve(reduced.form, expected, times);
    EXPECT_LT((with_gaps.result().mean - expected.mean).cwiseAbs().maxCoeff(), 1e-12) << split;
    EXPECT_LT((with_gaps.result().covariance - expected.covariance).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_NEAR(with_gaps.result().log_evidence, expected.log_evidence, 1e-10);
  }
}

}  // namespace
}  // namespace knothe::assimilation
