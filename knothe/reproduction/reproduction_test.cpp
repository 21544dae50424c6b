/// @file The parts of the study on a coarse beam; the whole of it is a nightly test
/// (tests/cases/reproduce.py).
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/reduction/observe/observation_operator.hpp"
#include "knothe/reproduction/bias.hpp"
#include "knothe/reproduction/picture_selection.hpp"
#include "knothe/reproduction/study.hpp"
#include "knothe/reproduction/study_files.hpp"

namespace knothe::reproduction {
namespace {

BeamCase coarse_case() {
  BeamCase c{"coarse", "elements of 20 mm, 12 steps", {}, 3};
  c.problem.beam.element = 0.02;
  c.problem.solver.steps = 12;
  return c;
}

/// The models of the coarse beam, built once in a folder that goes when the tests end.
class CoarseBeam : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<files::TestFolder>();
    subject_ = std::make_unique<Subject>(subject_of(prepare(coarse_case(), folder_->file(""), 2), 1));
  }
  static void TearDownTestSuite() {
    subject_.reset();
    folder_.reset();
  }
  static std::unique_ptr<files::TestFolder> folder_;
  static std::unique_ptr<Subject> subject_;
};
std::unique_ptr<files::TestFolder> CoarseBeam::folder_;
std::unique_ptr<Subject> CoarseBeam::subject_;

/// Every row says something in each column, and every number is finite.
void expect_complete(const FigureRecord& record) {
  EXPECT_FALSE(record.setting.empty());
  EXPECT_FALSE(record.panels.empty());
  for (const Row& row : record.rows)
    for (const std::string* text : {&row.quantity, &row.unit, &row.paper, &row.here, &row.why})
      EXPECT_FALSE(text->empty()) << record.number << ": " << row.quantity;
  for (const auto& line : row_records(record)) EXPECT_NO_THROW((void)files::json_line(line));
}

const std::vector<double>& series(const FigureRecord& record, const std::string& name) {
  const auto found = std::find_if(record.data.begin(), record.data.end(),
                                  [&](const auto& entry) { return entry.first == name; });
  EXPECT_NE(found, record.data.end()) << name;
  return found->second;
}

TEST(Figure5, StressIsTheLawsClosedForm) {
  const BeamCase chosen = reference_case();
  const FigureRecord record = figure_5(chosen);
  expect_complete(record);
  const auto& elastic = chosen.problem.elastic;
  const auto& strain = series(record, "strain_1e-4");
  const auto& stress = series(record, "stress_MPa_Ad_1.5");
  ASSERT_EQ(strain.size(), stress.size());
  for (std::size_t i = 0; i < strain.size(); ++i) {
    // Only the longitudinal strain is positive: Y = ½ (λ + 2μ) ε², and σ = E ε / (1 + A_d (Y − Y₀)).
    const double e = 1e-4 * strain[i], y = 0.5 * (elastic.lambda() + 2 * elastic.mu()) * e * e;
    const double divisor = 1 + std::max(0.0, 1.5 * 2.25e-3 * (y - 216.0));
    EXPECT_NEAR(stress[i], 1e-6 * elastic.young_modulus * e / divisor, 1e-9) << i;
  }
}

TEST(Smoothed, IsTheMeanOfNeighboursAndOfFewerAtTheEnds) {
  EXPECT_EQ(smoothed({1, 2, 6, 4}, 3), (std::vector<double>{1.5, 3, 4, 5}));
  EXPECT_EQ(smoothed({1, 2}, 1), (std::vector<double>{1, 2}));
}

/// u = τ L(x) + 2 a(x) b(τ) p q + c(x) d(τ) (2 − p)(3 − q): the terms are orthogonal over space and over
/// time, so that the best single one is the larger of them.
reduction::Snapshots two_terms() {
  reduction::Snapshots s;
  for (const char* name : {"Y0", "Ad"}) {
    s.axes.emplace_back();
    s.axes.back().name = name;
    s.axes.back().nodes = {0.5, 1.0, 1.5};
  }
  s.time = {0.25, 0.5, 0.75, 1.0};
  const double lift[] = {1, 2, 3, 4, 5, 6}, a[] = {1, 1, 1, 1, 1, 1}, c[] = {1, -1, 1, -1, 1, -1};
  for (int i = 0; i < 6; ++i) {
    s.dofs.points.insert(s.dofs.points.end(), {0.1 * i, 0.0, 0.0});
    s.dofs.components.push_back(0);
  }
  for (const double t : s.time)
    for (const double l : lift) s.lift.push_back(t * l);
  const double b[] = {1, 2, 0, 0}, d[] = {0, 0, 1, 0.5};
  for (const double p : s.axes[0].nodes)
    for (const double q : s.axes[1].nodes)
      for (int t = 0; t < 4; ++t)
        for (int i = 0; i < 6; ++i)
          s.values.push_back(s.time[t] * lift[i] + 2 * a[i] * b[t] * p * q + c[i] * d[t] * (2 - p) * (3 - q));
  return s;
}

TEST(ModeByMode, FindsOrthogonalTermsOneByOne) {
  const reduction::Snapshots snapshots = two_terms();
  const reduction::SeparatedModel two(mode_by_mode(snapshots, 2, 1), "two");
  const reduction::SeparatedModel one(mode_by_mode(snapshots, 1, 1), "one");
  // Alternating least squares stop when nothing more is gained, and squares lose half the digits.
  EXPECT_LT(two.contents().max_error_m, 1e-6);
  EXPECT_LT(two.contents().relative_error, 1e-7);
  EXPECT_EQ(two.contents().parameter_modes, 2U);
  // What one mode leaves is the second term: at most (2 − 0.5)(3 − 0.5).
  EXPECT_NEAR(one.contents().max_error_m, 1.5 * 2.5, 1e-6);
  for (std::size_t g = 0; g < snapshots.grid_size(); ++g) {
    const auto field = two.evaluate(snapshots.parameters_at(g), 2).value;
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(field[i], snapshots.solution(g)[2 * 6 + i], 1e-6);
  }
}

TEST(FittedToBeginning, LaterStepsHaveTheTimeFunctionsThatFitBest) {
  const reduction::Snapshots snapshots = two_terms();
  // Two terms describe all four steps: what is found in the first three is right in the last too.
  const reduction::SeparatedModel two(fitted_to_beginning(snapshots, 3, 2, 1), "two");
  for (std::size_t t = 0; t < 4; ++t)
    for (std::size_t g = 0; g < snapshots.grid_size(); ++g) {
      const auto field = two.evaluate(snapshots.parameters_at(g), t).value;
      for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(field[i], snapshots.solution(g)[t * 6 + i], 1e-6);
    }
}

TEST(LessTrueResidual, TakesAwayABiasThatGrowsAlongALine) {
  const reduction::SeparatedModel model(mode_by_mode(two_terms(), 2, 1), "two");
  Sensors sensors;
  for (std::size_t i = 0; i < 6; ++i)
    sensors.add(model.contents().dofs.point(i), model.contents().dofs.components[i]);
  const auto seen = observed(model, sensors);
  const Eigen::Vector2d truth(1, 1);
  const Eigen::MatrixXd right = predicted(*seen, truth);
  Eigen::MatrixXd exact = right;
  for (Eigen::Index t = 0; t < exact.cols(); ++t)
    exact.col(t).array() += 1e-3 * (1 + seen->time[static_cast<std::size_t>(t)]);
  const assimilation::Measurements data = measure(exact, sensors, seen->time, 1, 1e-9);
  const assimilation::Measurements less = less_true_residual(*seen, truth, exact, data);
  EXPECT_EQ(less.values.col(0), data.values.col(0));  // nothing learnt before the first
  for (Eigen::Index t = 2; t < exact.cols(); ++t)
    EXPECT_LT((less.values.col(t) - right.col(t)).cwiseAbs().maxCoeff(), 1e-7) << t;
}

TEST(LiftAsMode, IsTheSameFunction) {
  const reduction::SeparatedModel model(mode_by_mode(two_terms(), 2, 1), "two");
  const reduction::SeparatedModel all = with_lift_as_mode(model);
  EXPECT_EQ(all.contents().parameter_modes, 3U);
  const std::vector<double> p = {0.7, 1.3};
  for (std::size_t t = 0; t < 4; ++t) {
    const auto before = model.evaluate(p, t).value, after = all.evaluate(p, t).value;
    for (std::size_t i = 0; i < before.size(); ++i) EXPECT_NEAR(after[i], before[i], 1e-10);
  }
}

/// One dof that shows the beam's own displacement u, loads f, steps of 0.1 mm.
reduction::Snapshots beam_with_loads(const std::vector<double>& loads) {
  reduction::Snapshots s;
  s.axes.emplace_back();
  s.axes.back().name = "Y0";
  s.axes.back().nodes = {0.5, 1.5};
  s.dofs.points = {0, 0, 0};
  s.dofs.components = {1};
  s.outputs = {{"imposed_displacement", {}, {}}, {"reaction_force", {}, {}}};
  for (int g = 0; g < 2; ++g)
    for (std::size_t t = 0; t < loads.size(); ++t) {
      const double u = 1e-4 * static_cast<double>(t + 1);
      s.values.push_back(u);
      s.outputs[0].values.push_back(u);
      s.outputs[1].values.push_back(loads[t]);
      if (g == 0) s.time.push_back(u), s.lift.push_back(u);
    }
  return s;
}

TEST(BehindSpring, AnElasticBeamGetsItsShare) {
  const reduction::Snapshots softer = behind_spring(beam_with_loads({3, 6, 9, 12}), 1e4);
  for (std::size_t t = 0; t < 4; ++t) {
    const double share = 1e4 / (1e4 + 3e4), u = 1e-4 * static_cast<double>(t + 1);
    EXPECT_NEAR(softer.solution(1)[t], share * u, 1e-16);
    EXPECT_NEAR(softer.lift[t], share * u, 1e-16);
    EXPECT_NEAR(softer.outputs[1].values[4 + t], share * 3e4 * u, 1e-12);
    EXPECT_EQ(softer.outputs[0].values[4 + t], u);
  }
}

/// u + F/k is 0.2, 0.4, 0.32, 0.45, 0.55 and 0.6 mm: beyond 0.4 mm the beam goes on behind its fourth state.
TEST(BehindSpring, WhereTheLoadFallsFasterThanTheSpringTheBeamJumps) {
  const reduction::Snapshots jumped = behind_spring(beam_with_loads({1, 2, 0.2, 0.5, 0.5, 0}), 1e4);
  const double expected[] = {0.5e-4, 1e-4, 1.5e-4, 2e-4, 4.5e-4, 6e-4};
  for (std::size_t t = 0; t < 6; ++t) EXPECT_NEAR(jumped.solution(0)[t], expected[t], 1e-15) << t;
}

/// Springs under the supports are in the finite elements; two of half the stiffness are one in series.
TEST(BehindSpring, IsWhatFiniteElementsSayOfSpringsUnderTheSupports) {
  BeamCase chosen = coarse_case();
  chosen.problem.solver.steps = 200;
  chosen.problem.solver.displacement = 3e-4;
  constexpr double k_stiffness = 1e8;
  const auto run = [](const mechanics::BeamProblem& problem) {
    mechanics::FullOrderModel model = mechanics::make_full_order_model(problem);
    return mechanics::as_snapshots(problem, model.structure(), model.run(problem.reference));
  };
  const reduction::Snapshots rigid = run(chosen.problem), softer = behind_spring(rigid, k_stiffness);
  chosen.problem.beam.support_stiffness = 0.5 * k_stiffness;
  const reduction::Snapshots springs = run(chosen.problem);
  double peak = 0, moved = 0, off = 0;
  for (const reduction::SnapshotOutput& output : springs.outputs) {
    if (output.name != "reaction_force") continue;
    const auto i = static_cast<std::size_t>(&output - springs.outputs.data());
    for (std::size_t t = 0; t < 200; ++t) {
      peak = std::max(peak, output.values[t]);
      moved = std::max(moved, std::abs(rigid.outputs[i].values[t] - output.values[t]));
      off = std::max(off, std::abs(softer.outputs[i].values[t] - output.values[t]));
    }
  }
  EXPECT_GT(moved, 0.1 * peak);
  EXPECT_LT(off, 0.005 * peak);
}

TEST(SeriesSpring, ItsStiffnessPutsThePeakOfTheLoadWhereItWasAskedFor) {
  BeamCase chosen = coarse_case();
  chosen.problem.solver.steps = 100;
  const BeamCase soft = with_series_spring(chosen, 0.5);
  mechanics::FullOrderModel model = mechanics::make_full_order_model(chosen.problem);
  const reduction::Snapshots run = behind_spring(
      mechanics::as_snapshots(chosen.problem, model.structure(), model.run({})), soft.machine_stiffness);
  for (const reduction::SnapshotOutput& output : run.outputs) {
    if (output.name != "reaction_force") continue;
    const auto peak = std::max_element(output.values.begin(), output.values.end()) - output.values.begin();
    EXPECT_NEAR(run.time[static_cast<std::size_t>(peak)], 0.5, 0.011);
  }
  EXPECT_THROW((void)with_series_spring(chosen, 0.05), NumericalError);
}

TEST_F(CoarseBeam, ModelsAreKeptAndThoseOfAnotherCaseAreNot) {
  const BeamModels again = prepare(coarse_case(), folder_->file(""), 2);
  EXPECT_TRUE(again.kept);
  EXPECT_EQ(again.paper.contents().temporal, subject_->models.paper.contents().temporal);
  EXPECT_EQ(again.paper.contents().parameter_modes, 5U);
  EXPECT_EQ(again.three.contents().parameter_modes, 2U);
  EXPECT_LE(again.three_best.contents().relative_error, again.three.contents().relative_error * (1 + 1e-9));
  BeamCase other = coarse_case();
  other.what = "described otherwise";
  EXPECT_FALSE(prepare(other, folder_->file(""), 2).kept);
}

TEST_F(CoarseBeam, TheSurfaceLiesBesideTheNotchAndItsMatrixIsSymmetric) {
  const Surface surface = surface_of(coarse_case(), 1);
  const Surface again = surface_of(coarse_case(), 1);
  ASSERT_GT(surface.x.size(), 300U);
  EXPECT_EQ(surface.sensors.size(), 2 * surface.x.size());
  EXPECT_EQ(surface.matrix.rows(), static_cast<Eigen::Index>(surface.sensors.size()));
  for (std::size_t a = 0; a < surface.x.size(); ++a)
    EXPECT_FALSE(std::abs(surface.x[a]) < 0.01 && surface.y[a] < 0.02)
        << surface.x[a] << ", " << surface.y[a];
  const Eigen::SparseMatrix<double> transposed = surface.matrix.transpose();
  EXPECT_LT((surface.matrix - transposed).norm(), 1e-12 * surface.matrix.norm());
  EXPECT_EQ((surface.matrix - again.matrix).norm(), 0.0);
}

TEST_F(CoarseBeam, PublishedChoiceIsTheThirtyLargestOfTheWeightedProduct) {
  const Surface surface = surface_of(coarse_case(), 1);
  const PublishedSelection s = select_as_published(subject_->models.paper, surface, subject_->truth, 5);
  ASSERT_EQ(s.dofs.size(), 30U);
  const std::set<Eigen::Index> chosen(s.dofs.begin(), s.dofs.end());
  EXPECT_EQ(chosen.size(), 30U);
  const Eigen::VectorXd dense = Eigen::MatrixXd(surface.matrix) *
                                (s.sensitivity.col(0).array() * s.sensitivity.col(1).array()).matrix();
  double least = INFINITY, most = 0;
  for (Eigen::Index i = 0; i < dense.size(); ++i) {
    if (chosen.contains(i))
      least = std::min(least, std::abs(dense[i]));
    else
      most = std::max(most, std::abs(dense[i]));
  }
  EXPECT_GE(least, most * (1 - 1e-12));
  const auto random = select_at_random(surface, 7);
  EXPECT_EQ(std::set<Eigen::Index>(random.begin(), random.end()).size(), 30U);
  EXPECT_EQ(random, select_at_random(surface, 7));
  EXPECT_NE(random, select_at_random(surface, 8));
}

TEST_F(CoarseBeam, TheSameSeedGivesTheSameRunAndTheTruthIsFound) {
  RunOptions options;
  options.update = default_options(1);
  options.marginals = true;
  const auto model = observed(subject_->models.paper, subject_->sensors);
  EXPECT_EQ(model->observations(), 60);
  const auto run = assimilate(model, subject_->data, options),
             again = assimilate(model, subject_->data, options);
  for (Eigen::Index k = 0; k < 2; ++k) {
    EXPECT_EQ(run.mean(k), again.mean(k));
    EXPECT_LT(run.off_by(k, 1.0), 4);
    EXPECT_LT(run.std(k), run.std_at(0, k));
    EXPECT_NEAR(run.mode_of_marginal(static_cast<std::size_t>(k)), run.mean(k), 2 * run.std(k));
  }
  EXPECT_GE(run.worst_off(subject_->truth).std, run.off_by(1, 1.0));
}

/// Before the onset the model is exact and all treatments but the corrected see the same data; what the rows
/// say is what the series hold.
TEST_F(CoarseBeam, TheOnsetStudyHasAMedianForEveryOnsetAndTreatment) {
  StudyOptions options = StudyOptions::quickly();
  options.repetitions = 3;
  const FigureRecord record = bias_onset(*subject_, options);
  expect_complete(record);
  EXPECT_EQ(series(record, "onset"), (std::vector<double>{15, 25, 35, 50, 65}));
  for (const char* name : {"uncorrected", "published", "linear", "joint", "linear, from the alarm"}) {
    const auto &low = series(record, fmt::format("last_low_{}", name)),
               &median = series(record, fmt::format("last_median_{}", name)),
               &high = series(record, fmt::format("last_high_{}", name));
    const auto& worst = series(record, fmt::format("worst_median_{}", name));
    ASSERT_EQ(median.size(), 5U);
    for (std::size_t i = 0; i < 5; ++i) {
      EXPECT_LE(low[i], median[i]) << name;
      EXPECT_LE(median[i], high[i]) << name;
      EXPECT_LE(median[i], worst[i]) << name;
    }
  }
  EXPECT_EQ(record.tables[0].rows.size(), 30U);
}

/// The uncompressed snapshots have no error at a node, and between them that of the splines alone.
TEST_F(CoarseBeam, DecompositionsAreJudgedByTheUncompressedSnapshots) {
  StudyOptions options = StudyOptions::quickly();
  options.models_folder = folder_->file("");
  const FigureRecord record = decompositions(*subject_, options);
  expect_complete(record);
  EXPECT_EQ(series(record, "truth_is_node"), (std::vector<double>{1, 0, 0}));
  const auto snapshots =
      reduction::observe_snapshots(runs_of(coarse_case(), folder_->file(""), 2), subject_->sensors);
  mechanics::FullOrderModel model = mechanics::make_full_order_model(coarse_case().problem);
  const reduction::ModelContents& c = subject_->models.paper.contents();
  const reduction::ObservationOperator operation(c.dofs, c.mesh, "the beam", subject_->sensors);
  const auto& errors = series(record, "error_um, uncompressed snapshots");
  const Eigen::Vector2d truths[] = {{1, 1}, {0.9375, 1.0625}, {1.1875, 0.8125}};
  for (std::size_t i = 0; i < 3; ++i) {
    const mechanics::FullOrderResult run = model.run(mechanics::damage_parameters(
        coarse_case().problem, axes_of(coarse_case()), {truths[i].data(), truths[i].data() + 2}));
    const Eigen::MatrixXd exact = operation.apply(Eigen::Map<const Eigen::MatrixXd>(
        run.displacement.data(), static_cast<Eigen::Index>(c.dof_count()), 12));
    const double error = 1e6 * (predicted(snapshots, truths[i]) - exact).cwiseAbs().maxCoeff();
    EXPECT_NEAR(errors[i], error, 1e-5);
    EXPECT_EQ(error < 1e-6, i == 0) << error;
  }
  // The starts are random, and end elsewhere.
  const auto &first = series(record, "error_um, m = 6, random start 1"),
             &second = series(record, "error_um, m = 6, random start 2");
  EXPECT_GT(std::abs(first[0] - second[0]), 1e-3 * first[0]);
  for (const double shift : series(record, "worst_shift_std, uncompressed snapshots")) EXPECT_EQ(shift, 0);
  for (const double shift : series(record, "worst_shift_std, m = 3")) EXPECT_GT(shift, 0);
}

TEST_F(CoarseBeam, NoiseOfImageCorrelationIsThatOfTheMatrixThatSelects) {
  const Surface surface = surface_of(coarse_case(), 1);
  const assimilation::NoiseModel noise = correlation_noise(surface);
  const Eigen::MatrixXd covariance = Eigen::MatrixXd(noise.precision()).inverse();
  std::vector<double> std;
  for (Eigen::Index i = 0; i < covariance.rows(); ++i) std.push_back(std::sqrt(covariance(i, i)));
  std::nth_element(std.begin(), std.begin() + static_cast<std::ptrdiff_t>(std.size() / 2), std.end());
  EXPECT_NEAR(std[std.size() / 2], 1e-6, 1e-12);
  const double factor = noise.precision().coeff(0, 0) / surface.matrix.coeff(0, 0);
  EXPECT_LT((noise.precision() - factor * surface.matrix).norm(), 1e-12 * noise.precision().norm());
  // The truth is found with it, and the same seed gives the same data.
  const auto dofs = select_at_random(surface, 3);
  const auto run = assimilate_chosen(subject_->models.paper, surface, dofs, subject_->truth, noise, 3);
  const auto again = assimilate_chosen(subject_->models.paper, surface, dofs, subject_->truth, noise, 3);
  for (Eigen::Index k = 0; k < 2; ++k) {
    EXPECT_LT(run.off_by(k, 1.0), 4);
    EXPECT_EQ(run.mean(k), again.mean(k));
  }
}

TEST_F(CoarseBeam, FiguresAreCompleteAndTheFilesHoldThem) {
  StudyOptions options = StudyOptions::quickly();
  options.reference = coarse_case();
  options.repetitions = 1;
  Study study;
  study.figures = {figure_5(coarse_case()), figures_6_7(*subject_), figures_10_12(*subject_),
                   bias_onset(*subject_, options), figures_16_17(*subject_, options)};
  for (const FigureRecord& figure : study.figures) expect_complete(figure);
  const auto record = study_record(study, options);
  EXPECT_EQ(record["figures"].size(), 5U);
  EXPECT_EQ(record["seed"], 1);
  EXPECT_NO_THROW((void)files::json_line(record));
  const std::string page = study_page(study, options);
  for (const char* text : {"Fig. 5.", "Fig. 6-7.", "Fig. 10-12.", "When the bias begins", "Fig. 16-17.",
                           "why they differ", "</html>"})
    EXPECT_NE(page.find(text), std::string::npos) << text;
  for (const char* outside : {"<script", "<link", "src=", "url("})
    EXPECT_EQ(page.find(outside), std::string::npos) << outside;
}

}  // namespace
}  // namespace knothe::reproduction
