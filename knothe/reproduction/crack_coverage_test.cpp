/// @file Do crack lengths come out as they were forecast? Truths from the prior, at five lead times: the
/// elastic crack that is equivalent to the true field, which no reduced model is asked for, and the length of
/// the true damage field, whose offset from it is learnt from further truths.
///
/// The short test draws its truths from a coarse beam's reduced model. The nightly one solves each by the
/// full-order model of the reference beam: KNOTHE_CRACKS=600 says how many, without it the test is skipped.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <vector>

#include "knothe/assimilation/update/prior_transform.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/forecast/crack_bridge.hpp"
#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/reduction/observe/observation_operator.hpp"
#include "knothe/reproduction/beam_case.hpp"
#include "knothe/reproduction/experiment.hpp"

namespace knothe::reproduction {
namespace {

constexpr double k_noise_std = 1e-6;  ///< m
constexpr std::size_t k_leads = 5;

/// One truth: its parameters, what the sensors would show without noise (n × steps), the two lengths, and the
/// elastic length that the reduced model has for these parameters, m.
struct Truth {
  Eigen::VectorXd p;
  Eigen::MatrixXd exact;
  double elastic = 0, damaged = 0, modelled = 0;
};

/// The beam as it is watched up to the horizon, a step of the model.
struct Watched {
  const reduction::SeparatedModel& model;
  Sensors sensors;
  std::shared_ptr<const reduction::ObservedModel> seen;
  std::size_t horizon;
  assimilation::PriorTransform prior;
  Eigen::MatrixXd crack_solutions;  ///< at the sensors, lengths × n

  Watched(const reduction::SeparatedModel& of, std::size_t horizon_step)
      : model(of),
        sensors(random_nodes(of, 1)),
        seen(observed(of, sensors)),
        horizon(horizon_step),
        prior(update().transform()) {
    const reduction::CrackSolutions& crack = model.contents().crack;
    const auto dofs = static_cast<Eigen::Index>(model.dof_count());
    const auto modes = static_cast<Eigen::Index>(crack.modes.size()) / dofs;
    const reduction::ObservationOperator operation(model.contents().dofs, model.contents().mesh, "the beam",
                                                   sensors);
    const Eigen::MatrixXd shapes =
        operation.apply(Eigen::Map<const Eigen::MatrixXd>(crack.modes.data(), dofs, modes));
    crack_solutions = Eigen::Map<const reduction::RowMatrix>(
                          crack.coefficients.data(), static_cast<Eigen::Index>(crack.length.size()), modes) *
                      shapes.transpose();
  }

  [[nodiscard]] assimilation::SequentialUpdate update() const {
    return {
        seen,
        assimilation::NoiseModel::independent(Eigen::VectorXd::Constant(seen->observations(), k_noise_std)),
        paper_priors(), default_options(1)};
  }
  [[nodiscard]] Eigen::VectorXd draw(unsigned seed) const {
    const Eigen::MatrixXd z = numerics::monte_carlo_normal_points(1, 2, seed);
    Eigen::VectorXd p(2);
    for (int k = 0; k < 2; ++k) p[k] = prior.prior(k).from_standard_normal(z(0, k)).value;
    return p;
  }
  /// The length of the elastic crack whose field is nearest to `field`, n.
  [[nodiscard]] double elastic_length(const Eigen::VectorXd& field, double imposed) const {
    const forecast::CrackBridge bridge(
        forecast::CrackMetaModel(model.contents().crack.length, crack_solutions),
        {field, Eigen::MatrixXd::Zero(field.size(), 1)}, imposed);
    return bridge.best_lengths(reduction::RowMatrix::Zero(1, 1))[0];
  }
  [[nodiscard]] forecast::ForecastSpecification length() const {
    forecast::ForecastSpecification what;
    what.name = "elastic";
    what.horizon = model.contents().time[horizon];
    return what;
  }
};

/// What a true length is longer by than the reduced model's elastic one at the same parameters: mean, and
/// standard deviation from truth to truth.
struct Offset {
  double mean = 0, std = 0;
};

Offset offset_of(const std::vector<Truth>& truths, double Truth::*length) {
  Offset offset;
  const auto n = static_cast<double>(truths.size());
  for (const Truth& t : truths) offset.mean += (t.*length - t.modelled) / n;
  for (const Truth& t : truths) offset.std += std::pow(t.*length - t.modelled - offset.mean, 2) / (n - 1);
  offset.std = std::sqrt(offset.std);
  return offset;
}

struct Offsets {
  Offset elastic, damaged;
};

Offsets offsets_of(const std::vector<Truth>& truths) {
  const Offsets o{offset_of(truths, &Truth::elastic), offset_of(truths, &Truth::damaged)};
  std::printf(
      "  longer than the model's: elastic crack of the true field %.3f ± %.3f mm, damage field %.2f ± %.2f "
      "mm\n",
      1e3 * o.elastic.mean, 1e3 * o.elastic.std, 1e3 * o.damaged.mean, 1e3 * o.damaged.std);
  return o;
}

/// How many truths lie within 90 % intervals after each of the steps `asked`.
struct Counts {
  std::array<int, k_leads> elastic{}, damaged{}, published{};
  std::array<double, k_leads> width{};  ///< mean std of the elastic length, m
};

/// With the truth as its threshold.
bool holds(const forecast::ScalarForecast& forecast) {
  return 0.05 <= forecast.probability_above_threshold && forecast.probability_above_threshold <= 0.95;
}

/// Of the elastic length and of that of the damage field, the truths as their thresholds.
forecast::Forecaster forecaster_for(const Watched& beam, const Truth& truth, const Offsets& offsets) {
  forecast::ForecastSpecification elastic = beam.length(), damaged = beam.length();
  damaged.name = "damaged";
  elastic.length_offset = offsets.elastic.mean;
  elastic.model_error_std = offsets.elastic.std;
  damaged.length_offset = offsets.damaged.mean;
  damaged.model_error_std = offsets.damaged.std;
  elastic.threshold = truth.elastic;
  damaged.threshold = truth.damaged;
  return {beam.model, beam.sensors, {elastic, damaged}};
}

Counts count(const Watched& beam, const std::vector<Truth>& truths,
             const std::array<std::size_t, k_leads>& asked, const Offsets& offsets) {
  Counts counts;
  for (std::size_t i = 0; i < truths.size(); ++i) {
    const Truth& truth = truths[i];
    const Eigen::MatrixXd noise = numerics::monte_carlo_normal_points(truth.exact.rows(), truth.exact.cols(),
                                                                      7000 + static_cast<unsigned>(i));
    forecast::Forecaster forecaster = forecaster_for(beam, truth, offsets);
    assimilation::SequentialUpdate update = beam.update();
    for (std::size_t t = 0; t <= asked.back(); ++t) {
      const auto column = static_cast<Eigen::Index>(t);
      update.update(t, t, truth.exact.col(column) + k_noise_std * noise.col(column));
      const auto lead = static_cast<std::size_t>(std::find(asked.begin(), asked.end(), t) - asked.begin());
      if (lead == k_leads) continue;
      const assimilation::Posterior& posterior = update.posterior();
      const auto forecasts = forecaster.update(posterior.points, posterior.weights);
      counts.elastic[lead] += holds(forecasts[0].forecast);
      counts.damaged[lead] += holds(forecasts[1].forecast);
      counts.published[lead] += holds(forecaster.published(posterior.points, posterior.weights)[0].forecast);
      counts.width[lead] += forecasts[0].forecast.std / static_cast<double>(truths.size());
    }
  }
  for (std::size_t lead = 0; lead < k_leads; ++lead)
    std::printf("  after step %zu: elastic %d, damage field %d of %zu in 90 %% (std %.2f mm); Eq. 33: %d\n",
                asked[lead], counts.elastic[lead], counts.damaged[lead], truths.size(),
                1e3 * counts.width[lead], counts.published[lead]);
  return counts;
}

void expect_within(std::span<const int> covered, std::size_t truths, double low, double high) {
  for (const int n : covered) {
    EXPECT_GE(n, low * static_cast<double>(truths));
    EXPECT_LE(n, high * static_cast<double>(truths));
  }
}

TEST(CrackForecast, IntervalsHoldTruthsOfTheModelAsOftenAsTheySay) {
  BeamCase coarse{"coarse", "elements of 20 mm, 12 steps", {}, 3};
  coarse.problem.beam.element = 0.02;
  coarse.problem.solver.steps = 12;
  const files::TestFolder folder;
  const reduction::SeparatedModel model = prepare(coarse, folder.file(""), 2).paper;
  const Watched beam(model, 5);
  const double imposed = coarse.problem.solver.displacement * model.contents().time[beam.horizon];
  const auto draws = [&](unsigned count, unsigned seed) {
    const Eigen::MatrixXd scatter = 1e-3 * numerics::monte_carlo_normal_points(count, 1, seed);
    std::vector<Truth> truths;
    for (unsigned i = 0; i < count; ++i) {
      Truth truth{beam.draw(seed + i), {}, 0, 0, 0};
      truth.exact = predicted(*beam.seen, truth.p);
      truth.elastic = beam.elastic_length(truth.exact.col(static_cast<Eigen::Index>(beam.horizon)), imposed);
      truth.modelled = truth.elastic;
      truth.damaged = truth.elastic + 5e-3 + scatter(static_cast<Eigen::Index>(i), 0);
      truths.push_back(std::move(truth));
    }
    return truths;
  };
  const Offsets offsets = offsets_of(draws(100, 4000));
  const std::vector<Truth> truths = draws(150, 400);
  const Counts counts = count(beam, truths, {1, 2, 3, 4, 5}, offsets);
  expect_within(counts.elastic, truths.size(), 0.84, 0.96);
  expect_within(counts.damaged, truths.size(), 0.84, 0.96);
}

TEST(CrackCoverage, LengthsOfHeldOutFullOrderRunsAreAsForecast) {
  constexpr std::size_t k_steps = 30;     // of the 100: 0.12 mm, where the length is uncertain
  constexpr unsigned k_calibration = 50;  // further truths, which the offset is learnt from
  const char* number = std::getenv("KNOTHE_CRACKS");
  if (number == nullptr) GTEST_SKIP() << "full-order runs for minutes: set KNOTHE_CRACKS=600";
  const int held_out = std::atoi(number);
  ASSERT_GT(held_out, 0) << number;
  const files::TestFolder own;
  const char* kept = std::getenv("KNOTHE_CRACK_MODELS");
  const std::string folder = kept != nullptr ? kept : own.file("");
  const BeamCase chosen = reference_case();
  reduction::ModelContents contents = prepare_accurate(chosen, folder, 2).contents();
  contents.crack = prepare(chosen, folder, 2).paper.contents().crack;
  const reduction::SeparatedModel model(std::move(contents));
  const Watched beam(model, k_steps - 1);

  mechanics::BeamProblem problem = chosen.problem;
  problem.solver.displacement *= static_cast<double>(k_steps) / problem.solver.steps;
  problem.solver.steps = k_steps;
  mechanics::FullOrderModel full = mechanics::make_full_order_model(problem);
  const std::vector<reduction::Axis> axes = axes_of(chosen);
  const reduction::ObservationOperator operation(model.contents().dofs, model.contents().mesh, "the beam",
                                                 beam.sensors);
  const auto solve = [&](unsigned first, unsigned count) {
    std::vector<Truth> truths;
    for (unsigned i = 0; i < count; ++i) {
      Truth truth{beam.draw(400 + first + i), {}, 0, 0, 0};
      const mechanics::FullOrderResult run = full.run(
          mechanics::damage_parameters(problem, axes, {truth.p.data(), truth.p.data() + truth.p.size()}));
      truth.exact = operation.apply(Eigen::Map<const Eigen::MatrixXd>(
          run.displacement.data(), static_cast<Eigen::Index>(model.dof_count()), k_steps));
      truth.elastic = beam.elastic_length(truth.exact.col(k_steps - 1), problem.solver.displacement);
      truth.damaged = run.crack_length;
      truth.modelled =
          beam.elastic_length(predicted(*beam.seen, truth.p).col(k_steps - 1), problem.solver.displacement);
      truths.push_back(std::move(truth));
    }
    return truths;
  };
  const Offsets offsets = offsets_of(solve(0, k_calibration));
  const std::vector<Truth> truths = solve(k_calibration, static_cast<unsigned>(held_out));
  const Counts counts = count(beam, truths, {4, 14, 19, 24, 29}, offsets);
  const double slack = held_out < 600 ? 0.06 : 0.04;
  expect_within(counts.damaged, truths.size(), 0.9 - slack, 0.9 + slack);
  // At the horizon itself the data show part of the reduced model's error, which the forecast takes for
  // independent of them: too wide there, and only there.
  const std::span<const int> elastic(counts.elastic);
  expect_within(elastic.first(k_leads - 1), truths.size(), 0.9 - slack, 0.9 + slack);
  expect_within(elastic.last(1), truths.size(), 0.9 - slack, 1);
}

}  // namespace
}  // namespace knothe::reproduction
