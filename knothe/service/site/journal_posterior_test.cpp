#include "knothe/service/site/journal_posterior.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <random>

#include "knothe/reduction/testing/test_models.hpp"

namespace knothe::service {
namespace {

using assimilation::NoiseModel;
using assimilation::Prior;
using assimilation::StepForm;

project::UpdateSetup random_setup(const NoiseModel& noise) {
  const reduction::SeparatedModel model(reduction::random_contents(reduction::Form::tree));
  const auto& dofs = model.contents().dofs;
  std::vector<double> points(dofs.points.begin(), dofs.points.begin() + 3 * noise.size());
  std::vector<std::int64_t> components(dofs.components.begin(), dofs.components.begin() + noise.size());
  auto observed =
      std::make_shared<const reduction::ObservedModel>(reduction::observe(model, points, components));
  assimilation::Measurements measurements;
  measurements.noise = noise;
  measurements.values.resize(noise.size(), 0);
  return {model,
          measurements,
          points,
          components,
          observed,
          {},
          {Prior::normal(0.9, 0.4), Prior::normal(1.1, 0.4)},
          {},
          {},
          {},
          {},
          {},
          {}};
}

std::vector<Datum> random_data(const project::UpdateSetup& setup, int count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const Eigen::Vector2d truth(1.0, 1.1);
  std::vector<Datum> data;
  for (int k = 0; k < count; ++k) {
    Datum d;
    d.key = {k % 3 == 0 ? "gauges" : "camera", "s", k};
    d.step = static_cast<std::int64_t>(random() % setup.observed->time.size());
    const Eigen::VectorXd predicted = setup.observed->predict(truth, static_cast<std::size_t>(d.step));
    for (const double value : predicted) {
      d.values.push_back(value + 0.3 * normal(random));
      d.status.push_back(random() % 7 == 0 ? 1 : 0);
    }
    if (k % 2 == 0) std::fill(d.status.begin(), d.status.end(), 0);
    data.push_back(d);
  }
  return data;
}

void expect_identical(const StepForm& a, const StepForm& b) {
  EXPECT_EQ(a.quadratic, b.quadratic);
  EXPECT_EQ(a.linear, b.linear);
  EXPECT_EQ(a.constant, b.constant);
  EXPECT_EQ(a.log_normaliser, b.log_normaliser);
  EXPECT_EQ(a.used, b.used);
  EXPECT_EQ(a.missing, b.missing);
}

const Eigen::Index k_sensors = 12;

TEST(JournalPosterior, NeitherOrderNorDuplicatesChangeABit) {
  const auto setup = random_setup(NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.3)));
  const std::vector<Datum> data = random_data(setup, 17, 5);
  JournalPosterior in_order({}, setup);
  for (const Datum& d : data) in_order.add(d);
  const std::size_t last = *in_order.last_step();
  for (std::size_t step = 0; step < last; ++step)
    if (in_order.stale().contains(step)) (void)in_order.conclude(step);
  const assimilation::UpdateResult result = in_order.conclude(last).result;
  std::mt19937_64 random(6);
  const char* many = std::getenv("KNOTHE_SEQUENCES");  // 10,000 at night
  for (int k = 0; k < (many == nullptr ? 12 : std::atoi(many)); ++k) {
    std::vector<Datum> sequence = data;
    for (int extra = 0; extra < 6; ++extra) sequence.push_back(data[random() % data.size()]);
    std::shuffle(sequence.begin(), sequence.end(), random);
    JournalPosterior shuffled({}, setup);
    for (std::size_t i = 0; i < sequence.size(); ++i) {
      shuffled.add(sequence[i]);
      // What was shown in between must not matter.
      if (k == 0 && i % 8 == 0) (void)shuffled.conclude(*shuffled.stale().begin());
      if (k == 0 && i % 8 == 4) (void)shuffled.preview(*shuffled.stale().rbegin());
    }
    for (std::size_t step = 0; step <= last; ++step)
      expect_identical(shuffled.form_up_to(step), in_order.form_up_to(step));
    if (k >= 1) continue;
    const auto conclusion = shuffled.conclude(last);
    EXPECT_EQ(conclusion.result.mean, result.mean);
    EXPECT_EQ(conclusion.result.covariance, result.covariance);
    EXPECT_EQ(conclusion.result.quantiles, result.quantiles);
    EXPECT_EQ(conclusion.result.log_evidence, result.log_evidence);
    EXPECT_EQ(conclusion.result.log_evidence_increment, result.log_evidence_increment);
    EXPECT_EQ(conclusion.result.monitor.cumulative_sum, result.monitor.cumulative_sum);
    EXPECT_EQ(conclusion.result.monitor.upper_probability, result.monitor.upper_probability);
    EXPECT_EQ(conclusion.result.monitor.smoothed_increment, result.monitor.smoothed_increment);
  }
}

TEST(JournalPosterior, OneDatumPerStepIsTheSequentialUpdate) {
  const auto setup = random_setup(NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.3)));
  std::vector<Datum> data = random_data(setup, 4, 7);
  assimilation::SequentialUpdate update(setup.observed, setup.measurements.noise, setup.priors,
                                        setup.options);
  JournalPosterior posterior({}, setup);
  for (std::size_t step = 0; step < 4; ++step) {
    data[step].step = static_cast<std::int64_t>(step);
    std::vector<double> values = data[step].effective_values();
    const auto& expected = update.update(step, step, Eigen::Map<Eigen::VectorXd>(values.data(), k_sensors));
    posterior.add(data[step]);
    EXPECT_EQ(posterior.stale(), (std::set<std::size_t>{step}));
    const auto conclusion = posterior.conclude(step);
    EXPECT_EQ(conclusion.result.mean, expected.mean);
    EXPECT_EQ(conclusion.result.log_evidence, expected.log_evidence);
    EXPECT_EQ(conclusion.result.log_evidence_increment, expected.log_evidence_increment);
    EXPECT_EQ(conclusion.posterior.points, update.posterior().points);
    EXPECT_EQ(conclusion.result.monitor.cumulative_sum, expected.monitor.cumulative_sum);
  }
}

/// Data that drift away: the correction comes on, and takes steps out and puts them back. Whatever came late,
/// and whatever was shown before, each step ends as it does when all come in order.
TEST(JournalPosterior, ACorrectionThatRedoesStepsIsAFunctionOfTheData) {
  for (const auto way : {assimilation::BiasOptions::Way::joint, assimilation::BiasOptions::Way::modes}) {
    auto setup = random_setup(NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.3)));
    setup.options.bias_correction = assimilation::BiasCorrectionMode::automatic;
    setup.options.bias.way = way;
    setup.options.monitor.average_run_length = 4;  // rings soon
    std::vector<Datum> data = random_data(setup, 4, 9);
    std::vector<assimilation::UpdateResult> expected;
    assimilation::SequentialUpdate update(setup.observed, setup.measurements.noise, setup.priors,
                                          setup.options);
    for (std::size_t step = 0; step < data.size(); ++step) {
      data[step].step = static_cast<std::int64_t>(step);
      for (std::size_t i = 0; i < data[step].values.size(); ++i)
        data[step].values[i] += (i % 2 == 0 ? 0.5 : -0.5) * static_cast<double>(step);
      std::vector<double> values = data[step].effective_values();
      expected.push_back(update.update(step, step, Eigen::Map<Eigen::VectorXd>(values.data(), k_sensors)));
    }
    EXPECT_TRUE(expected.back().bias_corrected);
    JournalPosterior posterior({}, setup);
    std::map<std::size_t, assimilation::UpdateResult> lines;
    for (const std::size_t k : {0u, 2u, 3u, 1u}) {
      posterior.add(data[k]);
      while (!posterior.stale().empty()) {
        const std::size_t step = *posterior.stale().begin();
        lines[step] = posterior.conclude(step).result;
      }
    }
    for (std::size_t step = 0; step < data.size(); ++step) {
      EXPECT_EQ(lines[step].mean, expected[step].mean) << step;
      EXPECT_EQ(lines[step].log_evidence, expected[step].log_evidence) << step;
      EXPECT_EQ(lines[step].bias_corrected, expected[step].bias_corrected) << step;
      EXPECT_EQ(lines[step].monitor.cumulative_sum, expected[step].monitor.cumulative_sum) << step;
      EXPECT_EQ(lines[step].notice, expected[step].notice) << step;
    }
  }
}

/// The joint correction beside an error that all steps share: the same as when all come in order.
TEST(JournalPosterior, ACorrectionBesideConstantOffsetsIsThatOfTheDataInOrder) {
  auto setup =
      random_setup(NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.3)).with_offsets(0.2));
  setup.options.bias_correction = assimilation::BiasCorrectionMode::on;
  std::vector<Datum> data = random_data(setup, 4, 9);
  assimilation::SequentialUpdate update(setup.observed, setup.measurements.noise, setup.priors,
                                        setup.options);
  std::vector<assimilation::UpdateResult> expected;
  for (std::size_t step = 0; step < data.size(); ++step) {
    data[step].step = static_cast<std::int64_t>(step);
    std::vector<double> values = data[step].effective_values();
    expected.push_back(update.update(step, step, Eigen::Map<Eigen::VectorXd>(values.data(), k_sensors)));
  }
  for (const auto& order : {std::vector<std::size_t>{0, 1, 2, 3}, {0, 3, 1, 2}}) {
    JournalPosterior posterior({}, setup);
    std::map<std::size_t, assimilation::UpdateResult> lines;
    for (const std::size_t k : order) {
      posterior.add(data[k]);
      while (!posterior.stale().empty()) {
        const std::size_t step = *posterior.stale().begin();
        lines[step] = posterior.conclude(step).result;
      }
    }
    for (std::size_t step = 0; step < data.size(); ++step) {
      EXPECT_TRUE(lines[step].bias_corrected) << step;
      EXPECT_EQ(lines[step].mean, expected[step].mean) << step;
      EXPECT_EQ(lines[step].covariance, expected[step].covariance) << step;
      EXPECT_EQ(lines[step].log_evidence, expected[step].log_evidence) << step;
    }
  }
}

TEST(JournalPosterior, ALateDatumMakesItsStepAndAllLaterOnesStale) {
  const auto setup = random_setup(NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, 0.3)));
  std::vector<Datum> data = random_data(setup, 4, 8);
  for (std::size_t k = 0; k < 4; ++k) data[k].step = static_cast<std::int64_t>(k);
  JournalPosterior posterior({}, setup);
  for (const std::size_t k : {0u, 1u, 3u}) posterior.add(data[k]);
  for (const std::size_t k : {0u, 1u, 3u}) (void)posterior.conclude(k);
  EXPECT_TRUE(posterior.stale().empty());
  posterior.add(data[2]);
  EXPECT_EQ(posterior.stale(), (std::set<std::size_t>{2, 3}));
  EXPECT_EQ(posterior.data_of(2), 1u);
}

}  // namespace
}  // namespace knothe::service
