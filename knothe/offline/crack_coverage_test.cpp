/// @file Do crack lengths come out as they were forecast? Truths from the prior, at five lead times: the
/// elastic crack that is equivalent to the true field, which no reduced model is asked for, and the length of
/// the true damage field, whose curve over it is identified from further truths.
///
/// The short test draws its truths from a coarse beam's reduced model. The nightly ones solve each by the
/// full-order model, of the reference beam, of another mesh, with a crack band and with damage of a gradient:
/// KNOTHE_CRACKS=600 says how many, without it the tests are skipped.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/forecast/crack_bridge.hpp"
#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/likelihood/data/synthetic_measurements.hpp"
#include "knothe/model/compress/compression.hpp"
#include "knothe/model/observe/crack_modes.hpp"
#include "knothe/model/observe/observation_operator.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/offline/full_order/beam_simulator.hpp"
#include "knothe/offline/full_order/offline.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::offline {
namespace {

using model::Sensors;

/// The beam of the paper, and the grid on which its reduced model is built.
struct BeamCase {
  std::string name;
  BeamProblem problem;
  int nodes = 9;  ///< of the parameter grid, per axis

  [[nodiscard]] std::vector<model::Axis> axes() const {
    return {parameter_axis("Y0", problem.reference.threshold, 0.5, 1.5, nodes),
            parameter_axis("Ad", problem.reference.brittleness, 0.5, 1.5, nodes)};
  }
};

/// The model of at most so many modes, with crack solutions; read from the folder if it is there.
model::SeparatedModel model_of(const BeamCase& chosen, model::Form form, std::size_t modes,
                               const std::string& folder, int processes) {
  const std::string path = folder + "/" + chosen.name + ".h5";
  if (std::filesystem::exists(path)) return model::SeparatedModel(model::read_model(path), path);
  model::RunGrid grid;
  grid.axes = chosen.axes();
  grid.parts_folder = folder + "/" + chosen.name + ".parts";
  grid.processes = processes;
  const model::Snapshots snapshots = run_snapshots(chosen.problem, grid).snapshots;
  model::CompressionOptions options;
  options.form = form;
  options.modes = std::min(modes, snapshots.grid_size() - 1);
  model::ModelContents contents = model::compress(snapshots, options);
  const CrackTable table = crack_table(chosen.problem, {}, snapshots.dofs);
  contents.crack = model::crack_modes(table.lengths, table.values);
  model::write_model(contents, path);
  return model::SeparatedModel(std::move(contents), path);
}

/// 30 nodes of the outer face with |x| ≤ 120 mm, x and y components.
Sensors sensors_of(const model::SeparatedModel& model) {
  const model::Dofs& dofs = model.contents().dofs;
  likelihood::DofSelection selection;
  selection.nodes = 30;
  selection.x_range = {-0.12, 0.12};
  Sensors sensors;
  for (const std::size_t dof : likelihood::choose_dofs(dofs, selection, 1))
    sensors.add(dofs.point(dof), dofs.components[dof]);
  return sensors;
}

/// The displacements that a model predicts at parameters `p`, n × n_t.
Eigen::MatrixXd predicted(const model::ObservedModel& model, const Eigen::VectorXd& p) {
  Eigen::MatrixXd exact(model.observations(), static_cast<Eigen::Index>(model.time.size()));
  for (std::size_t t = 0; t < model.time.size(); ++t)
    exact.col(static_cast<Eigen::Index>(t)) = model.predict(p, t);
  return exact;
}

/// The paper's prior, of mean (0.9, 1.1) and covariance 0.2 I; the update truncates it to the model's box.
std::vector<posterior::Prior> paper_priors() {
  return {posterior::Prior::normal(0.9, std::sqrt(0.2)), posterior::Prior::normal(1.1, std::sqrt(0.2))};
}

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
  const model::SeparatedModel& model;
  Sensors sensors;
  std::shared_ptr<const model::ObservedModel> seen;
  std::size_t horizon;
  posterior::PriorTransform prior;
  Eigen::MatrixXd crack_solutions;  ///< at the sensors, lengths × n

  Watched(const model::SeparatedModel& of, std::size_t horizon_step)
      : model(of),
        sensors(sensors_of(of)),
        seen(std::make_shared<const model::ObservedModel>(model::observe(of, sensors))),
        horizon(horizon_step),
        prior(update().transform()) {
    const model::CrackSolutions& crack = model.contents().crack;
    const auto dofs = static_cast<Eigen::Index>(model.dof_count());
    const auto modes = static_cast<Eigen::Index>(crack.modes.size()) / dofs;
    const model::ObservationOperator operation(model.contents().dofs, model.contents().mesh, "the beam",
                                               sensors);
    const Eigen::MatrixXd shapes =
        operation.apply(Eigen::Map<const Eigen::MatrixXd>(crack.modes.data(), dofs, modes));
    crack_solutions = Eigen::Map<const model::RowMatrix>(
                          crack.coefficients.data(), static_cast<Eigen::Index>(crack.length.size()), modes) *
                      shapes.transpose();
  }

  [[nodiscard]] static assimilation::UpdateOptions options() {
    assimilation::UpdateOptions options;
    options.map.tolerance = 1e-3;
    options.map.seed = 1;
    return options;
  }
  [[nodiscard]] assimilation::SequentialUpdate update() const {
    return {seen,
            likelihood::NoiseModel::independent(Eigen::VectorXd::Constant(seen->observations(), k_noise_std)),
            paper_priors(),
            {}};
  }
  [[nodiscard]] Eigen::VectorXd draw(unsigned seed) const {
    const Eigen::MatrixXd z = numerics::monte_carlo_normal_points(1, 2, seed);
    Eigen::VectorXd p(2);
    for (int k = 0; k < 2; ++k) p[k] = prior.prior(k).from_standard_normal(z(0, k)).value;
    return p;
  }
  /// The length of the elastic crack whose field is nearest to `field`, n.
  [[nodiscard]] double elastic_length(const Eigen::VectorXd& field, double imposed) const {
    const assimilation::CrackBridge bridge(
        assimilation::CrackMetaModel(model.contents().crack.length, crack_solutions),
        {field, Eigen::MatrixXd::Zero(field.size(), 1)}, imposed);
    return bridge.nearest(model::RowMatrix::Zero(1, 1)).length[0];
  }
  [[nodiscard]] assimilation::ForecastSpecification length() const {
    assimilation::ForecastSpecification what;
    what.name = "elastic";
    what.horizon = model.contents().time[horizon];
    return what;
  }
};

/// A true length against the reduced model's elastic one at the same parameters: a curve through the means of
/// ten equal shares of the truths in the order of the latter, and what is left.
struct Relation {
  assimilation::LengthCurve::Points curve;
  double std = 0;
};

Relation relation_of(std::vector<Truth> truths, double Truth::*length) {
  constexpr std::size_t k_parts = 10;
  std::sort(truths.begin(), truths.end(),
            [](const Truth& a, const Truth& b) { return a.modelled < b.modelled; });
  Relation relation;
  const std::size_t n = truths.size();
  for (std::size_t part = 0; part < k_parts; ++part) {
    const std::size_t first = part * n / k_parts, end = (part + 1) * n / k_parts;
    std::array<double, 2> mean{};
    for (std::size_t i = first; i < end; ++i) {
      mean[0] += truths[i].modelled / static_cast<double>(end - first);
      mean[1] += truths[i].*length / static_cast<double>(end - first);
    }
    if (relation.curve.empty() || (mean[0] > relation.curve.back()[0] && mean[1] > relation.curve.back()[1]))
      relation.curve.push_back(mean);
  }
  const assimilation::LengthCurve curve(relation.curve);
  for (const Truth& t : truths)
    relation.std += std::pow(t.*length - curve(t.modelled), 2) / static_cast<double>(n - k_parts);
  relation.std = std::sqrt(relation.std);
  return relation;
}

struct Relations {
  Relation elastic, damaged;
};

Relations relations_of(const std::vector<Truth>& truths) {
  const auto print = [](const char* name, const Relation& r) {
    std::printf("  %s, mm at mm of the model's elastic crack:", name);
    for (const auto& [modelled, length] : r.curve)
      std::printf(" %.2f at %.2f,", 1e3 * length, 1e3 * modelled);
    std::printf(" ± %.3f mm\n", 1e3 * r.std);
  };
  const Relations r{relation_of(truths, &Truth::elastic), relation_of(truths, &Truth::damaged)};
  print("elastic crack", r.elastic);
  print("damage field", r.damaged);
  return r;
}

/// How many truths lie within 90 % intervals after each of the steps `asked`.
struct Counts {
  std::array<int, k_leads> elastic{}, damaged{}, published{};
  std::array<double, k_leads> width{};  ///< mean std of the elastic length, m
};

/// What is asked of a forecast of one truth: curve and error of both lengths, the truths as thresholds.
assimilation::Forecaster forecaster_for(const Watched& beam, const Truth& truth, const Relations& relations) {
  assimilation::ForecastSpecification elastic = beam.length(), damaged = beam.length();
  damaged.name = "damaged";
  elastic.length_curve = relations.elastic.curve;
  elastic.model_error_std = relations.elastic.std;
  damaged.length_curve = relations.damaged.curve;
  damaged.model_error_std = relations.damaged.std;
  elastic.threshold = truth.elastic;
  damaged.threshold = truth.damaged;
  return {beam.model, beam.sensors, {elastic, damaged}};
}

/// Assimilates what the sensors show of a truth, with noise, and calls `forecast(lead, posterior)` after each
/// of the steps `asked`.
template <class Forecast>
void watch(const Watched& beam, const Truth& truth, unsigned seed,
           const std::array<std::size_t, k_leads>& asked, Forecast forecast) {
  const Eigen::MatrixXd noise =
      numerics::monte_carlo_normal_points(truth.exact.rows(), truth.exact.cols(), seed);
  assimilation::SequentialUpdate update = beam.update();
  for (std::size_t t = 0; t <= asked.back(); ++t) {
    const auto column = static_cast<Eigen::Index>(t);
    update.update(t, t, truth.exact.col(column) + k_noise_std * noise.col(column));
    const auto lead = static_cast<std::size_t>(std::find(asked.begin(), asked.end(), t) - asked.begin());
    if (lead < k_leads) forecast(lead, update.result());
  }
}

/// What is left of the model's error once the data up to each of the steps `asked` are known: near the
/// horizon they show part of it. The s for which the calibration's errors are most probable,
/// Σ log N(e; 0, s² + std²), at most what the lengths differ by without data.
std::array<Relations, k_leads> errors_left(const Watched& beam, const std::vector<Truth>& calibration,
                                           const std::array<std::size_t, k_leads>& asked,
                                           const Relations& relations) {
  struct Error {
    double error, std;
  };
  std::array<std::vector<Error>, k_leads> elastic, damaged;
  const Relations exact{{relations.elastic.curve, 0}, {relations.damaged.curve, 0}};
  for (std::size_t i = 0; i < calibration.size(); ++i) {
    const Truth& truth = calibration[i];
    assimilation::Forecaster forecaster = forecaster_for(beam, truth, exact);
    watch(beam, truth, 9000 + static_cast<unsigned>(i), asked,
          [&](std::size_t lead, const posterior::Posterior& posterior) {
            const auto forecasts = forecaster.update(posterior.points, posterior.weights);
            const assimilation::ScalarForecast &e = forecasts[0].forecast, &d = forecasts[1].forecast;
            elastic[lead].push_back({truth.elastic - e.mean, e.std});
            damaged[lead].push_back({truth.damaged - d.mean, d.std});
          });
  }
  const auto most_probable = [](const std::vector<Error>& errors, double most) {
    constexpr int k_parts = 50;
    double best = most, least = INFINITY;
    for (int part = 0; part <= k_parts; ++part) {
      const double s = most * part / k_parts;
      double misfit = 0;
      for (const Error& e : errors) {
        const double variance = s * s + e.std * e.std;
        misfit += e.error * e.error / variance + std::log(variance);
      }
      if (misfit < least) least = misfit, best = s;
    }
    return best;
  };
  std::array<Relations, k_leads> left;
  for (std::size_t lead = 0; lead < k_leads; ++lead)
    left[lead] = {{relations.elastic.curve, most_probable(elastic[lead], relations.elastic.std)},
                  {relations.damaged.curve, most_probable(damaged[lead], relations.damaged.std)}};
  return left;
}

/// With the truth as its threshold.
bool holds(const assimilation::ScalarForecast& forecast) {
  return 0.05 <= forecast.probability_above_threshold && forecast.probability_above_threshold <= 0.95;
}

Counts count(const Watched& beam, const std::vector<Truth>& truths,
             const std::array<std::size_t, k_leads>& asked, const std::array<Relations, k_leads>& relations) {
  Counts counts;
  for (std::size_t i = 0; i < truths.size(); ++i) {
    watch(beam, truths[i], 7000 + static_cast<unsigned>(i), asked,
          [&](std::size_t lead, const posterior::Posterior& posterior) {
            assimilation::Forecaster forecaster = forecaster_for(beam, truths[i], relations[lead]);
            const auto forecasts = forecaster.update(posterior.points, posterior.weights);
            counts.elastic[lead] += holds(forecasts[0].forecast);
            counts.damaged[lead] += holds(forecasts[1].forecast);
            counts.published[lead] +=
                holds(forecaster.published(posterior.points, posterior.weights)[0].forecast);
            counts.width[lead] += forecasts[0].forecast.std / static_cast<double>(truths.size());
          });
  }
  for (std::size_t lead = 0; lead < k_leads; ++lead)
    std::printf(
        "  after step %zu: elastic %d, damage field %d of %zu in 90 %% (std %.2f mm; error left %.3f and "
        "%.3f mm); Eq. 33: %d\n",
        asked[lead], counts.elastic[lead], counts.damaged[lead], truths.size(), 1e3 * counts.width[lead],
        1e3 * relations[lead].elastic.std, 1e3 * relations[lead].damaged.std, counts.published[lead]);
  return counts;
}

void expect_within(std::span<const int> covered, std::size_t truths, double low, double high) {
  for (const int n : covered) {
    EXPECT_GE(n, low * static_cast<double>(truths));
    EXPECT_LE(n, high * static_cast<double>(truths));
  }
}

TEST(CrackForecast, IntervalsHoldTruthsOfTheModelAsOftenAsTheySay) {
  BeamCase coarse{"coarse", {}, 3};
  coarse.problem.beam.element = 0.02;
  coarse.problem.solver.steps = 12;
  const files::TestFolder folder;
  const model::SeparatedModel model = model_of(coarse, model::Form::canonical, 5, folder.file(""), 2);
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
  constexpr std::array<std::size_t, k_leads> k_asked = {1, 2, 3, 4, 5};
  const std::vector<Truth> calibration = draws(100, 4000), truths = draws(150, 400);
  const Counts counts =
      count(beam, truths, k_asked, errors_left(beam, calibration, k_asked, relations_of(calibration)));
  expect_within(counts.elastic, truths.size(), 0.84, 0.96);
  expect_within(counts.damaged, truths.size(), 0.84, 0.96);
}

/// A beam, watched in 30 steps up to where its crack length is uncertain.
BeamCase watched_case(BeamCase chosen, const char* name, double displacement) {
  chosen.name = name;
  chosen.problem.solver.steps = 30;
  chosen.problem.solver.displacement = displacement;
  return chosen;
}

BeamCase coverage_case(const std::string& name) {
  BeamCase other;
  if (name == "reference") return watched_case(other, "watched", 1.2e-4);
  if (name == "mesh") {
    other.problem.beam.element = 0.01;
    return watched_case(other, "watched_mesh", 1.2e-4);
  }
  if (name == "band") {
    other.problem.solver.regularisation = {DamageRegularisation::crack_band, 0.02, 0.01};
    return watched_case(other, "watched_band", 1.6e-4);
  }
  other.problem.beam.element = 0.01;
  other.problem.solver.regularisation = {DamageRegularisation::gradient, 0.005, 0.02};
  return watched_case(other, "watched_gradient", 4e-4);
}

class CrackCoverage : public testing::TestWithParam<const char*> {};

TEST_P(CrackCoverage, LengthsOfHeldOutFullOrderRunsAreAsForecast) {
  constexpr unsigned k_calibration = 100;  // further truths, which offset and error are identified from
  const char* number = std::getenv("KNOTHE_CRACKS");
  if (number == nullptr) GTEST_SKIP() << "full-order runs for minutes: set KNOTHE_CRACKS=600";
  const int held_out = std::atoi(number);
  ASSERT_GT(held_out, 0) << number;
  const files::TestFolder own;
  const char* kept = std::getenv("KNOTHE_CRACK_MODELS");
  const std::string folder = kept != nullptr ? kept : own.file("");
  const BeamCase chosen = coverage_case(GetParam());
  const model::SeparatedModel model = model_of(chosen, model::Form::tree, 50, folder, 1);
  const auto steps = static_cast<std::size_t>(chosen.problem.solver.steps);
  const Watched beam(model, steps - 1);

  FullOrderModel full = make_full_order_model(chosen.problem);
  const std::vector<model::Axis> axes = chosen.axes();
  const model::ObservationOperator operation(model.contents().dofs, model.contents().mesh, "the beam",
                                             beam.sensors);
  const auto last = static_cast<Eigen::Index>(steps) - 1;
  const double imposed = chosen.problem.solver.displacement;
  const auto solve = [&](unsigned first, unsigned count) {
    std::vector<Truth> truths;
    for (unsigned i = 0; i < count; ++i) {
      Truth truth{beam.draw(400 + first + i), {}, 0, 0, 0};
      const FullOrderResult run = full.run(
          damage_parameters(chosen.problem, axes, {truth.p.data(), truth.p.data() + truth.p.size()}));
      truth.exact = operation.apply(Eigen::Map<const Eigen::MatrixXd>(
          run.displacement.data(), static_cast<Eigen::Index>(model.dof_count()), last + 1));
      truth.elastic = beam.elastic_length(truth.exact.col(last), imposed);
      truth.damaged = run.crack_length;
      truth.modelled = beam.elastic_length(predicted(*beam.seen, truth.p).col(last), imposed);
      truths.push_back(std::move(truth));
    }
    return truths;
  };
  constexpr std::array<std::size_t, k_leads> k_asked = {4, 14, 19, 24, 29};
  const std::vector<Truth> calibration = solve(0, k_calibration);
  const auto relations = errors_left(beam, calibration, k_asked, relations_of(calibration));
  const std::vector<Truth> truths = solve(k_calibration, static_cast<unsigned>(held_out));
  const Counts counts = count(beam, truths, k_asked, relations);
  const double slack = held_out < 600 ? 0.06 : 0.04;
  expect_within(counts.elastic, truths.size(), 0.9 - slack, 0.9 + slack);
  expect_within(counts.damaged, truths.size(), 0.9 - slack, 0.9 + slack);
}

INSTANTIATE_TEST_SUITE_P(Beams, CrackCoverage, testing::Values("reference", "mesh", "band", "gradient"),
                         [](const auto& beam) { return std::string(beam.param); });

}  // namespace
}  // namespace knothe::offline
