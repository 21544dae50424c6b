#include "knothe/assimilation/verdict/verdict.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "knothe/assimilation/engine/engine.hpp"
#include "knothe/assimilation/testing/verdict_case.hpp"
#include "knothe/assimilation/verdict/edge_pressure.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::Bench;
using test::datum_of;
using test::k_case_sensors;
using test::k_case_times;

VerdictReason reason(VerdictPart part, VerdictLevel level) {
  return {part, level, 0, 0, "", {}};
}

TEST(RunVerdict, IsTheWorstOfTheLastTenth) {
  RunVerdict run;
  EXPECT_EQ(run.verdict().level, VerdictLevel::ok);
  const auto add = [&](int count, std::optional<VerdictReason> why) {
    for (int k = 0; k < count; ++k) {
      Verdict verdict;
      if (why) verdict.add(*why);
      run.add(verdict);
    }
  };
  add(30, reason(VerdictPart::fit, VerdictLevel::reject));  // long ago
  add(66, std::nullopt);
  EXPECT_EQ(run.verdict().level, VerdictLevel::ok);
  add(1, reason(VerdictPart::bias, VerdictLevel::caution));
  add(1, reason(VerdictPart::range, VerdictLevel::reject));
  add(2, reason(VerdictPart::bias, VerdictLevel::caution));
  const Verdict verdict = run.verdict();
  EXPECT_EQ(verdict.level, VerdictLevel::reject);
  ASSERT_EQ(verdict.reasons.size(), 2u);  // each part once
  EXPECT_EQ(verdict.reasons[0].part, VerdictPart::bias);
  EXPECT_EQ(verdict.reasons[1].part, VerdictPart::range);
  EXPECT_EQ(verdict_text(Verdict{}), "Result: usable (verdict: ok)");
  EXPECT_EQ(verdict_text(verdict).substr(0, 37), "Result: do not use (verdict: reject)\n");
}

TEST(RunVerdict, AfterARefinementOnlyRejectedValuesStand) {
  RunVerdict run;
  Verdict verdict;
  for (const auto part : {VerdictPart::model, VerdictPart::range, VerdictPart::fit})
    verdict.add(reason(part, VerdictLevel::reject));
  verdict.add(reason(VerdictPart::outlier, VerdictLevel::caution));
  run.add(verdict);
  run.forget_model();
  ASSERT_EQ(run.verdict().reasons.size(), 1u);
  EXPECT_EQ(run.verdict().reasons[0].part, VerdictPart::outlier);
  EXPECT_EQ(run.verdict().level, VerdictLevel::caution);
}

TEST(Verdict, OfRightDataIsOkAndItsProbabilityUniform) {
  int below_a_fifth = 0, not_ok = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    const Verdict verdict = Bench(seed).verdict();
    below_a_fifth += verdict.fit_probability < 0.2 ? 1 : 0;
    not_ok += verdict.level != VerdictLevel::ok ? 1 : 0;
  }
  EXPECT_NEAR(below_a_fifth, 40, 20);  // 3.5 standard deviations of a binomial count
  EXPECT_LE(not_ok, 2);
}

/// Of the whole verdict, not of one reason: what a test with nothing wrong is told by chance.
TEST(Verdict, OfTruthsFromThePriorIsOkWhateverTheDataSay) {
  int not_ok = 0, contradicted = 0;
  for (unsigned seed = 1; seed <= 150; ++seed) {
    Bench bench(seed);
    bench.priors = {posterior::Prior::normal(0.9, 0.1), posterior::Prior::normal(1.1, 0.15)};
    for (posterior::Prior& prior : bench.priors) prior = prior.truncated(0.5, 1.5, "p");
    bench.noise = likelihood::NoiseModel::independent(
        VectorXd::Constant(k_case_sensors, std::array{0.1, 1.0, 4.0, 12.0}[seed % 4]));
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    for (Index a = 0; a < 2; ++a)
      bench.truth[a] = bench.priors[static_cast<std::size_t>(a)].from_standard_normal(normal(random)).value;
    bench.data = likelihood::test::synthetic_data(
        *bench.model, bench.truth, bench.noise.measurement().standard_deviations(), 1000 + seed);
    const Verdict verdict = bench.verdict();
    not_ok += verdict.level != VerdictLevel::ok ? 1 : 0;
    contradicted += std::any_of(verdict.reasons.begin(), verdict.reasons.end(),
                                [](const VerdictReason& r) { return r.part == VerdictPart::prior; })
                        ? 1
                        : 0;
  }
  EXPECT_LE(not_ok, 3);  // 2 %
  EXPECT_LE(contradicted, 3);
}

/// The truth is six standard deviations of the prior of `a` away; b makes up for it. No residual shows it.
TEST(Verdict, SaysWhereThePriorContradictsTheData) {
  for (const double noise : {0.1, 1.0}) {
    Bench bench;
    bench.noise = likelihood::NoiseModel::independent(VectorXd::Constant(k_case_sensors, noise));
    bench.data = likelihood::test::synthetic_data(*bench.model, bench.truth,
                                                  bench.noise.measurement().standard_deviations(), 4);
    const auto count = [&] {
      std::vector<VerdictReason> found;
      for (const VerdictReason& reason : bench.verdict().reasons)
        if (reason.part == VerdictPart::prior) found.push_back(reason);
      return found;
    };
    bench.priors[0] = posterior::Prior::normal(bench.truth[0] + 0.01, 0.02).truncated(0.5, 1.5, "a");
    EXPECT_TRUE(count().empty());
    bench.priors[0] = posterior::Prior::normal(bench.truth[0] + 0.12, 0.02).truncated(0.5, 1.5, "a");
    const std::vector<VerdictReason> found = count();
    ASSERT_EQ(found.size(), 1u) << noise;
    EXPECT_NE(found[0].message.find("the prior of a, 1.02 ± 0.02, is "), std::string::npos);
    EXPECT_GT(found[0].value, found[0].limit);
  }
}

TEST(Verdict, SeesADatumThatIsRepeatedAndNoiseThatIsCorrelated) {
  Bench bench;
  bench.data.col(9) = bench.data.col(8);
  bench.times[9] = 8;
  const Verdict repeated = bench.verdict();
  ASSERT_FALSE(repeated.reasons.empty());
  EXPECT_NE(verdict_text(repeated).find("repeat"), std::string::npos) << verdict_text(repeated);
  // The same with other last digits, with a value missing in both, and not next to each other.
  Bench again;
  for (const Index apart : {1, 2}) {
    again.data = Bench().data;
    again.data(7, 8) = std::numeric_limits<double>::quiet_NaN();
    again.data.col(8 + apart) = (1 + 1e-13) * again.data.col(8);
    if (apart == 2)
      again.data.col(9) =
          again.model->predict(again.truth, 8) + again.data.col(3) - again.model->predict(again.truth, 3);
    for (Index k = 9; k <= 8 + apart; ++k) again.times[static_cast<std::size_t>(k)] = 8;
    EXPECT_NE(verdict_text(again.verdict()).find("repeats the values of a datum before it"),
              std::string::npos)
        << apart;
  }
  Bench slow;
  MatrixXd noise = slow.data;
  for (Index t = 0; t < k_case_times; ++t)
    noise.col(t) -= slow.model->predict(slow.truth, static_cast<std::size_t>(t));
  for (Index t = 1; t < k_case_times; ++t) {
    const VectorXd next = 0.8 * noise.col(t - 1) + 0.6 * noise.col(t);
    slow.data.col(t) += next - noise.col(t);
    noise.col(t) = next;
  }
  EXPECT_NE(slow.verdict().level, VerdictLevel::ok);
}

/// Noise that neighbours share, a datum with values missing and one that is missing altogether: the misfit is
/// that of the marginal of what is there.
TEST(ResidualTests, MissingValuesOfCorrelatedNoiseAreIntegratedOut) {
  const Bench bench;
  MatrixXd precision = MatrixXd::Zero(k_case_sensors, k_case_sensors);
  for (Index i = 0; i < k_case_sensors; ++i) {
    precision(i, i) = 120;
    if (i > 0) precision(i, i - 1) = precision(i - 1, i) = 40;
  }
  ResidualTests tests(bench.model, likelihood::NoiseModel::correlated(precision.sparseView()), bench.sensors);
  VectorXd some = bench.data.col(3), none = bench.data.col(4);
  some[5] = some[6] = some[20] = std::numeric_limits<double>::quiet_NaN();
  none.setConstant(std::numeric_limits<double>::quiet_NaN());
  const std::vector<likelihood::DatumPointer> data = {datum_of(3, 3, some), datum_of(4, 4, none)};
  const double a = bench.truth[0], b = bench.truth[1];
  const Eigen::Vector3d w(a * b, a * a * std::sin(b), 1 / (a + b * b));
  const ResidualReport report = tests.examine(data, w, 1, 2);
  std::vector<Index> kept;
  for (Index i = 0; i < k_case_sensors; ++i)
    if (!std::isnan(some[i])) kept.push_back(i);
  const VectorXd residual = (some - bench.model->predict(bench.truth, 3))(kept);
  const MatrixXd covariance = precision.inverse()(kept, kept);
  EXPECT_EQ(report.values, k_case_sensors - 3);
  EXPECT_NEAR(report.misfit, residual.dot(covariance.inverse() * residual), 1e-9 * report.misfit);
}

/// A field at 300 places of a line, moved and turned as a body: what is left without the motion, at the true
/// parameters, is as noise is, and a bend of it, no larger than the noise, is seen.
TEST(ResidualTests, WithoutTheMotionOfAFieldItsValuesAreTested) {
  constexpr Index n = 300;
  model::ObservedModel field = *Bench().model;
  field.space = MatrixXd::Zero(n, field.space.cols());
  field.lift = MatrixXd::Zero(n, field.lift.cols());
  MatrixXd motion(n, 2);
  model::Sensors sensors;
  VectorXd bend(n);
  for (Index i = 0; i < n; ++i) {
    const double x = 2.0 * double(i) / (n - 1) - 1;
    sensors.add(std::array{x, 0.0, 0.0}, 1);
    motion.row(i) << 50, 50 * x;
    bend[i] = 0.1 * (2 * x * x - 1);
  }
  const likelihood::NoiseModel noise =
      likelihood::NoiseModel::independent(VectorXd::Constant(n, 0.1)).with_step_error(0, motion);
  ResidualTests tests(std::make_shared<const model::ObservedModel>(field), noise, sensors);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  int rare = 0, bends = 0;
  for (int draw = 0; draw < 400; ++draw) {
    VectorXd values = motion * Eigen::Vector2d(normal(random), normal(random));
    for (double& value : values) value += 0.1 * normal(random);
    const auto examined = [&](const VectorXd& v) {
      const std::vector<likelihood::DatumPointer> data = {datum_of(0, 0, v)};
      return tests.examine(data, VectorXd::Zero(3), 1, 2);
    };
    const ResidualReport report = examined(values);
    for (const ResidualTest test : {ResidualTest::total, ResidualTest::value, ResidualTest::space_neighbours})
      rare += report.of(test) < 0.01;
    EXPECT_GT(report.of(report.worst(1e-6)), 1e-6);
    bends += examined(values + bend).of(ResidualTest::space_neighbours) < 0.01;
    values[17] += 1;
    EXPECT_LT(examined(values).of(ResidualTest::value), 1e-4);
  }
  EXPECT_LT(rare, 24);  // 12 expected, and all three but approximately
  EXPECT_GT(bends, 200);
}

TEST(Verdict, AFewValuesThatStandOutAreNoFaultOfTheModel) {
  Bench bench;
  bench.data(5, 10) += 1.0;
  bench.data(17, 20) -= 0.9;
  const std::string text = verdict_text(bench.verdict());
  EXPECT_NE(text.find("2 of 720 values stand out, by up to "), std::string::npos) << text;
  EXPECT_NE(text.find("and the others fit: find out what is wrong there"), std::string::npos) << text;
  bench.data.row(5).array() += 1.0;
  EXPECT_EQ(verdict_text(bench.verdict()).find("stand out"), std::string::npos);
}

TEST(Verdict, StudentTValuesAreCarriedToNormalOnes) {
  Bench bench;
  std::mt19937 random(5);
  std::student_t_distribution<double> student(4);
  for (Index t = 0; t < k_case_times; ++t) {
    bench.data.col(t) = bench.model->predict(bench.truth, static_cast<std::size_t>(t));
    for (double& value : bench.data.col(t)) value += 0.1 * student(random);
  }
  EXPECT_TRUE(bench.cause());
  likelihood::RobustOptions robust;
  robust.degrees_of_freedom = 4;
  for (const VerdictReason& reason : bench.verdict(robust).reasons) EXPECT_NE(reason.part, VerdictPart::fit);
}

/// Noise that is as stated and normal: a likelihood that also allows for outliers is no reason to doubt it.
TEST(Verdict, OfAStudentTLikelihoodIsOkWithNormalNoise) {
  int not_ok = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Bench bench(seed);
    EngineSetup setup;
    setup.model = bench.model;
    setup.noise = bench.noise;
    setup.priors = bench.priors;
    setup.sensors = bench.sensors;
    setup.robust.degrees_of_freedom = seed % 2 == 0 ? 4 : 8;
    Engine engine(setup);
    Verdict last;
    for (std::size_t t = 0; t < k_case_times; ++t)
      last = engine.assimilate({{}, t, t, bench.data.col(static_cast<Index>(t)), {}}).update.verdict;
    not_ok += last.level != VerdictLevel::ok ? 1 : 0;
  }
  EXPECT_EQ(not_ok, 0);
}

/// A force whose residuals are small each, but all of one sign: it asks for other parameters.
TEST(Verdict, SaysWhereAForceAndTheDisplacementsAskForDifferentParameters) {
  int named = 0, contradicted = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Bench bench(seed);
    bench.name_last_sensor("force");
    VectorXd std = VectorXd::Constant(k_case_sensors, 0.1);
    std[k_case_sensors - 1] = 0.01;
    bench.noise = likelihood::NoiseModel::independent(std);
    const auto with_force_of = [&](const Eigen::Vector2d& p) {
      bench.data = likelihood::test::synthetic_data(*bench.model, bench.truth, std, seed);
      for (Index t = 0; t < k_case_times; ++t)
        bench.data(k_case_sensors - 1, t) +=
            (bench.model->predict(p, static_cast<std::size_t>(t)) -
             bench.model->predict(bench.truth, static_cast<std::size_t>(t)))[k_case_sensors - 1];
      const Verdict verdict = bench.verdict();
      return verdict.misfit() == nullptr ? std::string() : verdict.misfit()->message;
    };
    contradicted += with_force_of(bench.truth).empty() ? 0 : 1;
    named +=
        with_force_of(bench.truth + Eigen::Vector2d(0.015, 0)).find("\"force\" and the other data ask for") ==
                0
            ? 1
            : 0;
  }
  EXPECT_EQ(contradicted, 0);
  EXPECT_GE(named, 10);
}

/// A linear model with normal priors, where the shift of the mean is Σ Aᵀ R⁻¹ e.
TEST(Verdict, ShiftByTheModelsErrorIsThatOfTheConjugateFormula) {
  const Index d = 3;
  auto made = std::make_shared<model::ObservedModel>(*likelihood::test::random_model(
      std::make_shared<likelihood::test::LinearFunctions>(d), k_case_sensors, 5, k_case_times, 7));
  made->parameters = {"a", "b", "c"};
  const std::vector<posterior::Prior> priors(3, posterior::Prior::normal(1, 2));
  const VectorXd std = VectorXd::Constant(k_case_sensors, 5.0);
  const likelihood::NoiseModel noise = likelihood::NoiseModel::independent(std);
  const MatrixXd data = likelihood::test::synthetic_data(*made, VectorXd::Ones(d), std, 2);
  model::ObservedErrors errors;
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  errors.space = MatrixXd::NullaryExpr(k_case_sensors, 2, [&] { return normal(random); });
  MatrixXd precision = MatrixXd::Identity(d, d) / 4, moved = MatrixXd::Zero(d, 8);
  SequentialUpdate update(made, noise, priors);
  std::vector<likelihood::DatumPointer> examined;
  for (Index t = 0; t < k_case_times; ++t) {
    const auto step = static_cast<std::size_t>(t);
    update.update(step, step, data.col(t));
    examined.push_back(datum_of(step, step, data.col(t)));
    errors.coefficients.emplace_back(MatrixXd::NullaryExpr(2, 8, [&] { return normal(random); }));
    const MatrixXd a = made->space * made->core[step];
    precision += a.transpose() * a / 25;
    moved += a.transpose() * (errors.space * errors.coefficients.back()) / 25;
  }
  const MatrixXd covariance = precision.inverse();
  const VectorXd expected = ((covariance * moved).rowwise().squaredNorm() / 8)
                                .cwiseSqrt()
                                .cwiseQuotient(covariance.diagonal().cwiseSqrt());
  Assessor assessor(made, noise, priors, {}, {}, errors, {});
  const AssessedPosterior posterior{
      update.result(), update.functions(), &update.sums(), update.form_of(update.result().step), false, {}};
  const VectorXd found = assessor.assess(posterior, AssessedData(examined)).model_shift_std;
  // By the 256 points that stand for the posterior.
  for (Index a = 0; a < d; ++a) EXPECT_NEAR(found[a], expected[a], 0.1 * expected.maxCoeff()) << a;
  // In another order of questions the same, to the bit.
  const std::span<const likelihood::DatumPointer> all(examined);
  (void)assessor.assess(posterior, AssessedData(all.first(5)));
  assessor.forget_from(3);
  EXPECT_EQ(assessor.assess(posterior, AssessedData(all)).model_shift_std, found);
}

// Errors that are alike where a b is: those of other products do not count.
TEST(Verdict, ErrorsCountWhereTheyAreAlike) {
  const Bench bench;  // a b = 1.08
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  model::ObservedErrors errors;
  errors.space = MatrixXd::NullaryExpr(k_case_sensors, 2, [&] { return 0.01 * normal(random); });
  errors.points.resize(4, 2);
  errors.points << 1.2, 0.9, 0.72, 1.5, 0.6, 0.6, 1.4, 1.4;
  errors.reach = MatrixXd::Zero(4, 2);
  for (Index t = 0; t < k_case_times; ++t)
    errors.coefficients.emplace_back(MatrixXd::NullaryExpr(2, 4, [&] { return normal(random); }));
  model::ObservedErrors near = errors;
  near.points = MatrixXd(errors.points.topRows(2));
  near.reach = MatrixXd::Zero(2, 2);
  for (MatrixXd& coefficients : near.coefficients) coefficients = MatrixXd(coefficients.leftCols(2));
  for (MatrixXd& coefficients : errors.coefficients) coefficients.rightCols(2) *= 100;
  const VectorXd everywhere = bench.verdict({}, errors).model_shift_std;
  errors.alike = Eigen::Vector2d::Ones();
  errors.alike_within = 0.1;
  const VectorXd found = bench.verdict({}, errors).model_shift_std;
  const VectorXd expected = bench.verdict({}, near).model_shift_std;
  EXPECT_GT(everywhere.minCoeff(), 10 * expected.maxCoeff());
  EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 0.05 * expected.maxCoeff());
}

StepResult assimilate_all(const Bench& bench, double gate, std::vector<Index>* rejected = nullptr) {
  EngineSetup setup;
  setup.model = bench.model;
  setup.noise = bench.noise;
  setup.priors = bench.priors;
  setup.sensors = bench.sensors;
  setup.robust.gate = gate;
  Engine engine(setup);
  StepResult last;
  for (std::size_t t = 0; t < k_case_times; ++t) {
    last = engine.assimilate({{}, t, t, bench.data.col(static_cast<Index>(t)), {}});
    if (rejected != nullptr) rejected->push_back(last.update.rejected);
  }
  return last;
}

void expect_nothing_rejected_and_the_same_posterior(const Bench& bench) {
  std::vector<Index> rejected;
  const StepResult gated = assimilate_all(bench, 5, &rejected), plain = assimilate_all(bench, 0);
  EXPECT_EQ(*std::max_element(rejected.begin(), rejected.end()), 0);
  EXPECT_LT((gated.update.mean - plain.update.mean).norm(), 1e-9 * plain.update.mean.norm());
  EXPECT_LT((gated.update.covariance - plain.update.covariance).norm(),
            1e-9 * plain.update.covariance.norm());
  EXPECT_EQ(gated.update.verdict.level, VerdictLevel::ok) << verdict_text(gated.update.verdict);
  ASSERT_EQ(gated.lasting_errors.size(), plain.lasting_errors.size());
  for (std::size_t k = 0; k < plain.lasting_errors.size(); ++k)
    EXPECT_NEAR(gated.lasting_errors[k].mean, plain.lasting_errors[k].mean,
                1e-6 * plain.lasting_errors[k].std);
}

/// A load cell with an error that lasts, 1.5 times its standard deviation, 75 times the noise of a value.
TEST(Verdict, WithAGateAnErrorThatLastsIsNoOutlier) {
  for (unsigned seed = 1; seed <= 8; ++seed) {
    Bench bench(seed);
    bench.name_last_sensor("force");
    std::vector<MatrixXd> factors;
    for (Index t = 0; t < k_case_times; ++t)
      factors.emplace_back(VectorXd::Unit(k_case_sensors, k_case_sensors - 1) * (5 + 0.1 * double(t)));
    bench.noise = likelihood::NoiseModel::independent(VectorXd::Constant(k_case_sensors - 1, 0.1))
                      .with_scalars(VectorXd::Constant(1, 0.1))
                      .with_lasting_errors({{{"cell.time_offset", 2}}, factors});
    for (Index t = 0; t < k_case_times; ++t) bench.data.col(t) += 1.5 * factors[static_cast<std::size_t>(t)];
    expect_nothing_rejected_and_the_same_posterior(bench);
    const StepResult last = assimilate_all(bench, 5);
    ASSERT_EQ(last.lasting_errors.size(), 1u);
    EXPECT_NEAR(last.lasting_errors[0].mean, 2 * 1.5, 4 * last.lasting_errors[0].std);
    // What is no such error is still seen.
    bench.data(k_case_sensors - 1, 20) += 1.5;
    std::vector<Index> rejected;
    (void)assimilate_all(bench, 5, &rejected);
    for (Index t = 0; t < k_case_times; ++t) EXPECT_EQ(rejected[static_cast<std::size_t>(t)], t == 20) << t;
  }
}

TEST(Verdict, WithAGateOffsetsAndAScaleAreNoOutliers) {
  for (unsigned seed = 1; seed <= 8; ++seed) {
    Bench bench(seed);
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    bench.data *= 1.01;
    for (Index i = 0; i < k_case_sensors; ++i) bench.data.row(i).array() += 0.6 * normal(random);
    bench.noise = bench.noise.with_offsets(0.6).with_scale_error(0.01);
    expect_nothing_rejected_and_the_same_posterior(bench);
  }
}

/// A normal density cut off: what its pressure says of where its mean was, against the formula.
TEST(Verdict, HowRarelyATruthInsideIsPressedAgainstAnEdge) {
  const auto cut_off = [](double beyond, double s) {
    posterior::Posterior p;
    constexpr Index n = 4000;
    p.points.resize(n, 1);
    p.weights = VectorXd::Constant(n, 1.0 / n);
    const double mass = 0.5 * std::erfc(beyond / std::sqrt(2.0));
    for (Index k = 0; k < n; ++k) {
      double low = 0, high = 12;  // of the survival function
      for (int i = 0; i < 60; ++i) {
        const double middle = 0.5 * (low + high);
        (0.5 * std::erfc((beyond + middle) / std::sqrt(2.0)) > mass * (1 - (double(k) + 0.5) / n) ? low
                                                                                                  : high) =
            middle;
      }
      p.points(k, 0) = s * low;
    }
    p.summarise();
    return p;
  };
  for (const double s : {0.002, 0.01, 0.05})
    for (const double beyond : {0.75, 1.0, 1.5, 2.0}) {
      const posterior::Posterior p = cut_off(beyond, s);
      const double exact = 2 * s *
                           (std::exp(-0.5 * beyond * beyond) / std::sqrt(2 * M_PI) -
                            beyond * 0.5 * std::erfc(beyond / std::sqrt(2.0)));
      const double found = probability_inside(edge_pressure(p, 0, 0), std::sqrt(p.covariance(0, 0)));
      EXPECT_NEAR(std::log(found / exact), 0, 0.1) << s << " " << beyond;
    }
}

/// Of truths two and a half standard deviations outside nearly all are told, of truths inside nearly none.
TEST(Verdict, ATruthOutsideTheBoxIsToldAndOneInsideIsNot) {
  const auto range_reasons = [](const Bench& bench) {
    std::string told;
    for (const VerdictReason& reason : bench.verdict().reasons)
      if (reason.part == VerdictPart::range) told += reason.message;
    return told;
  };
  int outside = 0, inside = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    Bench bench(seed);
    for (posterior::Prior& prior : bench.priors) prior = posterior::Prior::uniform(0.5, 1.5);
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.5, 1.5);
    bench.truth = {uniform(random), uniform(random)};
    const VectorXd std = bench.noise.measurement().standard_deviations();
    bench.data = likelihood::test::synthetic_data(*bench.model, bench.truth, std, seed);
    inside += range_reasons(bench).empty() ? 0 : 1;
    bench.truth = {1.0, 1.0};
    SequentialUpdate update(bench.model, bench.noise, bench.priors);
    bench.data = likelihood::test::synthetic_data(*bench.model, bench.truth, std, seed);
    for (std::size_t t = 0; t < k_case_times; ++t) update.update(t, t, bench.data.col(static_cast<Index>(t)));
    // The box ends two and a half standard deviations before the truth.
    bench.priors[0] = posterior::Prior::uniform(0.5, 1 - 2.5 * update.result().standard_deviations()[0]);
    outside += range_reasons(bench).find("a is pressed against the upper end") == 0 ? 1 : 0;
  }
  EXPECT_GE(outside, 90);
  EXPECT_LE(inside, 2);
}

TEST(Verdict, APosteriorPressedAgainstAnEdgeIsRejected) {
  Bench bench;
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  // The truth is far beyond the lower end: the data are those of w at a point that the model does not have.
  const double a = 0.3, b = 1.2;
  const VectorXd w = Eigen::Vector3d(a * b, a * a * std::sin(b), 1 / (a + b * b));
  for (Index t = 0; t < k_case_times; ++t) {
    bench.data.col(t) =
        bench.model->lift.col(t) + bench.model->space * (bench.model->core[static_cast<std::size_t>(t)] * w);
    for (double& value : bench.data.col(t)) value += 0.1 * normal(random);
  }
  const Verdict verdict = bench.verdict();
  EXPECT_EQ(verdict.level, VerdictLevel::reject);
  EXPECT_NE(verdict_text(verdict).find(
                "a is pressed against the lower end of the model's range: the data favour values below 0.5"),
            std::string::npos)
      << verdict_text(verdict);
  EXPECT_GT(verdict.edge_mass[0], 0.9);
}

}  // namespace
}  // namespace knothe::assimilation
