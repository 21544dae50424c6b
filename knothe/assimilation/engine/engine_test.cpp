#include "knothe/assimilation/engine/engine.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <limits>
#include <map>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using likelihood::Datum;
using likelihood::GaussianNoise;
using likelihood::NoiseModel;
using likelihood::StepForm;
using posterior::Prior;

const Eigen::Index k_sensors = 12;
const Eigen::Vector2d k_truth(1.0, 1.1);

EngineSetup random_setup(const NoiseModel& noise) {
  const model::SeparatedModel model(model::random_contents(model::Form::tree));
  model::Dofs seen;
  for (std::size_t i = 0; i < static_cast<std::size_t>(noise.size()); ++i)
    seen.add(model.contents().dofs.point(i), model.contents().dofs.components[i]);
  EngineSetup setup;
  setup.model = std::make_shared<const model::ObservedModel>(model::observe(model, seen));
  setup.noise = noise;
  setup.priors = {Prior::normal(0.9, 0.4), Prior::normal(1.1, 0.4)};
  return setup;
}

EngineSetup independent_setup() {
  return random_setup(NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.3)));
}

std::vector<Datum> random_data(const EngineSetup& setup, int count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Datum> data;
  for (int k = 0; k < count; ++k) {
    Datum d;
    d.key = {k % 3 == 0 ? "gauges" : "camera", "s", k};
    d.step = d.time_index = random() % setup.model->time.size();
    d.values = setup.model->predict(k_truth, d.step);
    for (double& value : d.values) {
      value += 0.3 * normal(random);
      if (random() % 7 == 0 && k % 2 != 0) value = std::numeric_limits<double>::quiet_NaN();
    }
    data.push_back(d);
  }
  return data;
}

/// One datum for each of the first steps.
std::vector<Datum> data_in_order(const EngineSetup& setup, int count, unsigned seed) {
  std::vector<Datum> data = random_data(setup, count, seed);
  for (std::size_t step = 0; step < data.size(); ++step) {
    data[step].values += setup.model->predict(k_truth, step) - setup.model->predict(k_truth, data[step].step);
    data[step].step = data[step].time_index = step;
  }
  return data;
}

/// Noise that neighbours share, as that of a picture; without the sensors `lost`.
NoiseModel correlated_noise(std::initializer_list<Eigen::Index> lost) {
  Eigen::MatrixXd precision = Eigen::MatrixXd::Zero(k_sensors, k_sensors);
  for (Eigen::Index i = 0; i < k_sensors; ++i) {
    precision(i, i) = 12;
    if (i > 0) precision(i, i - 1) = precision(i - 1, i) = 3;
  }
  for (const Eigen::Index i : lost) precision.row(i).setZero(), precision.col(i).setZero();
  return NoiseModel::correlated(precision.sparseView());
}

/// All that is stale, in order.
void conclude_all(Engine& engine, std::map<std::size_t, StepResult>& results) {
  while (!engine.stale().empty()) {
    const std::size_t step = *engine.stale().begin();
    results[step] = engine.posterior_at(step);
  }
}

void expect_same(const StepResult& a, const StepResult& b) {
  EXPECT_EQ(a.update.mean, b.update.mean);
  EXPECT_EQ(a.update.covariance, b.update.covariance);
  EXPECT_EQ(a.update.quantiles, b.update.quantiles);
  EXPECT_EQ(a.update.log_evidence, b.update.log_evidence);
  EXPECT_EQ(a.update.log_evidence_increment, b.update.log_evidence_increment);
  EXPECT_EQ(a.update.monitor.cumulative_sum, b.update.monitor.cumulative_sum);
  EXPECT_EQ(a.update.monitor.upper_probability, b.update.monitor.upper_probability);
  EXPECT_EQ(a.update.bias_corrected, b.update.bias_corrected);
  EXPECT_EQ(a.update.notice, b.update.notice);
  EXPECT_EQ(a.update.used, b.update.used);
  EXPECT_EQ(a.update.points, b.update.points);
  EXPECT_EQ(a.update.weights, b.update.weights);
  EXPECT_EQ(verdict_text(a.update.verdict), verdict_text(b.update.verdict));
  EXPECT_EQ(a.update.verdict.fit_probability, b.update.verdict.fit_probability);
  EXPECT_EQ(a.update.verdict.edge_mass, b.update.verdict.edge_mass);
  EXPECT_EQ(a.stuck, b.stuck);
  EXPECT_EQ(a.absent, b.absent);
}

/// The same, with all data but those of one step in a file.
EngineSetup with_archive(EngineSetup setup) {
  setup.archive = ::testing::TempDir();
  setup.kept_in_memory = 0;
  return setup;
}

/// Every way in which the same data may come gives the same results, to the bit: shuffled, with what was
/// shown in between, with data that are withdrawn again, with one that is replaced, in memory or in a file.
void expect_a_function_of_the_data(const EngineSetup& setup, const std::vector<Datum>& data) {
  if (setup.archive.empty()) expect_a_function_of_the_data(with_archive(setup), data);
  Engine in_order(setup);
  std::map<std::size_t, StepResult> expected;
  for (const Datum& d : data) {
    in_order.add(d);
    conclude_all(in_order, expected);
  }
  Engine other(setup);
  std::map<std::size_t, StepResult> results;
  Datum wrong = data[1];
  wrong.values.array() += 0.7;
  wrong.noise.reset();
  other.add(wrong);
  for (std::size_t k = data.size(); k-- > 0;) {
    if (k == 1) {
      EXPECT_TRUE(other.withdraw(wrong.step, wrong.key));
    }
    other.add(data[k]);
    other.add(data[k]);  // twice is once
    Datum extra = data[k];
    extra.key = {"extra", "", 1};
    extra.values *= 1.1;
    other.add(extra);
    if (k % 2 == 0) (void)other.posterior_at(*other.stale().rbegin());
    if (k % 2 == 1) (void)other.preview(*other.stale().rbegin());
    EXPECT_TRUE(other.withdraw(extra.step, extra.key));
    EXPECT_FALSE(other.withdraw(extra.step, extra.key));
  }
  conclude_all(other, results);
  ASSERT_EQ(results.size(), expected.size());
  for (const auto& [step, result] : expected) {
    SCOPED_TRACE(step);
    expect_same(results.at(step), result);
  }
}

void expect_identical(const StepForm& a, const StepForm& b) {
  EXPECT_EQ(a.quadratic, b.quadratic);
  EXPECT_EQ(a.linear, b.linear);
  EXPECT_EQ(a.constant, b.constant);
  EXPECT_EQ(a.log_normaliser, b.log_normaliser);
  EXPECT_EQ(a.used, b.used);
  EXPECT_EQ(a.missing, b.missing);
}

TEST(Engine, NeitherOrderNorDuplicatesChangeABit) {
  const EngineSetup setup = independent_setup();
  const std::vector<Datum> data = random_data(setup, 17, 5);
  Engine in_order(setup);
  for (const Datum& d : data) in_order.add(d);
  const std::size_t last = *in_order.last_step();
  std::map<std::size_t, StepResult> expected;
  conclude_all(in_order, expected);
  std::mt19937_64 random(6);
  const char* many = std::getenv("KNOTHE_SEQUENCES");  // 10,000 at night
  for (int k = 0; k < (many == nullptr ? 12 : std::atoi(many)); ++k) {
    std::vector<Datum> sequence = data;
    for (int extra = 0; extra < 6; ++extra) sequence.push_back(data[random() % data.size()]);
    std::shuffle(sequence.begin(), sequence.end(), random);
    Engine shuffled(setup);
    for (std::size_t i = 0; i < sequence.size(); ++i) {
      shuffled.add(sequence[i]);
      // What was shown in between must not matter.
      if (k == 0 && i % 8 == 0) (void)shuffled.posterior_at(*shuffled.stale().begin());
      if (k == 0 && i % 8 == 4) (void)shuffled.preview(*shuffled.stale().rbegin());
    }
    for (std::size_t step = 0; step <= last; ++step)
      expect_identical(*shuffled.form_up_to(step), *in_order.form_up_to(step));
    if (k == 0) expect_same(shuffled.posterior_at(last), expected.at(last));
  }
}

/// Far more steps than are in memory, of two data where one is late; some are withdrawn, some come late.
TEST(Engine, OldDataInAFileChangeNoBit) {
  EngineSetup setup = independent_setup();
  setup.watches_sensors = true;
  setup.kept_in_memory = 8;
  EngineSetup archived = setup;
  archived.archive = ::testing::TempDir();
  std::mt19937_64 random(17);
  std::vector<Datum> data = random_data(setup, 240, 18);
  for (std::size_t k = 0; k < data.size(); ++k) data[k].step = k / 4 * 2 + k % 2, data[k].key.seq = k;
  for (Datum& d : data) {
    const std::size_t time = d.step / 2 % setup.model->time.size();
    d.values += setup.model->predict(k_truth, time) - setup.model->predict(k_truth, d.time_index);
    d.time_index = time;
  }
  data[100].noise = GaussianNoise::independent(Eigen::VectorXd::Constant(k_sensors, 0.4));
  Engine engine(setup), other(archived), at_once(archived);
  std::map<std::size_t, StepResult> expected, found;
  for (std::size_t k = 0; k < data.size(); ++k) {
    const Datum& late = data[k - std::min<std::size_t>(k, random() % 90)];
    for (Engine* each : {&engine, &other}) {
      each->add(data[k]);
      if (k % 11 == 0) {
        EXPECT_TRUE(each->withdraw(late.step, late.key));
      }
      if (k % 7 == 0) conclude_all(*each, each == &engine ? expected : found);
      if (k % 5 == 0 && !each->stale().empty()) (void)each->preview(*each->stale().rbegin());
      if (k % 11 == 0) each->add(late);
    }
    at_once.add(data[k]);
  }
  EXPECT_EQ(engine.data().in_memory(), engine.data().step_numbers().size());
  EXPECT_LT(other.data().in_memory(), 40U);
  EXPECT_LT(at_once.data().in_memory(), 40U);
  EXPECT_EQ(other.data().step_numbers(), engine.data().step_numbers());
  const std::size_t last = *engine.last_step();
  expect_same(at_once.preview(last), other.preview(last));
  conclude_all(engine, expected);
  conclude_all(other, found);
  for (const auto& [step, result] : expected) {
    SCOPED_TRACE(step);
    expect_same(found.at(step), result);
    expect_identical(*other.form_up_to(step), *engine.form_up_to(step));
    EXPECT_EQ(other.last_datum(step).key.seq, engine.last_datum(step).key.seq);
  }
  std::map<std::size_t, StepResult> after_restart;
  conclude_all(at_once, after_restart);
  for (const auto& [step, result] : expected) expect_same(after_restart.at(step), result);
}

TEST(Engine, OneDatumPerStepIsTheSequentialUpdate) {
  const EngineSetup setup = independent_setup();
  SequentialUpdate update(setup.model, setup.noise, setup.priors, setup.update);
  Engine engine(setup);
  for (const Datum& datum : data_in_order(setup, 4, 7)) {
    const auto& expected = update.update(datum.step, datum.step, datum.values);
    const StepResult result = engine.assimilate(datum);
    EXPECT_EQ(result.update.mean, expected.mean);
    EXPECT_EQ(result.update.log_evidence, expected.log_evidence);
    EXPECT_EQ(result.update.log_evidence_increment, expected.log_evidence_increment);
    EXPECT_EQ(result.update.points, update.result().points);
    EXPECT_EQ(result.update.monitor.cumulative_sum, expected.monitor.cumulative_sum);
  }
}

/// Data that drift away: the correction comes on, and takes steps out and puts them back. Whatever came late,
/// and whatever was shown before, each step ends as it does when all come in order.
TEST(Engine, ACorrectionThatRedoesStepsIsAFunctionOfTheData) {
  using Way = likelihood::BiasOptions::Way;
  for (const auto way : {Way::joint, Way::modes, Way::published}) {
    EngineSetup setup = independent_setup();
    setup.update.bias_correction = likelihood::BiasCorrectionMode::automatic;
    setup.update.bias.way = way;
    setup.update.monitor.average_run_length = 4;  // rings soon
    std::vector<Datum> data = data_in_order(setup, 4, 9);
    for (Datum& datum : data)
      for (Eigen::Index i = 0; i < k_sensors; ++i)
        datum.values[i] += (i % 2 == 0 ? 0.5 : -0.5) * static_cast<double>(datum.step);
    Engine engine(setup);
    std::map<std::size_t, StepResult> results;
    for (const Datum& datum : data) {
      engine.add(datum);
      conclude_all(engine, results);
    }
    EXPECT_TRUE(results.at(3).update.bias_corrected);
    expect_a_function_of_the_data(setup, data);
  }
}

/// The joint correction beside an error that all steps share.
TEST(Engine, ACorrectionBesideConstantOffsetsIsThatOfTheDataInOrder) {
  EngineSetup setup =
      random_setup(NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.3)).with_offsets(0.2));
  setup.update.bias_correction = likelihood::BiasCorrectionMode::on;
  expect_a_function_of_the_data(setup, data_in_order(setup, 4, 9));
}

TEST(Engine, WhatIsWithdrawnHasNeverCome) {
  const EngineSetup setup = independent_setup();
  expect_a_function_of_the_data(setup, data_in_order(setup, 4, 11));
}

TEST(Engine, ADatumsOwnNoiseIsUsedInItsStepAloneWithEveryMethod) {
  for (const int reference_pictures : {0, 1}) {
    EngineSetup setup = random_setup(correlated_noise({}).with_shared_reference(reference_pictures));
    std::vector<Datum> data = data_in_order(setup, 4, 12);
    for (Eigen::Index i : {2, 3}) data[2].values[i] = std::numeric_limits<double>::quiet_NaN();
    data[2].noise = correlated_noise({2, 3}).measurement();
    expect_a_function_of_the_data(setup, data);
    // By the noise of the steps, as a data file with noise/precision_steps has it.
    EngineSetup by_step = setup;
    by_step.noise = setup.noise.with_step(2, *data[2].noise);
    std::vector<std::function<void(EngineSetup&)>> methods = {
        [](EngineSetup&) {}, [](EngineSetup& s) { s.robust.gate = 3; },
        [](EngineSetup& s) { s.update.kind = posterior::Method::extended_kalman; }};
    for (const auto& choose : methods) {
      EngineSetup a = setup, b = by_step, without = setup;
      choose(a), choose(b), choose(without);
      Engine own(a), steps(b), ignoring(without);
      StepResult last_own, last_steps, last_ignoring;
      for (Datum datum : data) {
        last_own = own.assimilate(datum);
        datum.noise.reset();
        last_steps = steps.assimilate(datum);
        last_ignoring = ignoring.assimilate(datum);
      }
      EXPECT_EQ(last_own.update.mean, last_steps.update.mean);
      EXPECT_EQ(last_own.update.log_evidence, last_steps.update.log_evidence);
      EXPECT_NE(last_own.update.log_evidence, last_ignoring.update.log_evidence);
    }
  }
}

TEST(Engine, MethodsThatTakeDataInOrderAreFunctionsOfTheDataToo) {
  EngineSetup gated = independent_setup(), student = gated, filter = gated;
  gated.robust.gate = 3;
  student.robust.degrees_of_freedom = 4;
  filter.update.kind = posterior::Method::unscented_kalman;
  for (EngineSetup* setup : {&gated, &student, &filter}) {
    std::vector<Datum> data = data_in_order(*setup, 4, 13);
    data[2].values[4] += 1e3;  // an outlier
    expect_a_function_of_the_data(*setup, data);
    const std::vector<Datum> several = random_data(*setup, 9, 14);
    Engine engine(*setup), shuffled(*setup);
    for (const Datum& d : several) engine.add(d);
    for (auto it = several.rbegin(); it != several.rend(); ++it) shuffled.add(*it);
    expect_same(shuffled.posterior_at(*shuffled.last_step()), engine.posterior_at(*engine.last_step()));
  }
  Engine engine(gated);
  std::vector<Datum> data = data_in_order(gated, 3, 13);
  data[2].values[4] += 1e3;
  for (const std::size_t k : {0u, 1u}) (void)engine.assimilate(data[k]);
  const StepResult result = engine.assimilate(data[2]);
  ASSERT_TRUE(result.sensors.has_value());
  EXPECT_EQ(result.sensors->rejected, (std::vector<Eigen::Index>{4}));
}

TEST(Engine, ASensorThatSaysTheSameForEverIsStuckWheneverItsDataCame) {
  EngineSetup setup = independent_setup();
  setup.watches_sensors = true;
  setup.noise = NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 1e-3));
  std::vector<Datum> data;
  for (std::size_t step = 0; step < 6; ++step) {
    const std::size_t time = step % setup.model->time.size();
    data.push_back({{"s", "", static_cast<std::int64_t>(step)},
                    step,
                    time,
                    setup.model->predict(Eigen::Vector2d(1, 1), time),
                    {}});
    data.back().values[3] = data[0].values[3];
    data.back().values[5] = std::numeric_limits<double>::quiet_NaN();
  }
  expect_a_function_of_the_data(setup, data);
  Engine engine(setup);
  StepResult last;
  for (const Datum& d : data) last = engine.assimilate(d);
  EXPECT_EQ(last.stuck, (std::vector<Eigen::Index>{3}));
  EXPECT_EQ(last.absent, (std::vector<Eigen::Index>{5}));
}

TEST(Engine, ALateDatumMakesItsStepAndAllLaterOnesStale) {
  const EngineSetup setup = independent_setup();
  const std::vector<Datum> data = data_in_order(setup, 4, 8);
  Engine engine(setup);
  for (const std::size_t k : {0u, 1u, 3u}) engine.add(data[k]);
  for (const std::size_t k : {0u, 1u, 3u}) (void)engine.posterior_at(k);
  EXPECT_TRUE(engine.stale().empty());
  engine.add(data[2]);
  EXPECT_EQ(engine.stale(), (std::set<std::size_t>{2, 3}));
  EXPECT_EQ(engine.data().count(2), 1u);
}

TEST(Engine, ADatumThatDoesNotFitIsRefusedInWordsAndChangesNothing) {
  const EngineSetup setup = independent_setup();
  Engine engine(setup);
  std::vector<Datum> data = data_in_order(setup, 2, 8);
  (void)engine.assimilate(data[0]);
  const auto message = [&](const Datum& datum) -> std::string {
    try {
      engine.add(datum);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  Datum small = data[1];
  small.values.conservativeResize(3);
  EXPECT_EQ(message(small), "step 1: 3 values for 12 sensors");
  Datum late = data[1];
  late.time_index = 99;
  EXPECT_EQ(message(late),
            fmt::format("step 1: the model has {} times, there is no time 99", setup.model->time.size()));
  Datum infinite = data[1];
  infinite.values[0] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(message(infinite), "a measured value is infinite: give NaN for a missing value");
  EXPECT_TRUE(engine.stale().empty());
  EXPECT_EQ(engine.last_step(), 0u);

  EngineSetup compared = setup;
  compared.name = "first";
  compared.candidates.push_back({"other", setup, {0, 99, 2, 3}});
  Engine both(compared);
  EXPECT_EQ(both.assimilate(data[0]).models.size(), 2u);
  EXPECT_THROW(both.add(data[1]), DataError);  // the other model has no such time
  EXPECT_TRUE(both.stale().empty());
}

/// χ² of the last of these data given those before, with w at its posterior mean: from the dense covariance
/// of all values of all steps, own noise on the diagonal and one offset per sensor.
double dense_misfit(const EngineSetup& setup, const std::vector<Datum>& data, const StepResult& result,
                    double offset_std) {
  const auto& model = *setup.model;
  const Eigen::Index n = k_sensors, m = std::ssize(data);
  model::FunctionBatch w;
  w.resize(result.update.points.rows(), model.functions->dimension(), model.functions->count(), 0);
  model.functions->evaluate(result.update.points, 0, w);
  const Eigen::VectorXd mean = w.value.transpose() * result.update.weights;
  Eigen::VectorXd residual(n * m);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n * m, n * m);
  for (Eigen::Index k = 0; k < m; ++k) {
    const Datum& d = data[k];
    residual.segment(k * n, n) =
        d.values - model.lift.col(d.step) - model.space * (model.core[d.step] * mean);
    const likelihood::GaussianNoise& own = d.noise ? *d.noise : setup.noise.measurement();
    covariance.block(k * n, k * n, n, n).diagonal() = own.standard_deviations().cwiseAbs2();
  }
  for (Eigen::Index i = 0; i < n * m; ++i)
    for (Eigen::Index j = i % n; j < n * m; j += n) covariance(i, j) += offset_std * offset_std;
  const auto chi_squared = [&](Eigen::Index size) {
    const Eigen::VectorXd r = residual.head(size);
    return r.dot(covariance.topLeftCorner(size, size).llt().solve(r));
  };
  return chi_squared(n * m) - chi_squared(n * (m - 1));
}

TEST(Engine, TheMisfitOfADatumIsThatOfTheWholeLikelihood) {
  // Offsets of several noise standard deviations, and a datum ten times noisier that says so: by the base
  // noise alone each datum would be far off.
  constexpr double k_offset = 2;
  const EngineSetup setup =
      random_setup(NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.3)).with_offsets(k_offset));
  std::mt19937_64 random(31);
  std::normal_distribution<double> normal;
  Eigen::VectorXd offset(k_sensors);
  for (double& value : offset) value = k_offset * normal(random);
  Engine engine(setup);
  std::vector<Datum> data;
  for (std::size_t t = 0; t < setup.model->time.size(); ++t) {
    Datum d;
    d.step = d.time_index = t;
    const double std = t == 2 ? 3 : 0.3;
    if (t == 2) d.noise = likelihood::GaussianNoise::independent(Eigen::VectorXd::Constant(k_sensors, std));
    d.values = setup.model->predict(k_truth, t) + offset;
    for (double& value : d.values) value += std * normal(random);
    data.push_back(d);
    const StepResult result = engine.assimilate(d);
    const Misfit& latest = result.update.verdict.latest;
    EXPECT_EQ(latest.values, k_sensors);
    const double expected = dense_misfit(setup, data, result, k_offset);
    EXPECT_NEAR(latest.statistic, expected, 0.01 * expected) << t;  // its mean of w is that of fewer points
    EXPECT_GT(latest.probability, 1e-3) << t;
    EXPECT_EQ(result.update.verdict.misfit(), nullptr) << result.update.verdict.misfit()->message;
  }
}

TEST(Engine, AMisfitIsSeenWithCorrelatedNoiseAndAMissingValue) {
  EngineSetup setup = random_setup(correlated_noise({}));
  Engine engine(setup);
  std::vector<Datum> data = data_in_order(setup, 4, 12);
  for (Datum& datum : data) datum.values[2] = std::numeric_limits<double>::quiet_NaN();
  data[3].values[0] += 20;
  data[3].values[1] -= 20;
  for (const Datum& datum : data) {
    const Verdict verdict = engine.assimilate(datum).update.verdict;
    EXPECT_EQ(verdict.latest.values, (datum.values.array() == datum.values.array()).count());
    EXPECT_EQ(verdict.misfit() != nullptr, datum.step == 3) << datum.step;
    EXPECT_EQ(verdict.latest.probability < 1e-6, datum.step == 3) << datum.step;
  }
}

/// With a gate that rejects nothing: what there is without it, in steps of several data too.
TEST(Engine, SeveralDataOfAStepGrowOldOnce) {
  for (const likelihood::RobustOptions robust : {likelihood::RobustOptions{1e6, 0}, {0, 1e7}}) {
    SCOPED_TRACE(robust.gate);
    EngineSetup plain = independent_setup();
    plain.update.forgetting = 0.7;
    plain.update.change_points = {2};
    plain.update.change_retention = 0.3;
    plain.noise = plain.noise.with_step(
        1, NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.6)).measurement());
    EngineSetup robust_setup = plain;
    robust_setup.robust = robust;
    Engine without(plain), with(robust_setup);
    for (const Datum& d : random_data(plain, 12, 14)) {
      without.add(d);
      with.add(d);
    }
    const std::size_t last = *without.last_step();
    const UpdateResult a = without.posterior_at(last).update, b = with.posterior_at(last).update;
    EXPECT_LT((a.mean - b.mean).norm(), 1e-3 * a.standard_deviations().norm());
    EXPECT_NEAR(a.log_evidence, b.log_evidence, 0.01);
    EXPECT_NEAR(a.log_evidence_increment, b.log_evidence_increment, 0.01);
    EXPECT_EQ(a.used, b.used);
    EXPECT_EQ(a.missing, b.missing);
  }
}

TEST(Engine, AfterAChangeTheVerdictIsThatOfTheLaterDataAlone) {
  const auto fit = [](likelihood::RobustOptions robust, std::vector<std::size_t> changes, std::size_t first) {
    EngineSetup setup = independent_setup();
    const std::size_t last = setup.model->time.size() - 1;
    std::vector<Datum> data = data_in_order(setup, static_cast<int>(last + 1), 12);
    setup.robust = robust;
    setup.update.change_points = std::move(changes);
    Engine engine(setup);
    for (Datum& d : data) {
      if (d.step < 2)
        d.values +=
            setup.model->predict(Eigen::Vector2d(0.6, 1.4), d.step) - setup.model->predict(k_truth, d.step);
      if (d.step >= first) engine.add(d);
    }
    return engine.posterior_at(last).update.verdict.fit_probability;
  };
  for (const likelihood::RobustOptions robust :
       {likelihood::RobustOptions{}, likelihood::RobustOptions{50, 0}, likelihood::RobustOptions{0, 4}}) {
    SCOPED_TRACE(robust.gate + robust.degrees_of_freedom);
    EXPECT_NEAR(fit(robust, {2}, 0), fit(robust, {}, 2), 1e-12);
    EXPECT_LT(fit(robust, {}, 0), 0.5 * fit(robust, {2}, 0));
  }
}

TEST(Engine, CandidatesAreComparedUnderAStudentLikelihoodToo) {
  EngineSetup setup = independent_setup();
  setup.robust.degrees_of_freedom = 4;
  EngineSetup other = setup;
  other.priors = {Prior::normal(1.3, 0.1), Prior::normal(0.6, 0.1)};
  EngineSetup compared = setup;
  compared.name = "first";
  compared.candidates.push_back({"second", other, {0, 1, 2, 3}});
  Engine together(compared), first(setup), second(other);
  StepResult result, alone, elsewhere;
  for (const Datum& datum : data_in_order(setup, 4, 13)) {
    result = together.assimilate(datum);
    alone = first.assimilate(datum);
    elsewhere = second.assimilate(datum);
  }
  ASSERT_EQ(result.models.size(), 2U);
  EXPECT_EQ(result.models[0].log_evidence, alone.update.log_evidence);
  EXPECT_EQ(result.models[1].log_evidence, elsewhere.update.log_evidence);
}

}  // namespace
}  // namespace knothe::assimilation
